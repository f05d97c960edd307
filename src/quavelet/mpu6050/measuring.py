"""Averages of all six axes for self-test and offsets: out of the FIFO, with the chip to ourselves."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass

import numpy as np

from quavelet.core.blocks import CountArray, FloatArray
from quavelet.core.clock import Clock
from quavelet.core.errors import BusError, ChipUnstable
from quavelet.core.units import NS_PER_MS, NS_PER_S
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
RESET_MS = 100
"""RM p. 41: a chip that was reset, by whatever, takes nothing for so long."""
RESET_GIVE_UP_NS = NS_PER_S
_MAX_BAD_ROUNDS = 20
_MAX_LOOKS = 5
_MAX_GIVING_BACK = 5
_SELF_TEST = {field.register: field.mask for field in (r.GYRO_SELF_TEST, r.ACCEL_SELF_TEST)}


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
    write_rows(chip, [wake])
    sleep_ms(clock, PLL_WAIT_MS)
    write_rows(chip, others)
    sleep_ms(clock, SETTLE_WAIT_MS)


def reset_chip(chip: RegisterAccess, *, variant: Variant, clock: Clock) -> None:
    """Reset the chip and wait until it is out of it. Raises ChipUnstable where it does not come out, BusError."""
    chip.write(r.PWR_MGMT_1, r.DEVICE_RESET.mask)
    begin_ns = clock.now_ns()
    while clock.now_ns() - begin_ns < RESET_GIVE_UP_NS:
        sleep_ms(clock, RESET_MS)
        power = chip.read(r.PWR_MGMT_1)
        if not (power ^ variant.pwr_mgmt_1_reset) & variant.pwr_mgmt_1_sure:
            return
    raise ChipUnstable(
        f"the chip at 0x{chip.address:02x} does not come out of its reset: check its supply voltage, then power it off "
        f"and on"
    )


@contextmanager
def borrowed(chip: RegisterAccess, rows: Sequence[r.RegisterBits], *, clock: Clock) -> Iterator[None]:
    """The registers of `rows`, of which PWR_MGMT_1 is the first, are afterwards as they were, read back; but for bits
    of the self-test, which are never left behind. What was in the FIFO is gone.

    Raises BusError and ChipUnstable where that cannot be done: the chip must then be started anew.
    """
    before = [(row.register, read_steadily(chip, row.register, 1)[0]) for row in rows]
    found = [(register, byte & ~_SELF_TEST.get(register, 0)) for register, byte in before]
    try:
        yield
    except BaseException:
        # What went wrong first is what is told.
        with suppress(BusError, ChipUnstable):
            _give_back(chip, found, clock)
        raise
    _give_back(chip, found, clock)


def write_rows(chip: RegisterAccess, rows: Sequence[r.RegisterBits]) -> None:
    """Write rows and read them back. Raises BusError, ChipUnstable where one does not hold."""
    for row in rows:
        chip.apply(row)
    check_rows(chip, rows)


def check_rows(chip: RegisterAccess, rows: Sequence[r.RegisterBits]) -> None:
    """Raises ChipUnstable where a register does not hold what was written, read twice; BusError."""
    wrong = [row.register.name for row in rows if not (_holds(chip, row) or _holds(chip, row))]
    if wrong:
        raise ChipUnstable(
            f"{', '.join(wrong)} of the chip at 0x{chip.address:02x} did not read back as written: check wires and "
            f"supply voltage, then try again"
        )


def _holds(chip: RegisterAccess, row: r.RegisterBits) -> bool:
    return row.holds(chip.read(row.register))


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
    sensors = chip.read(r.FIFO_EN)
    chip.write(r.FIFO_EN, 0)
    status, count = chip.read(r.INT_STATUS), chip.fifo_count()
    # Of other sensors the frames have another length, of which some number fits all the same.
    if sensors != r.FIFO_SENSORS.encode(r.FIFO_ACCEL_TEMP_GYRO):
        return None
    if judge(status, count, fifo_bytes=variant.fifo_bytes) is not Verdict.FRAMES:
        return None
    counts: CountArray = np.frombuffer(chip.read_fifo(count), dtype=">i2").reshape(-1, r.FRAME_BYTES // 2)
    return counts.astype(np.int16)


def _give_back(chip: RegisterAccess, found: Sequence[tuple[r.Register, int]], clock: Clock) -> None:
    for left in reversed(range(_MAX_GIVING_BACK)):
        try:
            # A chip that sleeps takes nothing: it is awake first, and as it was last.
            chip.write(r.PWR_MGMT_1, r.CLKSEL.encode(r.CLOCK_PLL_GYRO_X))
            sleep_ms(clock, PLL_WAIT_MS)
            stop_fifo(chip)
            for register, byte in reversed(found):
                chip.write(register, byte)
            check_rows(chip, [r.RegisterBits(register, byte, ~byte & 0xFF) for register, byte in found])
            return
        except (BusError, ChipUnstable):
            if not left:
                raise
        sleep_ms(clock, RESET_MS)
