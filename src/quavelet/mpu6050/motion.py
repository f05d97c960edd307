"""The motion interrupt: the chip itself looks at its accelerometer, and says when it was moved.

Of a chip that nobody streams from: a stream has the accelerometer itself, and INT_STATUS, which tells of motion, is
cleared by being read.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from quavelet.bus.protocol import DataReady
from quavelet.core.clock import Clock
from quavelet.core.units import NS_PER_MS, NS_PER_S
from quavelet.mpu6050 import registers as r
from quavelet.mpu6050.int_status import IntStatus
from quavelet.mpu6050.measuring import borrowed, check_rows, sleep_ms, write_rows
from quavelet.mpu6050.variants import Variant

HIGH_PASS_HZ = (5.0, 2.5, 1.25, 0.63)
"""By ACCEL_HPF less 1 (the register map before rev 4.2, register 28)."""
POLL_NS = 10 * NS_PER_MS
CHECK_NS = NS_PER_S
"""How often the registers are looked at: a chip that lost its setting would be silent for ever. It is also how long a
lost edge of the line goes unnoticed."""
SETTLE_MS = 100
"""From waking to the first sample that counts; and the filter begins with the sample it is given."""
SETTLE_TIMES = 0.5
"""Over high_pass_hz, in seconds: three time constants of a filter of one pole."""


class Motion:
    """A chip that watches for motion; made by `watching_motion`."""

    def __init__(self, status: IntStatus, rows: tuple[r.RegisterBits, ...], *, clock: Clock) -> None:
        self._status = status
        self._rows = rows
        self._clock = clock

    def wait(self, timeout_s: float, *, line: DataReady | None = None) -> int | None:
        """CLOCK_MONOTONIC in ns when the chip was moved, since this was asked last; None where it was not.

        line   the wire from INT: with it the time is that of the edge, without up to 10 ms later

        Raises ChipUnstable where the chip has lost its setting, BusError, ValueError for a time below 0.
        """
        if timeout_s < 0:
            raise ValueError(f"cannot wait {timeout_s:g} s: give 0 or more")
        clock = self._clock
        end_ns = clock.now_ns() + round(timeout_s * NS_PER_S)
        check_ns = clock.now_ns() + CHECK_NS
        while True:
            edges = line.wait(max(0, min(end_ns, check_ns) - clock.now_ns()) / NS_PER_S) if line else []
            if self._status.take(r.MOT_INT.mask):
                return edges[0].t_ns if edges else clock.now_ns()
            now_ns = clock.now_ns()
            if now_ns >= min(end_ns, check_ns):
                check_rows(self._status.chip, self._rows)
                check_ns = now_ns + CHECK_NS
            if now_ns >= end_ns:
                return None
            if line is None:
                clock.sleep_until_ns(min(now_ns + POLL_NS, end_ns))


@contextmanager
def watching_motion(
    status: IntStatus,
    *,
    variant: Variant,
    clock: Clock,
    threshold_mg: float,
    duration_ms: int = 1,
    high_pass_hz: float = 0.63,
    mg_per_lsb: float | None = None,
) -> Iterator[Motion]:
    """The chip told to watch for motion, and awake; afterwards it is as it was.

    threshold_mg   by how much an axis must be moved
    duration_ms    for how long, 1 to 255 samples of 1 kHz; with `cycling` within, samples of its rate
    high_pass_hz   5, 2.5, 1.25 or 0.63: what is slower is not motion; gravity never is
    mg_per_lsb     what a count of the threshold is worth, where it was measured: the documents contradict one another
                   (see `Variant.motion_mg_per_lsb`)

    A chip of the 6500 class compares each sample with the one before, and has neither a duration nor a filter for it:
    at 1 kHz nothing slow is seen, with `cycling` at a few samples a second every change is. The chip must not stream.
    Raises ValueError for what the chip cannot do, ChipUnstable where it does not hold its setting, BusError.
    """
    rows = _rows(variant, _counts(variant, threshold_mg, mg_per_lsb), duration_ms, high_pass_hz)
    chip = status.chip
    with borrowed(chip, rows, clock=clock):
        write_rows(chip, rows)
        sleep_ms(clock, SETTLE_MS + round(1000 * SETTLE_TIMES / high_pass_hz))
        status.take(r.MOT_INT.mask)  # of the filter's settling
        yield Motion(status, rows, clock=clock)


def _counts(variant: Variant, threshold_mg: float, mg_per_lsb: float | None) -> int:
    scale = variant.motion_mg_per_lsb if mg_per_lsb is None else mg_per_lsb
    # `not` refuses NaN too.
    if not scale > 0:
        raise ValueError(f"mg_per_lsb = {scale:g} is no scale: give one above 0")
    if not scale / 2 <= threshold_mg < 255.5 * scale:
        raise ValueError(
            f"threshold_mg = {threshold_mg:g} cannot be set in this chip, an {variant.name}: give {scale:g} to "
            f"{255 * scale:g}"
        )
    return max(1, round(threshold_mg / scale))


def _rows(variant: Variant, counts: int, duration_ms: int, high_pass_hz: float) -> tuple[r.RegisterBits, ...]:
    if not 1 <= duration_ms <= (1 if variant.class_6500 else 255):
        raise ValueError(
            f"duration_ms = {duration_ms} is not possible with this chip, an {variant.name}: "
            + ("it has none, give 1" if variant.class_6500 else "give 1 to 255")
        )
    if high_pass_hz not in HIGH_PASS_HZ:
        raise ValueError(f"high_pass_hz = {high_pass_hz:g} is not possible: take 5, 2.5, 1.25 or 0.63")
    detector: tuple[r.RegisterBits, ...]
    if variant.class_6500:
        detector = (_row(r.ACCEL_INTEL_CTRL, r.ACCEL_INTEL.mask, r.ACCEL_INTEL.mask),)
    else:
        detector = (
            _row(r.ACCEL_CONFIG, r.ACCEL_HPF.encode(1 + HIGH_PASS_HZ.index(high_pass_hz)), r.ACCEL_HPF.mask),
            _row(r.MOT_DUR, duration_ms, 0xFF),
            # A sample below the threshold takes one off the count, and does not begin it anew.
            _row(r.MOT_DETECT_CTRL, r.MOT_COUNT.encode(1), r.MOT_COUNT.mask),
        )
    return (
        _row(r.PWR_MGMT_1, 0, r.DEVICE_RESET.mask | r.SLEEP.mask),
        _row(r.PWR_MGMT_2, 0, r.STBY_ACCEL.mask),
        *detector,
        _row(r.MOT_THR, counts, 0xFF),
        # A pulse for each event, high while it lasts, and the status cleared by nobody but its owner.
        _row(r.INT_PIN_CFG, 0, r.INT_LEVEL.mask | r.INT_OPEN.mask | r.LATCH_INT_EN.mask | r.INT_RD_CLEAR.mask),
        _row(r.INT_ENABLE, r.MOT_EN.mask, r.MOT_EN.mask),
    )


def _row(register: r.Register, set_bits: int, field_bits: int) -> r.RegisterBits:
    return r.RegisterBits(register, set_bits, field_bits & ~set_bits)
