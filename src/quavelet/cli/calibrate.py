"""`quavelet calibrate`: leads a person at a bench through a calibration, judges it, and saves it."""

from __future__ import annotations

from contextlib import ExitStack
from functools import partial
from pathlib import Path
from typing import Annotated

import msgspec
import typer

from quavelet.bench import chip_offsets
from quavelet.bench.session import STEPS, USUAL, Session, with_check
from quavelet.bench.session_conduct import conduct
from quavelet.bench.session_evidence import Chip, Evidence
from quavelet.bench.session_older import work_out_over
from quavelet.bench.session_store import SessionStore
from quavelet.bus.open import open_bus
from quavelet.bus.protocol import FollowsInstructions, I2CBus
from quavelet.calibration.record import ChipIdentity
from quavelet.calibration.record_file import (
    check_same_chip,
    check_writable,
    default_path,
    load_record,
)
from quavelet.cli import exits, options
from quavelet.cli.calibrate_ending import ended, tell_kept
from quavelet.cli.calibrate_operator import operator_for
from quavelet.cli.calibrate_recorded import chip_of, recorded_evidence
from quavelet.cli.run import Stop, stopped_by_signals, talk
from quavelet.core.clock import Clock, MonotonicClock, VirtualClock
from quavelet.core.errors import CalibrationError, ImuError, SettingsError
from quavelet.core.health import Health
from quavelet.drawing.page import check_drawing, check_place
from quavelet.imu import offset_plan, offsets_table
from quavelet.mpu6050.access import RegisterAccess
from quavelet.mpu6050.fingerprint import fingerprint_of
from quavelet.mpu6050.magnetometer.asked import MagnetometerParams
from quavelet.mpu6050.offset_plan import OffsetPlan
from quavelet.mpu6050.source import ChipSource
from quavelet.mpu6050.variants import Variant
from quavelet.settings import Settings

ALL = "all"
USUAL_STEPS = ",".join(USUAL)
LYING = ("warm-up", "allan")
"""For these nobody need touch the board; all else is judged by poses in the end."""
ALONE = ",".join(LYING)
PATIENCE_S = 1800.0
"""A step that takes longer with nobody there does not come to its end."""

Steps = Annotated[
    str, typer.Option("--steps", help=f"Some of {','.join(STEPS)}, with commas between; or all.", metavar="STEP,...")
]
Out = Annotated[
    Path | None, typer.Option("--out", help="Where it is saved [where `run` looks for it].", show_default=False)
]
Yes = Annotated[bool, typer.Option("--yes", help="Nobody is there: a fake bench does by itself what it is told.")]
AsJson = Annotated[bool, typer.Option("--json", help="One JSON object.")]
Resume = Annotated[bool, typer.Option("--resume", help="Go on with the session that was interrupted.")]
Force = Annotated[
    bool, typer.Option("--force", help="Save it even if it is not good enough, or worse than the one there.")
]
From = Annotated[
    Path | None,
    typer.Option(
        "--from", help="A recording in place of the board, .qrec or .npz.", metavar="FILE", show_default=False
    ),
]
WriteOffsets = Annotated[
    bool,
    typer.Option(
        "--write-offsets", help="Put the offsets found into the chip's own registers too; `run` does so at each start."
    ),
]
Report = Annotated[
    Path | None, typer.Option("--report", help="Write a page of what was measured.", metavar="HTML", show_default=False)
]


def calibrate(
    bus: options.Bus = None,
    address: options.Address = None,
    accept_id: options.AcceptId = None,
    config: options.Config = None,
    steps: Steps = USUAL_STEPS,
    out: Out = None,
    yes: Yes = False,
    json: AsJson = False,
    resume: Resume = False,
    force: Force = False,
    from_file: From = None,
    write_offsets: WriteOffsets = False,
    report: Report = None,
    virtual_time: options.VirtualTime = False,
) -> None:
    """Calibrate a board on a bench, step by step; needs a table, something square, and some eight minutes.

    Steps: warm-up and rest (the board lies), faces (on each of its six), turns (all the way round on the table), poses
    (leant twelve ways), check (four more, by which the result is judged). On request also allan (noise, five minutes
    lying), temperature (warmed, then cooling), magnetometer (turned through all attitudes).

    Interrupted, it goes on with --resume. Exit code 6 where the result is not good enough: then nothing is saved.
    """
    if report is not None:
        check_drawing()
        check_place(report)
    asked = [name.strip().lower() for name in steps.split(",") if name.strip()]
    names = with_check(STEPS if ALL in asked else asked)
    settings = options.settings_of(bus, address, config, accept_id).settings
    if "magnetometer" in names and not settings.magnetometer.used:
        settings = msgspec.structs.replace(settings, magnetometer=MagnetometerParams(use="auto"))
    if write_offsets:
        _check_offsets_asked(settings, names, from_file)
    with ExitStack() as stack:
        store, in_chip = None, None
        if from_file is not None:
            if virtual_time or resume:
                raise typer.BadParameter("a recording has its own: leave --virtual-time, --resume out")
            evidence, src, out = recorded_evidence(from_file, out, settings, names, bus=bus)
        else:
            clock: Clock = VirtualClock() if options.on_virtual_time(settings, virtual_time) else MonotonicClock()
            i2c = stack.enter_context(open_bus(settings.bus.name, clock=clock))
            evidence, out, store = _measured(
                i2c, settings, clock, names, out, yes=yes, quiet=json, resume=resume, force=force, afresh=write_offsets
            )
            src = settings.bus.name
            if write_offsets:
                in_chip = partial(chip_offsets.write_offsets, i2c, settings=settings, clock=clock, tell=talk)
        result = work_out_over(evidence, out, even_if_worse=force, tell=talk)
        code = ended(result, out, store, in_chip, src=src, json=json, force=force, report=report)
    raise typer.Exit(code)


