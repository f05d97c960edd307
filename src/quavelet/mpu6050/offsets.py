"""The offset registers of the chip: measured with the board at rest, written, and seen to work.

Always reckoned from the factory's own words, which the chip holds after a reset: from what was written last, repeated
calibration would walk away. The direction is found by trying, since the data sheets contradict one another on it.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

import numpy as np

from quavelet.core.blocks import BoolArray, FloatArray
from quavelet.core.clock import Clock
from quavelet.core.errors import CalibrationError
from quavelet.mpu6050 import registers as r
from quavelet.mpu6050.access import RegisterAccess
from quavelet.mpu6050.config import ACCEL_LSB_PER_G as COUNTS_PER_G
from quavelet.mpu6050.config import GYRO_LSB_PER_DPS as COUNTS_PER_DPS
from quavelet.mpu6050.half_scale import is_half_scale
from quavelet.mpu6050.measuring import (
    average,
    measuring_config,
    read_steadily,
    reset_chip,
    set_up,
    sleep_ms,
    write_rows,
)
from quavelet.mpu6050.offset_plan import ACCEL_LSB_PER_G, GYRO_LSB_PER_DPS, OffsetPlan, Words
from quavelet.mpu6050.variants import Variant

SAMPLES = 4000
"""Four seconds: the noise of PS 6.1 and 6.2 leaves 0.002 deg/s and 0.14 mg of a mean, well below a step."""
TRY_SAMPLES = 500
FILTER_WAIT_MS = 100
"""From an offset written to the first sample that counts; the narrowest filter is not used."""
TRY_WORDS = 64
"""Written to find the direction: 31 mg and 2 deg/s, far above noise and far below what would clip."""
MOVED_DPS = 1.0
MOVED_G = 0.03
FITS_G = 0.003
FITS_DPS = 0.05
"""What the chip shows after offsets were written may be off by so much from what was reckoned."""
_LSB = np.array([ACCEL_LSB_PER_G] * 3 + [GYRO_LSB_PER_DPS] * 3)
_LIMIT = np.array([MOVED_G] * 3 + [MOVED_DPS] * 3) * _LSB
_FITS = np.array([FITS_G] * 3 + [FITS_DPS] * 3) * _LSB
_AXES = ("accel x", "accel y", "accel z", "gyro x", "gyro y", "gyro z")


@dataclass(frozen=True, slots=True)
class OffsetsWritten:
    """What came of it.

    plan             to be given to whoever starts the chip: every reset loses what was written
    accel_before_g   what the axes showed too much, x y z; nan where lies_g was None
    accel_after_g    and show still
    gyro_before_dps, gyro_after_dps   likewise
    """

    plan: OffsetPlan
    accel_before_g: tuple[float, ...]
    accel_after_g: tuple[float, ...]
    gyro_before_dps: tuple[float, ...]
    gyro_after_dps: tuple[float, ...]


def write_offsets(
    chip: RegisterAccess, *, variant: Variant, clock: Clock, lies_g: tuple[float, float, float] | None
) -> OffsetsWritten:
    """Measure the board at rest, and write offsets that bring what it shows to what it should show.

    lies_g is what the accelerometer should show as the board lies, (0, 0, 1) flat with z up: an error of 1 degree there
    becomes an offset of 17 mg. None: only the gyroscope's offsets are written. Takes about 12 s.

    The chip is reset first, and left awake with ranges and filters of this measurement: it must be started anew, with
    the plan. Raises CalibrationError where the board moves, an offset has no effect or the residual grows, after which
    the factory's words are in the registers again; BusError; ChipUnstable.
    """
    bench, factory = _set_up_bench(chip, variant, clock, np.array([*(lies_g or (0, 0, 0)), 0, 0, 0]))
    with _factory_again_on_failure(bench, factory):
        plan, before, after = _found(bench, factory, accel=lies_g is not None)
    if lies_g is None:
        before[:3] = after[:3] = np.nan
    accel_before, gyro_before = (before / _LSB).reshape(2, 3).tolist()
    accel_after, gyro_after = (after / _LSB).reshape(2, 3).tolist()
    return OffsetsWritten(plan, tuple(accel_before), tuple(accel_after), tuple(gyro_before), tuple(gyro_after))


@dataclass(frozen=True, slots=True)
class OffsetsTaken:
    """What came of `write_known_offsets`.

    plan       as in `OffsetsWritten`
    accel_g    what the chip shows more by these offsets, x y z: minus the errors, to the step; 0 where None was given
    gyro_dps   likewise
    """

    plan: OffsetPlan
    accel_g: tuple[float, ...]
    gyro_dps: tuple[float, ...]


def write_known_offsets(
    chip: RegisterAccess, *, variant: Variant, clock: Clock, accel_g: FloatArray | None, gyro_dps: FloatArray | None
) -> OffsetsTaken:
    """Write offsets that take away errors known beforehand, and see that they do, on the board at rest in any attitude.

    accel_g    what the axes (3,) show too much with the factory's words; None leaves these
    gyro_dps   likewise

    Otherwise as `write_offsets`. Raises CalibrationError also where what the chip shows is not what was reckoned,
    within FITS_G and FITS_DPS.
    """
    none = np.zeros(3)
    errors = np.concatenate([none if accel_g is None else accel_g, none if gyro_dps is None else gyro_dps]) * _LSB
    used = np.array([accel_g is not None] * 3 + [gyro_dps is not None] * 3)
    bench, factory = _set_up_bench(chip, variant, clock, np.zeros(6))
    with _factory_again_on_failure(bench, factory):
        way = _tried(bench, factory, used, samples=TRY_SAMPLES)[1]
        plan = _moved(factory, -way * errors * used)
        taken = way * _words_beyond(plan)
        before, after = bench.residual(factory), bench.residual(plan)
        # A bias that goes with the temperature meanwhile cancels.
        off = after - taken - 0.5 * (before + bench.residual(factory))
        if (np.abs(off) > _FITS).any():
            axis = int(np.argmax(np.abs(off) / _FITS))
            raise CalibrationError(
                f"{_AXES[axis]} is off by {off[axis] / _LSB[axis]:.3f} from what it should show with its offset: the "
                f"board moved, or this chip does not take its offsets so; leave them out, and calibrate in software"
            )
        write_rows(chip, list(plan.rows(variant)))
    accel, gyro = (taken / _LSB).reshape(2, 3).tolist()
    return OffsetsTaken(plan, tuple(accel), tuple(gyro))


def check_factory(chip: RegisterAccess, plan: OffsetPlan, *, variant: Variant) -> None:
    """Raise CalibrationError where a chip fresh from its reset is not the one whose offsets these are; BusError."""
    found = read_words(chip, variant=variant)
    if (found.accel_factory, found.gyro_factory) != (plan.accel_factory, plan.gyro_factory):
        raise CalibrationError(
            f"the chip at 0x{chip.address:02x} holds the factory's offsets {found.accel_factory}, those to be written "
            f"were measured on one that holds {plan.accel_factory}: measure them anew, or leave them out"
        )


def read_words(chip: RegisterAccess, *, variant: Variant) -> OffsetPlan:
    """What the offset registers hold, as a plan that changes nothing. Raises BusError."""
    accel, gyro = (
        tuple(int.from_bytes(read_steadily(chip, register, 2), "big", signed=True) for register in registers)
        for registers in (variant.accel_offsets, r.GYRO_OFFSETS)
    )
    accel_words: Words = (accel[0], accel[1], accel[2])
    gyro_words: Words = (gyro[0], gyro[1], gyro[2])
    return OffsetPlan(variant.who_am_i, accel_words, gyro_words, accel_words, gyro_words)


@dataclass(frozen=True, slots=True)
class _Bench:
    """The board at rest. Residuals are in the unit of the offset registers, all six axes."""

    chip: RegisterAccess
    variant: Variant
    clock: Clock
    words_per_count: FloatArray
    should_show: FloatArray

    def residual(self, plan: OffsetPlan, *, samples: int = SAMPLES) -> FloatArray:
        """What the axes show too much with these offsets. Raises CalibrationError where the board moves."""
        write_rows(self.chip, list(plan.rows(self.variant)))
        sleep_ms(self.clock, FILTER_WAIT_MS)
        got = average(self.chip, variant=self.variant, clock=self.clock, samples=samples)
        if (got.sd * self.words_per_count > _LIMIT).any():
            raise CalibrationError("the board moves: lay it down, let go, and measure the offsets again")
        if any(got.at_end):
            raise CalibrationError("an axis is at the end of its range: lay the board flat, and measure again")
        residual: FloatArray = got.mean * self.words_per_count - self.should_show * _LSB
        return residual


def _found(bench: _Bench, factory: OffsetPlan, *, accel: bool) -> tuple[OffsetPlan, FloatArray, FloatArray]:
    """The plan, and the residual before and after it."""
    used = np.array([accel] * 3 + [True] * 3)
    before, way = _tried(bench, factory, used)
    plan = _moved(factory, -way * before * used)
    after = bench.residual(plan)
    # A step is two words for the accelerometer, one for the gyroscope, of which the nearest is half of that off; and
    # the board itself may not have lain quite the same.
    grown = used & (np.abs(after) > np.maximum(np.abs(before), _LIMIT / 4))
    if grown.any():
        axis = int(np.flatnonzero(grown)[0])
        raise CalibrationError(
            f"{_AXES[axis]} is further off with its offset than without, {after[axis] / _LSB[axis]:.3f} and "
            f"{before[axis] / _LSB[axis]:.3f}: the board moved, lay it down and measure again"
        )
    return plan, before, after


def _tried(
    bench: _Bench, factory: OffsetPlan, used: BoolArray, *, samples: int = SAMPLES
) -> tuple[FloatArray, FloatArray]:
    """The residual with the factory's words, of so many samples, and which way each axis goes with its offset, +-1."""
    before = bench.residual(factory, samples=samples)
    tried = bench.residual(_moved(factory, TRY_WORDS * used.astype(np.float64)), samples=TRY_SAMPLES)
    effect = (tried - before) / TRY_WORDS
    dead = used & ~((np.abs(effect) > 0.5) & (np.abs(effect) < 1.5))
    if dead.any():
        axis = int(np.flatnonzero(dead)[0])
        raise CalibrationError(
            f"an offset written to {_AXES[axis]} moves it by {effect[axis]:.2f} of what was written: the board moved, "
            f"or this chip has its offsets elsewhere; leave them out and calibrate in software"
        )
    return before, np.sign(effect)


