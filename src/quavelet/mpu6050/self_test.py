"""The factory self-test: each axis is moved by the chip itself, and its response compared with the factory's.

The vendor's procedure (RM p. 9 to 11; for the 6500 class the vendor's driver), with three things added: the axes are
measured once more with self-test off again, so that a board that moved meanwhile is not called broken; the sign
counts, where the vendor compares amounts; and what was disturbed, by the wires, the supply or a hand, is measured anew.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from quavelet.core.blocks import FloatArray
from quavelet.core.clock import Clock
from quavelet.core.errors import BusError, ChipUnstable, DeviceLost
from quavelet.core.units import NS_PER_S
from quavelet.mpu6050 import registers as r
from quavelet.mpu6050.access import RegisterAccess
from quavelet.mpu6050.config import ACCEL_LSB_PER_G, GYRO_LSB_PER_DPS, ChipConfig, configuration_table
from quavelet.mpu6050.factory_trim import TrimCodes, expected_response, read_codes
from quavelet.mpu6050.half_scale import is_half_scale
from quavelet.mpu6050.measuring import (
    RESET_MS,
    Average,
    average,
    borrowed,
    check_rows,
    measuring_config,
    read_steadily,
    set_up,
    sleep_ms,
    write_rows,
)
from quavelet.mpu6050.variants import LINE_STUCK, Variant

SAMPLES = 200
RESPONSE_WAIT_MS = 200
"""The vendor's: from the self-test bits to the first sample that counts."""
REPEAT_WITHIN_NS = 6 * NS_PER_S
"""No measurement begins later than this after the first."""
MOVED_DPS = 1.0
"""Spread of one average, or difference of the two without self-test; ten times the noise of PS 6.1 in 188 Hz."""
MOVED_G = 0.03
DEAD = 0.05
"""An axis that does not give so much of its response does nothing at all."""
_SELF_TEST_BITS = {field.register: field.mask for field in (r.GYRO_SELF_TEST, r.ACCEL_SELF_TEST)}
AXES = ("accel x", "accel y", "accel z", "gyro x", "gyro y", "gyro z")


@dataclass(frozen=True, slots=True)
class _Rules:
    """How one class of chips is tested. Bounds are of response over expected; and, of the response itself, where the
    factory wrote no code."""

    accel_range_g: int
    dlpf: int
    accel_ratio: tuple[float, float]
    gyro_ratio: tuple[float, float]
    accel_g: tuple[float, float]
    gyro_dps: tuple[float, float]
    gyro_signs: tuple[int, int, int] = (1, 1, 1)
    gyro_bias_dps: float = np.inf


# RM p. 9: within 14 %, at +-8 g and +-250 deg/s. Without a code: the vendor's driver.
_RULES_6050 = _Rules(8, 1, (0.86, 1.14), (0.86, 1.14), (0.3, 0.95), (10.0, 105.0), gyro_signs=(1, -1, 1))
# The vendor's driver.
_RULES_6500 = _Rules(2, 2, (0.5, 1.5), (0.5, np.inf), (0.225, 0.675), (60.0, np.inf), gyro_bias_dps=20.0)


@dataclass(frozen=True, slots=True)
class AxisVerdict:
    """What one axis came to.

    axis       one of `AXES`
    unit       "g" or "deg/s"
    measured   its response: with self-test less without
    expected   the factory's, None where it wrote none
    ratio      measured over expected, None where there is nothing to compare with
    passed     whether it is as it should be
    advice     what to do where it is not
    """

    axis: str
    unit: str
    measured: float
    expected: float | None
    ratio: float | None
    passed: bool
    advice: str = ""


@dataclass(frozen=True, slots=True)
class SelfTestReport:
    """All six axes; nothing in it is to be believed where the board was not `still`.

    repeats   how often it was measured anew
    """

    axes: tuple[AxisVerdict, ...]
    still: bool
    repeats: int = 0

    @property
    def passed(self) -> bool:
        return self.still and all(axis.passed for axis in self.axes)

    @property
    def advice(self) -> str:
        """The first thing to do; empty where all is well."""
        if not self.still:
            return "the board moved during its self-test: lay it down, let go, and test again"
        return next((f"{axis.axis} {axis.advice}" for axis in self.axes if not axis.passed), "")


def run_self_test(
    chip: RegisterAccess, *, variant: Variant, clock: Clock, on_repeat: Callable[[str], None] = lambda _reason: None
) -> SelfTestReport:
    """Test all six axes, in about 1.5 s; the board must lie still meanwhile.

    What was disturbed is measured anew for some seconds; on_repeat is told the reason. Sets ranges and filters of its
    own, and afterwards writes back those it found, without self-test bits. What was in the FIFO is gone, so that a
    source that streams from the chip must be started anew. Raises BusError, ChipUnstable, and DeviceLost where another
    chip answers; after any of them the chip must be started anew in any case.
    """
    rules = _RULES_6500 if variant.class_6500 else _RULES_6050
    rows = configuration_table(_config(rules), variant=variant)
    last_ns, repeats = clock.now_ns() + REPEAT_WITHIN_NS, 0
    with borrowed(chip, rows, clock=clock):
        while True:
            try:
                report = _measured_once(chip, rules, rows, variant=variant, clock=clock)
            except (BusError, ChipUnstable) as error:
                if clock.now_ns() > last_ns:
                    raise
                reason = str(error)
            else:
                if report.still or clock.now_ns() > last_ns:
                    return replace(report, repeats=repeats)
                reason = "the board moved, or what was read of it was disturbed"
            on_repeat(reason)
            repeats += 1
            sleep_ms(clock, RESET_MS)