def _check_offsets_asked(settings: Settings, names: tuple[str, ...], from_file: Path | None) -> None:
    """Whether there can be offsets to write. Raises BadParameter, SettingsError."""
    if from_file is not None:
        raise typer.BadParameter("a recording has no registers to write to: leave --write-offsets out")
    if settings.offsets.plan() is not None:
        raise SettingsError("[offsets] of the settings stand in the chip already: remove them, or --write-offsets")
    if not {"rest", "temperature", "faces", "poses"} & set(names):
        raise typer.BadParameter("none of these steps shows an offset: take rest, faces or poses with --write-offsets")


def _measured(
    i2c: I2CBus,
    settings: Settings,
    clock: Clock,
    names: tuple[str, ...],
    out: Path | None,
    *,
    yes: bool,
    quiet: bool,
    resume: bool,
    force: bool,
    afresh: bool,
) -> tuple[Evidence, Path, SessionStore]:
    """The whole session on a board. Raises Exit where it was stopped, ImuError where it cannot go on.

    afresh   with the factory's words in the chip, whatever the calibration that is there has written
    """
    if isinstance(i2c, FollowsInstructions) and not yes:
        raise SettingsError(f"nobody moves the board of {settings.bus.name} by hand: give --yes, and it moves itself")
    if yes and not isinstance(i2c, FollowsInstructions) and not set(names) <= set(LYING):
        raise SettingsError(
            f"--yes is for a board that moves itself, as that of fake:bench; somebody must move that of "
            f"{settings.bus.name}: leave --yes out, or take --steps {ALONE} only"
        )
    plan = settings.offsets.plan()

    def offsets_of(variant: Variant) -> OffsetPlan | None:
        nonlocal plan
        if plan is None and not afresh:
            plan = _offsets_there(_identity(i2c, variant, settings, clock, None), out)
        return plan

    source = ChipSource(
        i2c,
        address=settings.bus.address,
        config=settings.chip,
        accept_id=settings.bus.accept_id,
        find_offsets=offsets_of,
        magnetometer=settings.magnetometer,
        clock=clock,
        health=Health(),
    )
    info = source.wait_until_streaming()
    chip = chip_of(_identity(i2c, info.variant, settings, clock, plan), info, offsets_table(plan))
    out = out or default_path(chip.identity)
    store = SessionStore(out)
    evidence = _begun(store, chip, resume=resume)
    check_writable(out)
    if not force:
        check_same_chip(out, chip.identity)
    session, stop = Session(names, evidence, axes=settings.mounting.axes), Stop()
    try:
        with operator_for(i2c, quiet=quiet) as operator, stopped_by_signals(stop.ask):
            finished = conduct(
                session,
                source,
                settings=settings,
                clock=clock,
                operator=operator,
                store=store,
                stopped=lambda: stop.is_asked,
                patience_s=PATIENCE_S if yes else float("inf"),
            )
    except ImuError:
        tell_kept(store)
        raise
    if not finished:
        tell_kept(store)
        raise typer.Exit(exits.INTERRUPTED)
    return evidence, out, store


def _begun(store: SessionStore, chip: Chip, *, resume: bool) -> Evidence:
    if resume:
        return store.load(chip)
    if store.path.exists():
        raise CalibrationError(
            f"{store.path} holds what was measured before: go on with it by --resume, or remove it to begin anew"
        )
    return Evidence(chip=chip)


def _offsets_there(chip: ChipIdentity, out: Path | None) -> OffsetPlan | None:
    """What the calibration of this chip that is there has in the chip's own registers: with it goes on what is kept."""
    path = out or default_path(chip)
    try:
        record = load_record(path) if path.is_file() else None
        return offset_plan(record) if record is not None and record.chip.fingerprint == chip.fingerprint else None
    except CalibrationError:
        return None  # What cannot be used is told of when it is gone over.


def _identity(i2c: I2CBus, variant: Variant, settings: Settings, clock: Clock, plan: OffsetPlan | None) -> ChipIdentity:
    address = settings.bus.address
    access = RegisterAccess(i2c, address=address, clock=clock, health=Health())
    return ChipIdentity(
        who_am_i=variant.who_am_i,
        name=variant.name,
        bus=i2c.name,
        address=address,
        fingerprint=fingerprint_of(access, variant=variant, offsets=plan),
    )