def _moved(factory: OffsetPlan, by: FloatArray) -> OffsetPlan:
    """The factory's words moved by so many; the accelerometer's in twos, which leaves bit 0 alone."""
    accel = tuple(word + 2 * round(x / 2) for word, x in zip(factory.accel_factory, by[:3].tolist(), strict=True))
    gyro = tuple(word + round(x) for word, x in zip(factory.gyro_factory, by[3:].tolist(), strict=True))
    return OffsetPlan(
        factory.who_am_i,
        factory.accel_factory,
        factory.gyro_factory,
        (accel[0], accel[1], accel[2]),
        (gyro[0], gyro[1], gyro[2]),
    )


def _words_beyond(plan: OffsetPlan) -> FloatArray:
    """What a plan puts beyond the factory's words, (6,)."""
    words = np.array([plan.accel, plan.gyro]) - np.array([plan.accel_factory, plan.gyro_factory])
    beyond: FloatArray = words.reshape(6).astype(np.float64)
    return beyond


def _set_up_bench(
    chip: RegisterAccess, variant: Variant, clock: Clock, should_show: FloatArray
) -> tuple[_Bench, OffsetPlan]:
    """The chip reset and set up for this measurement, and the factory's words."""
    reset_chip(chip, variant=variant, clock=clock)
    factory = read_words(chip, variant=variant)
    set_up(chip, measuring_config(2, dlpf=2), variant=variant, clock=clock)
    half = is_half_scale(chip, variant=variant)
    return _Bench(chip, variant, clock, _words_per_count(half=half), should_show), factory


@contextmanager
def _factory_again_on_failure(bench: _Bench, factory: OffsetPlan) -> Iterator[None]:
    try:
        yield
    except CalibrationError:
        write_rows(bench.chip, list(factory.rows(bench.variant)))
        raise


def _words_per_count(*, half: bool) -> FloatArray:
    accel = ACCEL_LSB_PER_G / (COUNTS_PER_G[2] * (0.5 if half else 1.0))
    return np.array([accel] * 3 + [GYRO_LSB_PER_DPS / COUNTS_PER_DPS[250]] * 3)