def _config(rules: _Rules) -> ChipConfig:
    return measuring_config(rules.accel_range_g, dlpf=rules.dlpf)


def _measured_once(
    chip: RegisterAccess, rules: _Rules, rows: tuple[r.RegisterBits, ...], *, variant: Variant, clock: Clock
) -> SelfTestReport:
    nature = _nature(chip, variant)
    set_up(chip, _config(rules), variant=variant, clock=clock)
    before, on, after = (_stretch(chip, rows, variant, clock, on=on) for on in (False, True, False))
    if _nature(chip, variant) != nature:
        raise ChipUnstable(
            f"the factory's words in the chip at 0x{chip.address:02x} read differently after its self-test: check "
            f"wires and supply voltage, then try again"
        )
    codes, half_scale = nature
    expected = expected_response(codes, variant=variant)
    accel_lsb_per_g = ACCEL_LSB_PER_G[rules.accel_range_g] * (0.5 if half_scale else 1.0)
    lsb = np.array([accel_lsb_per_g] * 3 + [GYRO_LSB_PER_DPS[250]] * 3)
    off = (before.mean + after.mean) / 2
    response = (on.mean - off) / lsb
    axes = tuple(
        _judged(
            rules,
            axis,
            measured=float(response[axis]),
            expected=(*expected.accel_g, *expected.gyro_dps)[axis],
            at_end=on.at_end[axis] or before.at_end[axis],
            bias=float(off[axis] / lsb[axis]),
        )
        for axis in range(len(AXES))
    )
    return SelfTestReport(axes, _still(before, on, after, lsb))


def _nature(chip: RegisterAccess, variant: Variant) -> tuple[TrimCodes, bool]:
    """The factory's codes, and whether it is of half scale, of the chip that is meant and no other."""
    who_am_i = read_steadily(chip, r.WHO_AM_I, 1)[0]
    if who_am_i in LINE_STUCK:
        raise ChipUnstable(
            f"WHO_AM_I of the chip at 0x{chip.address:02x} reads 0x{who_am_i:02x} during its self-test: check power "
            f"and wiring, then try again"
        )
    if who_am_i != variant.who_am_i:
        raise DeviceLost(
            f"WHO_AM_I of the chip at 0x{chip.address:02x} reads 0x{who_am_i:02x} during its self-test where the "
            f"{variant.name} read 0x{variant.who_am_i:02x}: the chip was exchanged, start again"
        )
    return read_codes(chip, variant=variant), is_half_scale(chip, variant=variant)


def _stretch(
    chip: RegisterAccess, rows: tuple[r.RegisterBits, ...], variant: Variant, clock: Clock, *, on: bool
) -> Average:
    """The average with self-test on or off, which was so to its end."""
    pushed = [_self_test(row, on=on) for row in rows if row.register in (r.GYRO_CONFIG, r.ACCEL_CONFIG)]
    write_rows(chip, pushed)
    sleep_ms(clock, RESPONSE_WAIT_MS)
    got = average(chip, variant=variant, clock=clock, samples=SAMPLES)
    held = [row for row in rows if row.register not in (r.GYRO_CONFIG, r.ACCEL_CONFIG, r.FIFO_EN, r.USER_CTRL)]
    check_rows(chip, [*held, *pushed])
    if not got.sd.any():
        raise ChipUnstable(
            f"no axis of the chip at 0x{chip.address:02x} changes, real sensors have noise: power the board off and on"
        )
    return got


def _self_test(row: r.RegisterBits, *, on: bool) -> r.RegisterBits:
    """A row of the configuration with all its bits of the self-test on, or off, as it is."""
    bits = _SELF_TEST_BITS[row.register]
    return replace(row, set_bits=row.set_bits | bits, clear_bits=row.clear_bits & ~bits) if on else row


def _still(before: Average, on: Average, after: Average, lsb: FloatArray) -> bool:
    limit = np.array([MOVED_G] * 3 + [MOVED_DPS] * 3)
    spread = max(float((a.sd / lsb / limit).max()) for a in (before, on, after))
    return spread <= 1.0 and bool((np.abs(after.mean - before.mean) / lsb <= limit).all())


def _judged(
    rules: _Rules, axis: int, *, measured: float, expected: float | None, at_end: bool, bias: float
) -> AxisVerdict:
    is_gyro = axis >= 3
    ratio = measured / expected if expected else None
    if ratio is not None:
        value, (low, high) = ratio, rules.gyro_ratio if is_gyro else rules.accel_ratio
        none_at_all = DEAD
    else:
        value = measured * (rules.gyro_signs[axis - 3] if is_gyro else 1)
        low, high = rules.gyro_dps if is_gyro else rules.accel_g
        none_at_all = DEAD * low
    advice = ""
    if at_end:
        advice = "is at the end of its range: turn the board so that this axis does not point up, and test again"
    elif abs(value) < none_at_all:
        advice = "does not respond at all: it is broken, replace the board"
    elif value < 0:
        advice = "responds with the wrong sign: it is a clone of another kind or broken, do not trust this axis"
    elif not low <= value <= high:
        advice = (
            f"responds {value / low:.2f} of the least" if value < low else f"responds {value / high:.2f} of the most"
        )
        advice += " that is allowed: test again with the board still and its supply steady, then replace it"
    elif is_gyro and abs(bias) > rules.gyro_bias_dps:
        advice = f"shows {bias:.1f} deg/s at rest, above {rules.gyro_bias_dps:g}: replace the board"
    unit = "deg/s" if is_gyro else "g"
    return AxisVerdict(AXES[axis], unit, measured, expected, ratio, not advice, advice)
