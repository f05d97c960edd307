"""`quavelet align`: the first attitude of a board that lies still, and whether it can know north."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from math import cos, isfinite, radians
from pathlib import Path
from typing import Annotated

import msgspec
import numpy as np
import typer

from quavelet.alignment.board import Stillness, align_board, longest_still
from quavelet.alignment.result import UNIFORM_RAD, Alignment
from quavelet.alignment.sensors import MPU6050, SensorErrors
from quavelet.attitude.heading import HeadingParams
from quavelet.bus.open import open_bus
from quavelet.bus.protocol import I2CBus
from quavelet.calibration.calibrate import Calibrate
from quavelet.calibration.model import UNCALIBRATED, ImuCalibration
from quavelet.calibration.still_bias import StillBias
from quavelet.cli import exits, options
from quavelet.cli.run import talk
from quavelet.core.blocks import FloatArray, ImuBlock, RawBlock
from quavelet.core.clock import Clock, MonotonicClock, VirtualClock
from quavelet.core.errors import EndOfData
from quavelet.core.euler import to_euler
from quavelet.core.health import Health
from quavelet.core.units import DEG_PER_RAD, NS_PER_S
from quavelet.loop.deadline import FixedStepLoop
from quavelet.mpu6050.source import ChipSource
from quavelet.pipeline import mounted, mounted_heading
from quavelet.recording.reader import RecordingReader
from quavelet.recording.replay import ReplaySource
from quavelet.settings import Settings

STILL_S = 2.0
"""Less stillness than this is a board between two moves."""
LOST_S = 2.0
"""A chip that has gone for this long does not come back while somebody waits for the verdict."""

File = Annotated[
    Path | None, typer.Argument(help="A recording made by `run --record`, in place of the chip.", show_default=False)
]
Seconds = Annotated[float, typer.Option("--duration", help="How long to listen to the chip, s.", min=STILL_S + 1.0)]
Latitude = Annotated[
    float | None,
    typer.Option("--latitude", help="Of the place, deg, north positive.", min=-90.0, max=90.0, show_default=False),
]
AsJson = Annotated[bool, typer.Option("--json", help="One JSON object.")]


class Aligned(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True):
    """The JSON of `quavelet align`; without `q` the board was not aligned, and `reason` says why.

    heading             "observed", or why not: the name of a `Heading`
    heading_deg, north  of the y axis, clockwise from "magnetic" or "true" north, where it was observed
    sigma_deg           about world x, y, z; 103.9 is a heading of which nothing is known. That of y is pitch's
    roll_sigma_deg      that of x over the cosine of pitch: of a board on its nose roll is hardly known
    heading_sigma_deg   what the sensors' errors make of heading, where it was refused and that is a number
    """

    v: int
    src: str
    aligned: bool
    reason: str
    still_s: float
    q: tuple[float, ...] = ()
    roll_deg: float | None = None
    pitch_deg: float | None = None
    roll_sigma_deg: float | None = None
    heading_deg: float | None = None
    sigma_deg: tuple[float, ...] = ()
    heading: str = ""
    north: str = ""
    heading_sigma_deg: float | None = None
    samples: int = 0


def align(
    file: File = None,
    bus: options.Bus = None,
    address: options.Address = None,
    accept_id: options.AcceptId = None,
    config: options.Config = None,
    json: AsJson = False,
    duration: Seconds = 10.0,
    latitude: Latitude = None,
    virtual_time: options.VirtualTime = False,
) -> None:
    """Roll and pitch of a board that lies still, with their sigmas, and the verdict on heading with its reason.

    Exit code 6 where the board does not lie still.
    """
    if file is not None and (bus is not None or virtual_time):
        raise typer.BadParameter("a recording has its own: leave --bus and --virtual-time out", param_hint="FILE")
    settings = options.settings_of(bus, address, config, accept_id).settings
    reader = None
    if file is None:
        clock: Clock = VirtualClock() if options.on_virtual_time(settings, virtual_time) else MonotonicClock()
        with open_bus(settings.bus.name, clock=clock) as i2c:
            found, src = listen(i2c, settings, clock=clock, duration_s=duration), i2c.name
    else:
        reader = RecordingReader(file)
        source = ReplaySource(reader, health=Health())
        settings = settings if config else source.settings
        found, src = longest_still(_first_stages(iter(source.read, None), settings)), f"replay:{source.info.src}"
    aligned = aligned_by(found, settings, src=src, latitude_deg=latitude)
    exits.put(msgspec.json.encode(aligned).decode() if json else _lines(aligned))
    if reader is not None:
        reader.check()
    raise typer.Exit(exits.OK if aligned.aligned else exits.VERDICT_FAILED)


def listen(i2c: I2CBus, settings: Settings, *, clock: Clock, duration_s: float) -> Stillness:
    """The longest stillness of a chip in the next seconds. Raises what `ChipSource` raises."""
    source = ChipSource(
        i2c,
        address=settings.bus.address,
        config=settings.chip,
        accept_id=settings.bus.accept_id,
        offsets=settings.offsets.plan(),
        magnetometer=settings.magnetometer,
        clock=clock,
        health=Health(),
        lost_s=LOST_S,
    )
    source.wait_until_streaming()
    if sys.stderr.isatty():
        talk(f"listening for {duration_s:g} s, leave the board lying still")

    def drained() -> Iterator[RawBlock]:
        loop = FixedStepLoop(clock, period_ns=round(NS_PER_S / settings.loop.rate_hz))
        for _ in loop.deadlines(clock.now_ns() + round(duration_s * NS_PER_S)):
            try:
                yield source.read()
            except EndOfData:
                return

    return longest_still(_first_stages(drained(), settings))


def _first_stages(blocks: Iterator[RawBlock], settings: Settings) -> Iterator[ImuBlock]:
    """As the pipeline begins: counts to SI, and what is still."""
    calibrate, still = Calibrate(mounted(UNCALIBRATED, settings)), StillBias(window_s=settings.start.still_s)
    for raw in blocks:
        yield still.process(calibrate.process(raw))


def _errors(calibration: ImuCalibration, heading: HeadingParams) -> SensorErrors:
    return SensorErrors(
        accel_noise_m_s2_rthz=MPU6050.accel_noise_m_s2_rthz,
        accel_bias_m_s2=calibration.accel_sigma_m_s2,
        gyro_noise_rad_s_rthz=MPU6050.gyro_noise_rad_s_rthz,
        gyro_bias_rad_s=calibration.gyro_bias_sigma_rad_s,
        field_noise_ut=MPU6050.field_noise_ut,
        field_bias_ut=heading.hard_iron_sigma_ut,
    )


def _field_ut(block: ImuBlock, heading: HeadingParams) -> FloatArray | None:
    """What a calibrated magnetometer measured, (N, 3); one that is not calibrated measures its own iron."""
    if not heading.calibrated:
        return None
    soft_iron = np.array(heading.soft_iron or np.eye(3)).reshape(3, 3)
    field: FloatArray = (block.field_ut - np.array(heading.hard_iron_ut)) @ soft_iron.T
    return field


def aligned_by(found: Stillness, settings: Settings, *, src: str, latitude_deg: float | None) -> Aligned:
    """The verdict on what was found."""
    still_s = round(found.still_s, 2)
    if found.block is None or found.still_s < STILL_S:
        return Aligned(v=1, src=src, aligned=False, reason=_why_not(found), still_s=still_s)
    heading = mounted_heading(settings)
    latitude_rad = None if latitude_deg is None else radians(latitude_deg)
    try:
        result = align_board(
            found.block,
            errors=_errors(UNCALIBRATED, heading),
            latitude_rad=latitude_rad,
            field_ut=_field_ut(found.block, heading),
            declination_rad=0.0 if heading.declination_deg == "none" else radians(heading.declination_deg),
        )
    except ValueError as error:
        return Aligned(v=1, src=src, aligned=False, reason=str(error), still_s=still_s)
    north = "magnetic" if heading.declination_deg == "none" else "true"
    return message(result, src=src, still_s=still_s, samples=len(found.block), north=north)


def message(result: Alignment, *, src: str, still_s: float, samples: int, north: str = "magnetic") -> Aligned:
    """The alignment in degrees."""
    roll, pitch, _ = (DEG_PER_RAD * to_euler(result.q)).tolist()
    _, _, heading = (DEG_PER_RAD * to_euler(result.q, order="zxy")).tolist()
    roll_sigma = min(UNIFORM_RAD, float(result.sigma_rad[0]) / max(cos(radians(pitch)), 1e-9))
    known = isfinite(result.heading_sigma_rad) and result.heading_sigma_rad < UNIFORM_RAD
    return Aligned(
        v=1,
        src=src,
        aligned=True,
        reason=result.reason,
        still_s=still_s,
        q=tuple(round(x, 8) for x in result.q.tolist()),
        roll_deg=round(roll, 4),
        pitch_deg=round(pitch, 4),
        roll_sigma_deg=round(DEG_PER_RAD * roll_sigma, 4),
        heading_deg=round(heading % 360.0, 4) if result.has_heading else None,
        sigma_deg=tuple(round(x, 4) for x in (DEG_PER_RAD * result.sigma_rad).tolist()),
        heading=result.heading.name.lower(),
        north=north if result.has_heading else "",
        heading_sigma_deg=round(DEG_PER_RAD * result.heading_sigma_rad, 4) if known else None,
        samples=samples,
    )


def _why_not(found: Stillness) -> str:
    if found.stuck:
        return "the samples did not change, so the chip is stuck and not still: power the board off and on"
    return (
        f"the board moved: it lay still for {found.still_s:.1f} s of {found.all_s:.1f} s, and {STILL_S:g} s are "
        "needed; lay it down and let go"
    )


def _lines(aligned: Aligned) -> str:
    fake = " (a fake chip: NOT A REAL ONE)" if "fake:" in aligned.src else ""
    if not aligned.aligned:
        return f"refused  {aligned.reason}\nfrom     {aligned.src}{fake}"
    sigma = aligned.sigma_deg
    heading = f"refused: {aligned.reason}"
    if aligned.heading_deg is not None:
        of = f"of y, clockwise from {aligned.north} north"
        heading = f"{aligned.heading_deg:8.2f} deg  +- {sigma[2]:.2f}, {of}: {aligned.reason}"
    return "\n".join(
        [
            f"roll     {aligned.roll_deg:+8.2f} deg  +- {aligned.roll_sigma_deg:.2f}",
            f"pitch    {aligned.pitch_deg:+8.2f} deg  +- {sigma[1]:.2f}",
            f"heading  {heading}",
            f"from     {aligned.samples} samples in {aligned.still_s:.1f} s of stillness, {aligned.src}{fake}",
        ]
    )
