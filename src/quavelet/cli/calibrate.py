"""`quavelet calibrate`: leads a person at a bench through a calibration, judges it, and saves it."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import ExitStack
from functools import partial
from pathlib import Path
from typing import Annotated

import msgspec
import typer

from quavelet.bench import chip_offsets
from quavelet.bench.finding import Finding
from quavelet.bench.session import STEPS, USUAL, Session, with_check
from quavelet.bench.session_conduct import conduct
from quavelet.bench.session_evidence import Chip, Evidence
from quavelet.bench.session_older import why_worse, work_out_over
from quavelet.bench.session_recorded import SHOWN, evidence_of
from quavelet.bench.session_report import write_report
from quavelet.bench.session_result import Result
from quavelet.bench.session_store import SessionStore
from quavelet.bench.session_verdict import verdict
from quavelet.bus.open import open_bus
from quavelet.bus.protocol import FollowsInstructions, I2CBus
from quavelet.calibration.record import CalibrationRecord, ChipIdentity, OffsetsTable
from quavelet.calibration.record_file import (
    check_same_chip,
    check_writable,
    default_path,
    from_toml,
    save_record,
)
from quavelet.cli import exits, options
from quavelet.cli.calibrate_operator import operator_for
from quavelet.cli.calibrate_told import Calibrated, tell
from quavelet.cli.run import stopped_by_signals, talk
from quavelet.core.clock import Clock, MonotonicClock, VirtualClock
from quavelet.core.errors import CalibrationError, ImuError, RecordingError, SettingsError
from quavelet.core.health import Health
from quavelet.drawing.page import check_drawing, check_place
from quavelet.imu import offsets_table
from quavelet.mpu6050.access import RegisterAccess
from quavelet.mpu6050.fingerprint import fingerprint_of
from quavelet.mpu6050.magnetometer.asked import MagnetometerParams
from quavelet.mpu6050.source import ChipSource
from quavelet.mpu6050.stream import StreamInfo
from quavelet.mpu6050.variants import MPU6050
from quavelet.recording.recorded import Recorded, load_recorded
from quavelet.settings import Settings

ALL = "all"
USUAL_STEPS = ",".join(USUAL)
RESUME = "the same command with --resume goes on with it"
MORE = "--resume with other --steps adds to it; to begin anew, remove it"
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
            evidence, src, out = _recorded(from_file, out, settings, names, bus=bus)
        else:
            clock: Clock = VirtualClock() if options.on_virtual_time(settings, virtual_time) else MonotonicClock()
            i2c = stack.enter_context(open_bus(settings.bus.name, clock=clock))
            evidence, out, store = _measured(
                i2c, settings, clock, names, out, yes=yes, quiet=json, resume=resume, force=force
            )
            src = settings.bus.name
            if write_offsets:
                in_chip = partial(chip_offsets.write_offsets, i2c, settings=settings, clock=clock, tell=talk)
        result = work_out_over(evidence, out, even_if_worse=force, tell=talk)
        code = _ended(result, out, store, in_chip, src=src, json=json, force=force, report=report)
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
) -> tuple[Evidence, Path, SessionStore]:
    """The whole session on a board. Raises Exit where it was stopped, ImuError where it cannot go on."""
    if isinstance(i2c, FollowsInstructions) and not yes:
        raise SettingsError(f"nobody moves the board of {settings.bus.name} by hand: give --yes, and it moves itself")
    if yes and not isinstance(i2c, FollowsInstructions) and not set(names) <= set(LYING):
        raise SettingsError(
            f"--yes is for a board that moves itself, as that of fake:bench; somebody must move that of "
            f"{settings.bus.name}: leave --yes out, or take --steps {ALONE} only"
        )
    source = ChipSource(
        i2c,
        address=settings.bus.address,
        config=settings.chip,
        accept_id=settings.bus.accept_id,
        offsets=settings.offsets.plan(),
        magnetometer=settings.magnetometer,
        clock=clock,
        health=Health(),
    )
    chip = _chip(i2c, source.wait_until_streaming(), settings, clock)
    out = out or default_path(chip.identity)
    store = SessionStore(out)
    evidence = _begun(store, chip, resume=resume)
    check_writable(out)
    if not force:
        check_same_chip(out, chip.identity)
    session, stop = Session(names, evidence, axes=settings.mounting.axes), _Stop()
    try:
        with operator_for(i2c, quiet=quiet) as operator, stopped_by_signals(stop):
            finished = conduct(
                session,
                source,
                settings=settings,
                clock=clock,
                operator=operator,
                store=store,
                stopped=stop.is_asked,
                patience_s=PATIENCE_S if yes else float("inf"),
            )
    except ImuError:
        _tell_kept(store)
        raise
    if not finished:
        _tell_kept(store)
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


def _chip(i2c: I2CBus, info: StreamInfo, settings: Settings, clock: Clock) -> Chip:
    plan = settings.offsets.plan()
    access = RegisterAccess(i2c, address=info.address, clock=clock, health=Health())
    identity = ChipIdentity(
        who_am_i=info.who_am_i,
        name=info.variant.name,
        bus=info.src,
        address=info.address,
        fingerprint=fingerprint_of(access, variant=info.variant, offsets=plan),
    )
    return _set_up(identity, info, offsets_table(plan))


def _recorded(
    file: Path, out: Path | None, settings: Settings, names: tuple[str, ...], *, bus: str | None
) -> tuple[Evidence, str, Path]:
    """The evidence in a recording, what it is of, and where the calibration goes."""
    if not set(SHOWN) & set(names):
        raise typer.BadParameter(f"a recording shows {', '.join(SHOWN)}: take some of them", param_hint="--steps")
    recorded = load_recorded(file)
    if len(recorded.runs) > 1:
        raise CalibrationError(f"{file}: the chip's ranges changed in it: record again, with one of them")
    if recorded.stream is not None and bus is not None:
        raise typer.BadParameter("the recording says itself what it is of: leave --bus out")
    if out is None and not recorded.calibration:
        # Only a chip says by its factory's trim which one it is, and `run` looks for it by that.
        raise typer.BadParameter("the recording does not say which chip it is of: give --out", param_hint="--from")
    chip = _recorded_chip(recorded, settings, bus)
    out = out or default_path(chip.identity)
    check_writable(out)
    evidence = evidence_of(recorded.runs, chip, steps=names)
    if recorded.damage:
        raise RecordingError(recorded.damage)
    return evidence, f"replay:{chip.identity.bus}", out


def _recorded_chip(recorded: Recorded, settings: Settings, bus: str | None) -> Chip:
    """The chip of a recording; arrays say nothing of theirs, so it is that of the options, on a bus of the file's name
    where none is given: such a calibration `run` does not take for that of a chip."""
    info, (run,) = recorded.stream, recorded.runs
    if info is None:
        chip = settings.chip
        identity = ChipIdentity(
            who_am_i=MPU6050.who_am_i,
            name=MPU6050.name,
            bus=bus or f"recording:{recorded.path.name}",
            address=settings.bus.address,
        )
        return Chip(
            identity=identity, gyro_range_dps=chip.gyro_range_dps, accel_range_g=chip.accel_range_g, scale=run.scale
        )
    if recorded.calibration:
        record = from_toml(recorded.calibration)
        return _set_up(record.chip, info, record.offsets)
    identity = ChipIdentity(who_am_i=info.who_am_i, name=info.variant.name, bus=info.src, address=info.address)
    return _set_up(identity, info, offsets_table(recorded.settings.offsets.plan()) if recorded.settings else None)


def _set_up(identity: ChipIdentity, info: StreamInfo, offsets: OffsetsTable | None) -> Chip:
    return Chip(
        identity=identity,
        gyro_range_dps=info.gyro_range_dps,
        accel_range_g=info.accel_range_g,
        scale=info.scale,
        offsets=offsets,
    )


class _Stop:
    """Whether Ctrl-C was pressed."""

    def __init__(self) -> None:
        self._asked = False

    def __call__(self) -> None:
        self._asked = True

    def is_asked(self) -> bool:
        return self._asked


def _tell_kept(store: SessionStore, *, then: str = RESUME) -> None:
    if words := store.last_words(then=then):
        talk(words)


InChip = Callable[[CalibrationRecord], tuple[CalibrationRecord, Finding]]


def _ended(
    result: Result,
    out: Path,
    store: SessionStore | None,
    in_chip: InChip | None,
    *,
    src: str,
    json: bool,
    force: bool,
    report: Path | None,
) -> int:
    """Judges, saves, tells; gives the exit code. Raises CalibrationError where it should be saved and cannot be.

    in_chip   puts what was saved into the chip as well, None where that was not asked for
    """
    findings, record, failure = verdict(result), result.record, None
    bad = [finding.name for finding in findings if not finding.ok]
    worse = why_worse(result, out)
    word = "not good enough" if bad else "worse" if worse else "good"
    reason = ""
    if (bad or worse) and not force:
        reason = f"not good enough: {', '.join(bad)}" if bad else f"the one at {out} is better: {worse}"
        reason += "; nothing is saved (--resume --force does, without measuring again)"
    elif not result.merged.fresh:
        reason = "these steps calibrate nothing, so nothing is saved"
    saved = None
    if not reason:
        try:
            # The factory's words and this record are right together, whatever comes of the chip's own offsets.
            save_record(record, out, even_if_worse=force)
            saved = str(out)
            if in_chip is not None:
                record, finding, failure = _put_in_chip(record, in_chip, out)
                findings.append(finding)
        except CalibrationError:
            if store is not None:
                _tell_kept(store)
            raise
    finished = failure is None and (saved is not None or not (bad or worse))
    if store is not None and finished:
        store.forget()
    told = Calibrated(
        v=1,
        src=src,
        verdict=word,
        saved=saved,
        reason=reason,
        findings=tuple(findings),
        record=record,
        noise=tuple(one.figures() for one in result.noise),
    )
    tell(told, as_json=json)
    if store is not None and not finished:
        _tell_kept(store, then=MORE if reason else RESUME)
    if report is not None:
        # Last, so that a page that cannot be written takes nothing else with it.
        write_report(report, result, findings, src=src, verdict=word, saved=saved, reason=reason)
        talk(f"{report} written")
    if failure is not None:
        return exits.exit_code(failure)
    return exits.VERDICT_FAILED if bad or worse else exits.OK


def _put_in_chip(
    record: CalibrationRecord, in_chip: InChip, out: Path
) -> tuple[CalibrationRecord, Finding, ImuError | None]:
    """The record that is saved at last, what is to be told, and what went wrong, None where nothing did.

    Raises CalibrationError where the record cannot be saved.
    """
    try:
        record, finding = in_chip(record)
    except ImuError as error:
        finding = Finding(
            name="chip's offsets",
            ok=False,
            found=f"not written: {error}",
            advice="the calibration is saved and good without them; the same command with --resume tries it once more",
        )
        return record, finding, error
    save_record(record, out, even_if_worse=True)
    return record, finding, None
