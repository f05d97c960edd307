"""Faults of the chip: what can become of it while the wires are well."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from random import Random
from typing import ClassVar, NamedTuple

import numpy as np

from hw_fakes.chip import registers as reg
from hw_fakes.chip.mpu6050 import FakeMpu6050
from hw_fakes.chip.personalities import PERSONALITIES
from hw_fakes.chip.samples import CountArray
from hw_fakes.chip.setup import decode
from hw_fakes.chip.signal_path import MotionSource
from hw_fakes.faults.base import Fault, Touch, check
from quavelet.core.clock import VirtualClock

Spoil = Callable[[CountArray], CountArray]

# The registers a driver sets, of which one changes by itself where none is named.
SETTINGS = (reg.SMPLRT_DIV, reg.CONFIG, reg.GYRO_CONFIG, reg.ACCEL_CONFIG, reg.FIFO_EN, reg.INT_ENABLE)


class Site(NamedTuple):
    """A chip where it sits on the wires; `put` puts another in its place."""

    chip: FakeMpu6050
    put: Callable[[FakeMpu6050], None]


class Struck(NamedTuple):
    """A fault that happened; `undo`, where it lasts, ends it."""

    touch: Touch
    undo: Callable[[], None] | None = None


@dataclass(frozen=True, slots=True)
class ChipFault(Fault):
    """A fault that acts on an MPU-6050."""

    lasts: ClassVar[bool] = False

    def strike(self, site: Site, rng: Random, /) -> Struck | None:
        """Let it happen now; None where it cannot yet, as with an empty FIFO."""
        raise NotImplementedError


@dataclass(frozen=True, slots=True)
class BrownOut(ChipFault):
    """The supply fails for a moment: power-up values, asleep, FIFO empty."""

    name: ClassVar[str] = "brown-out"

    def strike(self, site: Site, _rng: Random, /) -> Struck:
        site.chip.power_cut()
        return Struck(Touch("power-up values, asleep"))


@dataclass(frozen=True, slots=True)
class FallenAsleep(ChipFault):
    """The chip falls asleep: SLEEP is set, all other registers stay."""

    name: ClassVar[str] = "asleep"

    def strike(self, site: Site, _rng: Random, /) -> Struck:
        site.chip.registers[reg.PWR_MGMT_1] |= reg.SLEEP
        return Struck(Touch("SLEEP is set", reg.PWR_MGMT_1, bit=6))


@dataclass(frozen=True, slots=True)
class Changed(ChipFault):
    """One register changes by itself: `register` (one of the settings) becomes `value`, or its `bit` (any) flips."""

    name: ClassVar[str] = "changed"
    register: int | None = None
    bit: int | None = None
    value: int | None = None

    def __post_init__(self) -> None:
        check(self)
        if self.bit is not None and self.value is not None:
            raise ValueError("changed has both bit and value: leave one out")

    def strike(self, site: Site, rng: Random, /) -> Struck:
        registers = site.chip.registers
        register = rng.choice(SETTINGS) if self.register is None else self.register
        kept = reg.REGISTERS[register].sticks or 0xFF
        bit = self.bit
        if self.value is None and bit is None:
            bit = rng.choice([i for i in range(8) if kept >> i & 1])
        was = registers[register]
        registers[register] = self.value if self.value is not None else was ^ 1 << (bit or 0)
        return Struck(Touch(f"0x{was:02x} became 0x{registers[register]:02x}", register, bit=bit))


@dataclass(frozen=True, slots=True)
class FifoSlip(ChipFault):
    """The oldest `bytes` of the FIFO are lost, or doubled where that is below 0."""

    name: ClassVar[str] = "slip"
    bytes: int = 1

    def __post_init__(self) -> None:
        check(self)
        if self.bytes == 0:
            raise ValueError("bytes 0 of slip is no slip: give 1 for a lost byte, -1 for a doubled one")

    def strike(self, site: Site, _rng: Random, /) -> Struck | None:
        fifo, n = site.chip.fifo, abs(self.bytes)
        if len(fifo) < n:
            return None
        if self.bytes > 0:
            del fifo.content[:n]
        else:
            fifo.content[:0] = fifo.content[:n]
            fifo.resize(fifo.size)
        return Struck(Touch(f"{n} bytes {'lost' if self.bytes > 0 else 'doubled'}", reg.FIFO_R_W))


@dataclass(frozen=True, slots=True)
class FifoOverflow(ChipFault):
    """The FIFO overflows as if nobody had read it: full, its head within a frame, the bit in INT_STATUS set."""

    name: ClassVar[str] = "overflow"

    def strike(self, site: Site, _rng: Random, /) -> Struck | None:
        chip, fifo = site.chip, site.chip.fifo
        frame = 2 * len(decode(chip.registers, personality=chip.personality).fifo_words)
        if not frame or len(fifo) < frame:
            return None
        newest = bytes(fifo.content[-frame:])
        while not fifo.push(newest):
            pass
        chip.registers[reg.INT_STATUS] |= reg.FIFO_OFLOW_INT
        return Struck(Touch(f"{fifo.size} bytes, overflow bit set", reg.FIFO_R_W))


@dataclass(frozen=True, slots=True)
class Frozen(ChipFault):
    """Samples go on, their words do not: all are those of the first."""

    name: ClassVar[str] = "frozen"
    lasts: ClassVar[bool] = True

    def strike(self, site: Site, _rng: Random, /) -> Struck:
        held: CountArray | None = None

        def spoil(words: CountArray) -> CountArray:
            nonlocal held
            if held is None:
                held = words[:1].copy()
            return np.repeat(held, len(words), axis=0)

        return Struck(Touch("all words"), _spoilt(site.chip, spoil))


@dataclass(frozen=True, slots=True)
class WrongTemperature(ChipFault):
    """The temperature jumps: `by` degC are added."""

    name: ClassVar[str] = "temperature"
    lasts: ClassVar[bool] = True
    by_degc: float = 40.0

    def strike(self, site: Site, _rng: Random, /) -> Struck:
        added = round(self.by_degc * site.chip.personality.temp_lsb_per_degc)

        def spoil(words: CountArray) -> CountArray:
            wrong = words.copy()
            wrong[:, 3] = np.clip(words[:, 3].astype(np.int64) + added, -32768, 32767)
            return wrong

        return Struck(Touch(f"{self.by_degc:g} degC too much"), _spoilt(site.chip, spoil))


@dataclass(frozen=True, slots=True)
class NoInterrupts(ChipFault):
    """The INT pin stays inactive: its interrupts are lost."""

    name: ClassVar[str] = "int-lost"
    lasts: ClassVar[bool] = True

    def strike(self, site: Site, _rng: Random, /) -> Struck:
        chip = site.chip
        chip.int_connected = False

        def undo() -> None:
            chip.int_connected = True

        return Struck(Touch("INT inactive"), undo)


@dataclass(frozen=True, slots=True)
class Swapped(ChipFault):
    """Another chip sits there, just powered up: of `personality`, with another WHO_AM_I."""

    name: ClassVar[str] = "swapped"
    lasts: ClassVar[bool] = True
    personality: str = "MPU-6500"

    def __post_init__(self) -> None:
        check(self)
        if self.personality not in {p.name for p in PERSONALITIES}:
            names = ", ".join(p.name for p in PERSONALITIES)
            raise ValueError(f"there is no personality '{self.personality}' to swap for: take one of {names}")

    def strike(self, site: Site, _rng: Random, /) -> Struck:
        old = site.chip
        (personality,) = (p for p in PERSONALITIES if p.name == self.personality)
        # Constructed at the birth of the old one: both have the same world's time.
        new = FakeMpu6050(
            VirtualClock(old.birth_ns),
            motion=old.motion,
            imperfections=old.imperfections,
            pll_error=old.pll_error,
            internal_error=old.internal_error,
            seed=old.source.seed if isinstance(old.source, MotionSource) else 0,
            source=None if isinstance(old.source, MotionSource) else old.source,
            personality=personality,
            aux=old.aux,
        )
        new.clock = old.clock
        site.put(new)

        def undo() -> None:
            site.put(old)
            if old.aux:
                old.aux.behind(old.registers)

        return Struck(Touch(f"{personality.name}, 0x{personality.who_am_i:02x}"), undo)


@dataclass(frozen=True, slots=True)
class Unplugged(ChipFault):
    """The wires are off the chip, which goes on for itself."""

    name: ClassVar[str] = "unplugged"
    lasts: ClassVar[bool] = True

    def strike(self, site: Site, _rng: Random, /) -> Struck:
        site.chip.unplug()
        return Struck(Touch("off the wires"), site.chip.plug)


class _Spoilers:
    """Several faults on one chip's words, the oldest first."""

    def __init__(self, first: Spoil | None) -> None:
        self.all = [first] if first else []

    def __call__(self, words: CountArray) -> CountArray:
        for spoil in self.all:
            words = spoil(words)
        return words


def _spoilt(chip: FakeMpu6050, spoil: Spoil) -> Callable[[], None]:
    """Let `spoil` have the chip's words; the way to end that."""
    spoilers = chip.spoil_words if isinstance(chip.spoil_words, _Spoilers) else _Spoilers(chip.spoil_words)
    spoilers.all = [*spoilers.all, spoil]
    chip.spoil_words = spoilers

    def undo() -> None:
        left = [other for other in spoilers.all if other is not spoil]
        chip.spoil_words = spoilers if left else None  # what fell until now still shows what it was taken with
        spoilers.all = left

    return undo


@contextmanager
def seen_at(chip: FakeMpu6050, t_ns: int) -> Iterator[None]:
    """Inside the block it is `t_ns` for the chip, all that fell until then has happened, and all done has effect."""
    clock, chip.clock = chip.clock, VirtualClock(t_ns)
    try:
        chip.int_level()
        yield
        chip.int_level()
    finally:
        chip.clock = clock


CHIP_FAULTS: tuple[type[ChipFault], ...] = (
    BrownOut,
    FallenAsleep,
    Changed,
    FifoSlip,
    FifoOverflow,
    Frozen,
    WrongTemperature,
    NoInterrupts,
    Swapped,
    Unplugged,
)
