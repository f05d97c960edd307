"""Averages of all six axes for self-test and offsets: out of the FIFO, with the chip to ourselves."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

import numpy as np

from quavelet.core.blocks import CountArray, FloatArray
from quavelet.core.clock import Clock
from quavelet.core.errors import BusError, ChipUnstable
from quavelet.core.units import NS_PER_MS
from quavelet.mpu6050 import registers as r
from quavelet.mpu6050.access import RegisterAccess
from quavelet.mpu6050.config import ChipConfig, configuration_table
from quavelet.mpu6050.drain import Verdict, judge
from quavelet.mpu6050.variants import Variant

BYTES_A_MS = 17
"""A round is as long as the FIFO has room for by this, then it is read at rest: 14 bytes at 1 kHz, a fifth to spare."""
PLL_WAIT_MS = 10
SETTLE_WAIT_MS = 100
SHORTEST_MS = 10
_MAX_BAD_ROUNDS = 20
_MAX_LOOKS = 5


@dataclass(frozen=True, slots=True)
class Average:
    """Of one stretch of samples, in counts; accelerometer x y z, then gyroscope x y z.

    mean, sd   (6,)
    at_end     (6,), whether any sample stood at the end of the range
    samples    how many there were
    """

    mean: FloatArray
    sd: FloatArray
    at_end: tuple[bool, ...]
    samples: int


def measuring_config(accel_range_g: int, *, dlpf: int) -> ChipConfig:
    """1 kHz at +-250 deg/s, where the gyroscope resolves most."""
    return ChipConfig(gyro_range_dps=250, accel_range_g=accel_range_g, dlpf=dlpf, sample_rate_hz=1000.0)


def set_up(chip: RegisterAccess, config: ChipConfig, *, variant: Variant, clock: Clock) -> None:
    """Wake and configure the chip, and wait for its sensors. Raises BusError, ChipUnstable where it does not hold."""
    wake, *others = configuration_table(config, variant=variant)
    chip.apply(wake)
    sleep_ms(clock, PLL_WAIT_MS)
    write_rows(chip, others)
    sleep_ms(clock, SETTLE_WAIT_MS)


@contextmanager
def borrowed(chip: RegisterAccess, config: ChipConfig, *, variant: Variant, clock: Clock) -> Iterator[None]:
    """The chip set up for a while, then as it was; what was in its FIFO is gone.

    Raises BusError, after which nobody knows how the chip is set: it must be started anew.
    """
    rows = configuration_table(config, variant=variant)
    before = [(row.register, chip.read(row.register)) for row in rows]
    set_up(chip, config, variant=variant, clock=clock)
    try:
        yield
    finally:
        stop_fifo(chip)
        # Power last, and it is first in the table: a chip that sleeps takes nothing.
        for register, byte in reversed(before):
            chip.write(register, byte)


def write_rows(chip: RegisterAccess, rows: list[r.RegisterBits]) -> None:
    """Write rows and read them back. Raises BusError, ChipUnstable where one does not hold."""
    for row in rows:
        chip.apply(row)
    wrong = [row.register.name for row in rows if not row.holds(chip.read(row.register))]
    if wrong:
        raise ChipUnstable(
            f"{', '.join(wrong)} of the chip at 0x{chip.address:02x} did not read back as written: check wires and "
            f"supply voltage, then try again"
        )


def stop_fifo(chip: RegisterAccess) -> None:
    """Empty the FIFO, and let nothing in."""
    chip.write(r.FIFO_EN, 0)
    chip.write(r.USER_CTRL, 0)
    chip.write(r.USER_CTRL, r.USER_FIFO_RESET.mask)


def average(chip: RegisterAccess, *, variant: Variant, clock: Clock, samples: int) -> Average:
    """The average of at least `samples` samples. Raises BusError, ChipUnstable where the chip gives none."""
    rounds: list[CountArray] = []
    bad, ms = 0, variant.fifo_bytes // BYTES_A_MS
    while sum(map(len, rounds)) < samples:
        counts = _one_round(chip, variant, clock, ms)
        if counts is None:
            # The host may have slept too long, or a clone's FIFO be smaller than its kind's.
            bad, ms = bad + 1, max(ms // 2, SHORTEST_MS)
        else:
            rounds.append(counts)
        if bad > _MAX_BAD_ROUNDS:
            raise ChipUnstable(
                f"the chip at 0x{chip.address:02x} does not fill its FIFO with whole samples: power it off and on, "
                f"and stop other programs that use it"
            )
    axes = np.delete(np.concatenate(rounds), 3, axis=1)
    at_end = (axes == -32768) | (axes == 32767)
    return Average(
        mean=axes.mean(axis=0),
        sd=axes.std(axis=0),
        at_end=tuple(at_end.any(axis=0).tolist()),
        samples=len(axes),
    )


def read_steadily(chip: RegisterAccess, register: r.Register, n: int) -> bytes:
    """`n` bytes from the register on, read until they come twice alike: I2C has no checksum.

    Raises BusError, also where they never do.
    """
    last = chip.read_run(register, n)
    for _ in range(_MAX_LOOKS):
        now = chip.read_run(register, n)
        if now == last:
            return now
        last = now
    raise BusError(
        f"{register.name} of the chip at 0x{chip.address:02x} reads differently each time: check wires and pull-ups",
        address=chip.address,
        register=register.address,
        attempts=_MAX_LOOKS + 1,
    )


def sleep_ms(clock: Clock, ms: int) -> None:
    clock.sleep_until_ns(clock.now_ns() + ms * NS_PER_MS)


def _one_round(chip: RegisterAccess, variant: Variant, clock: Clock, ms: int) -> CountArray | None:
    chip.restart_fifo()
    sleep_ms(clock, ms)
    chip.write(r.FIFO_EN, 0)
    status, count = chip.read(r.INT_STATUS), chip.fifo_count()
    if judge(status, count, fifo_bytes=variant.fifo_bytes) is not Verdict.FRAMES:
        return None
    counts: CountArray = np.frombuffer(chip.read_fifo(count), dtype=">i2").reshape(-1, r.FRAME_BYTES // 2)
    return counts.astype(np.int16)
