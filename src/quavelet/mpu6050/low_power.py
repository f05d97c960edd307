"""Cycle mode: the accelerometer alone, which wakes for single samples, at 10 to 140 uA where the chip draws 3.8 mA."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

from quavelet.core.clock import Clock
from quavelet.core.errors import ChipUnstable
from quavelet.core.units import NS_PER_MS, NS_PER_S, STANDARD_GRAVITY_M_S2
from quavelet.mpu6050 import registers as r
from quavelet.mpu6050.config import ACCEL_LSB_PER_G
from quavelet.mpu6050.half_scale import is_half_scale
from quavelet.mpu6050.int_status import IntStatus
from quavelet.mpu6050.measuring import PLL_WAIT_MS, borrowed, check_rows, sleep_ms, write_rows
from quavelet.mpu6050.variants import Variant

AS_PRINTED = 0.02
"""How far a wake rate may be from what the chip makes: RM9250 prints 0.24 Hz for 0.2441."""
LATE_PERIODS = 2.5
"""Without a sample for so long something is wrong: the internal oscillator may be 15 % slow when cold (PS 6.6)."""
LATE_NS = 50 * NS_PER_MS
POLLS_A_PERIOD = 20
_SHORTEST_POLL_NS, _LONGEST_POLL_NS = NS_PER_MS, 20 * NS_PER_MS


@dataclass(frozen=True, slots=True)
class AccelSample:
    """One sample of the accelerometer.

    t_ns          CLOCK_MONOTONIC when it was seen: up to a twentieth of a period (20 ms at most) after it was taken
    accel_m_s2    x y z in the body frame, +g up at rest, not calibrated
    """

    t_ns: int
    accel_m_s2: tuple[float, float, float]


class LowPower:
    """A chip that cycles; made by `cycling`."""

    def __init__(
        self, status: IntStatus, rows: tuple[r.RegisterBits, ...], *, clock: Clock, period_ns: int, m_s2_per_lsb: float
    ) -> None:
        self._status = status
        self._rows = rows
        self._clock = clock
        self._period_ns = period_ns
        self._m_s2_per_lsb = m_s2_per_lsb

    def read(self) -> AccelSample:
        """Wait for the next sample. Raises ChipUnstable where none comes or the setting is lost, BusError."""
        poll_ns = min(max(self._period_ns // POLLS_A_PERIOD, _SHORTEST_POLL_NS), _LONGEST_POLL_NS)
        chip, clock = self._status.chip, self._clock
        late_ns = clock.now_ns() + round(LATE_PERIODS * self._period_ns) + LATE_NS
        while not self._status.take(r.DATA_RDY_INT.mask):
            if clock.now_ns() > late_ns:
                check_rows(chip, self._rows)
                raise ChipUnstable(
                    f"the chip at 0x{chip.address:02x} cycles and gives no sample: power it off and on, then try again"
                )
            clock.sleep_until_ns(clock.now_ns() + poll_ns)
        t_ns = clock.now_ns()
        words = struct.unpack(">3h", chip.read_run(r.ACCEL_OUT, r.ACCEL_OUT.length))
        # A supply that dipped would leave another range: what was read is believed once the setting is seen to hold.
        check_rows(chip, self._rows)
        x, y, z = (word * self._m_s2_per_lsb for word in words)
        return AccelSample(t_ns, (x, y, z))


@contextmanager
def cycling(
    status: IntStatus, *, variant: Variant, clock: Clock, wake_hz: float, accel_range_g: int = 2
) -> Iterator[LowPower]:
    """The chip in cycle mode, with its gyroscope and thermometer off; afterwards it is as it was.

    wake_hz        samples a second, one of `variant.wake_rates_hz`; by the internal oscillator, which is 5 % off at
                   room temperature and up to 15 % over all (PS 6.6)
    accel_range_g  2, 4, 8 or 16

    No filter is before these samples: what shakes faster than half of wake_hz folds into them. The chip must not
    stream. Raises ValueError for what the chip cannot do, ChipUnstable where the setting does not hold, BusError.
    """
    if accel_range_g not in ACCEL_LSB_PER_G:
        raise ValueError(f"accel_range_g = {accel_range_g} is not possible: take 2, 4, 8 or 16")
    code = _wake_code(variant, wake_hz)
    chip = status.chip
    rows = _rows(variant, code, accel_range_g)
    with borrowed(chip, rows, clock=clock):
        power, *others = rows
        awake = r.RegisterBits(r.PWR_MGMT_1, 0, r.SLEEP.mask | r.CYCLE.mask | r.CLKSEL.mask)
        # The clock leaves the gyroscope before that goes to standby (RM p. 41); cycling begins when all is set.
        write_rows(chip, [awake])
        sleep_ms(clock, PLL_WAIT_MS)
        write_rows(chip, others)
        counts_per_g = ACCEL_LSB_PER_G[accel_range_g] * (0.5 if is_half_scale(chip, variant=variant) else 1.0)
        write_rows(chip, [power])
        status.take(r.DATA_RDY_INT.mask)  # of a sample taken before
        yield LowPower(
            status,
            rows,
            clock=clock,
            period_ns=round(NS_PER_S / variant.wake_rates_hz[code]),
            m_s2_per_lsb=STANDARD_GRAVITY_M_S2 / counts_per_g,
        )


def _wake_code(variant: Variant, wake_hz: float) -> int:
    for code, rate_hz in enumerate(variant.wake_rates_hz):
        if abs(wake_hz - rate_hz) <= AS_PRINTED * rate_hz:
            return code
    rates = ", ".join(f"{rate_hz:.3g}" for rate_hz in variant.wake_rates_hz)
    raise ValueError(f"wake_hz = {wake_hz:g} cannot be made by the {variant.name}: take one of {rates}")


def _rows(variant: Variant, code: int, accel_range_g: int) -> tuple[r.RegisterBits, ...]:
    power = r.CYCLE.mask | r.TEMP_DIS.mask
    off = r.DEVICE_RESET.mask | r.SLEEP.mask | r.CLKSEL.mask
    accel = r.ACCEL_FS_SEL.encode(list(ACCEL_LSB_PER_G).index(accel_range_g))
    standby = r.STBY_GYRO.mask | (0 if variant.class_6500 else r.LP_WAKE_CTRL.encode(code))
    own: tuple[r.RegisterBits, ...] = ()
    if variant.class_6500:
        off |= r.GYRO_STANDBY.mask
        own = (_row(r.LP_ACCEL_ODR, r.LPOSC_CLKSEL.encode(code), r.LPOSC_CLKSEL.mask),)
    return (
        _row(r.PWR_MGMT_1, power, power | off),
        _row(r.PWR_MGMT_2, standby, r.STANDBY.mask),
        *own,
        _row(r.ACCEL_CONFIG, accel, r.ACCEL_SELF_TEST.mask | r.ACCEL_FS_SEL.mask),
        _row(r.INT_ENABLE, r.DATA_RDY_EN.mask, r.DATA_RDY_EN.mask),
        _row(r.FIFO_EN, 0, 0xFF),
        _row(r.USER_CTRL, 0, r.USER_DMP_EN.mask | r.USER_FIFO_EN.mask | r.USER_I2C_MST_EN.mask),
    )


def _row(register: r.Register, set_bits: int, field_bits: int) -> r.RegisterBits:
    return r.RegisterBits(register, set_bits, field_bits & ~set_bits)
