"""A calibration put into the chip's own offset registers, as far as they hold it; the record keeps the rest.

What is written is taken off the record's offsets, to the step, so that nothing is corrected twice. The chip loses it in
every reset; whoever starts it with the record writes it again.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress

import msgspec
import numpy as np

from quavelet.bench.finding import Finding
from quavelet.bench.session_verdict import GOOD_DPS, GOOD_G, PER_G_DPS, forces_g, rates_dps
from quavelet.bench.session_watch import Watch
from quavelet.bus.protocol import I2CBus
from quavelet.calibration.model import Vector
from quavelet.calibration.poses import StillPose, vector
from quavelet.calibration.record import CalibrationRecord
from quavelet.core.blocks import FloatArray
from quavelet.core.clock import Clock
from quavelet.core.errors import CalibrationError, ImuError
from quavelet.core.health import Health
from quavelet.core.units import DEG_PER_RAD, NS_PER_S, RAD_PER_DEG, STANDARD_GRAVITY_M_S2
from quavelet.imu import offset_plan, offsets_table
from quavelet.loop.deadline import FixedStepLoop
from quavelet.mpu6050.access import RegisterAccess
from quavelet.mpu6050.offset_plan import OffsetPlan
from quavelet.mpu6050.offsets import OffsetsTaken, write_known_offsets
from quavelet.mpu6050.source import ChipSource
from quavelet.mpu6050.stream import StreamInfo
from quavelet.settings import Settings

LOOKS_HZ = 20.0
PATIENCE_S = 120.0
"""For the board to be put down."""
TRIES = 3
SAY = "Leave the board lying still on the table, and let go of it and its cable: in 25 s its offsets are written."
AGAIN = "it is tried once more"


def write_offsets(
    i2c: I2CBus, record: CalibrationRecord, *, settings: Settings, clock: Clock, tell: Callable[[str], None]
) -> tuple[CalibrationRecord, Finding]:
    """Write what the record knows of offsets into its chip, and see on the board at rest that both together are right.

    `record` must be of the chip with the factory's words. Gives the record for the chip with its offsets, and what was
    found. Raises CalibrationError where the board does not rest, or the chip does not take its offsets: the factory's
    words are then in it again, if it answers; BusError, DeviceLost, ChipUnstable where it does not.
    """
    tell(SAY)
    try:
        for left in reversed(range(TRIES)):
            try:
                return _once(i2c, record, settings, clock, tell)
            except CalibrationError as error:
                if not left:
                    raise
                tell(f"{error}; {AGAIN}")
    except BaseException:
        # Whatever ended it, Ctrl-C too: no words of a trial are left in the chip, if it still answers.
        with suppress(ImuError):
            _source(i2c, settings, clock, None).wait_until_streaming()
        raise
    raise AssertionError("the last try raises")


def _once(
    i2c: I2CBus, record: CalibrationRecord, settings: Settings, clock: Clock, tell: Callable[[str], None]
) -> tuple[CalibrationRecord, Finding]:
    source = _source(i2c, settings, clock, None)
    still_pose(source, settings=settings, clock=clock)
    tell("it lies still, and is measured")
    written = _taken_off(record, _write(i2c, record, source.wait_until_streaming(), clock))
    return written, _seen(i2c, written, settings, clock)


def _write(i2c: I2CBus, record: CalibrationRecord, info: StreamInfo, clock: Clock) -> OffsetsTaken:
    accel, bias = record.accelerometer, record.gyro_bias
    return write_known_offsets(
        RegisterAccess(i2c, address=info.address, clock=clock, health=Health()),
        variant=info.variant,
        clock=clock,
        accel_g=None if accel is None else np.array(accel.offset_m_s2) / STANDARD_GRAVITY_M_S2,
        gyro_dps=None if bias is None else np.array(bias.coefficients_rad_s[0]) * DEG_PER_RAD,
    )


def _taken_off(record: CalibrationRecord, taken: OffsetsTaken) -> CalibrationRecord:
    """The record for the chip that holds these offsets: its own are what they leave."""
    accel, bias = record.accelerometer, record.gyro_bias
    if accel is not None:
        left = _sum(accel.offset_m_s2, STANDARD_GRAVITY_M_S2 * np.array(taken.accel_g))
        accel = msgspec.structs.replace(accel, offset_m_s2=left)
    if bias is not None:
        constant, *others = bias.coefficients_rad_s
        left = _sum(constant, RAD_PER_DEG * np.array(taken.gyro_dps))
        bias = msgspec.structs.replace(bias, coefficients_rad_s=(left, *others))
    return msgspec.structs.replace(record, accelerometer=accel, gyro_bias=bias, offsets=offsets_table(taken.plan))


def _seen(i2c: I2CBus, record: CalibrationRecord, settings: Settings, clock: Clock) -> Finding:
    """What the chip shows by its new record, started as `run` starts it. Raises CalibrationError beyond the limits."""
    pose = still_pose(_source(i2c, settings, clock, offset_plan(record)), settings=settings, clock=clock)
    calibration = record.calibration()
    off_g = abs(float(np.linalg.norm(forces_g([pose], calibration)[0])) - 1.0)
    off_dps = float(np.abs(rates_dps([pose], calibration)).max())
    accel, bias = record.accelerometer, record.gyro_bias
    # What 1 g adds to the bias is known where the accelerometer was calibrated, too.
    limit_dps = GOOD_DPS + (PER_G_DPS if accel is None else 0.0)
    said, wrong = [], []
    if accel is not None:
        said.append(f"1 g within {1e3 * off_g:.1f} mg")
        wrong += [f"1 g is off by {1e3 * off_g:.1f} mg"] if off_g > GOOD_G else []
    if bias is not None:
        said.append(f"the rate within {off_dps:.3f} deg/s")
        wrong += [f"the rate is {off_dps:.3f} deg/s"] if off_dps > limit_dps else []
    if wrong:
        found = " and ".join(wrong)
        raise CalibrationError(f"with offsets in the chip {found} at rest: the board moved, or was warmed meanwhile")
    return Finding(
        name="chip's offsets",
        ok=True,
        found=f"written, read back, and seen with the board at rest: {', '.join(said)}",
        advice="each reset loses them: `run` writes them again with this calibration, other programs do not",
        figures={"off_mg": round(1e3 * off_g, 3), "off_dps": round(off_dps, 4)},
    )


def still_pose(source: ChipSource, *, settings: Settings, clock: Clock) -> StillPose:
    """The first three seconds that the board is still.

    Raises CalibrationError where it is not within PATIENCE_S, and what `ChipSource` raises.
    """
    source.wait_until_streaming()
    watch = Watch()
    rate_hz = max(LOOKS_HZ, settings.chip.sample_rate_hz / 35.0)
    loop = FixedStepLoop(clock, period_ns=round(NS_PER_S / rate_hz))
    for _ in loop.deadlines(clock.now_ns() + round(PATIENCE_S * NS_PER_S)):
        block = source.read()
        if len(block) and (poses := watch.seen(block).poses):
            return poses[0]
    raise CalibrationError(f"the board was not still for {PATIENCE_S:.0f} s: lay it down, and let go of it")


def _source(i2c: I2CBus, settings: Settings, clock: Clock, offsets: OffsetPlan | None) -> ChipSource:
    return ChipSource(
        i2c,
        address=settings.bus.address,
        config=settings.chip,
        accept_id=settings.bus.accept_id,
        offsets=offsets,
        clock=clock,
        health=Health(),
    )


def _sum(vector_: Vector, by: FloatArray) -> Vector:
    return vector(np.array(vector_) + by)
