"""Faults of the wires: what can become of a transfer."""

from __future__ import annotations

import errno
from dataclasses import dataclass
from random import Random
from typing import ClassVar, NamedTuple

from hw_fakes.chip import registers as reg
from hw_fakes.faults.base import Fault, Touch, check, one_of, registers_from


class Refusal(NamedTuple):
    """A message comes to nothing: `errno`, or None for what the adapter tells a missing acknowledge as."""

    errno: int | None
    touch: Touch
    held_s: float = 0.0


class Spoilt(NamedTuple):
    """The bytes as they are after the fault; `cut`: the next byte of a write is not acknowledged."""

    data: bytes
    touch: Touch
    cut: bool = False


class Break(NamedTuple):
    """A read breaks before `byte`; it goes on after `later_s`, or `lost` bytes further on."""

    byte: int
    later_s: float
    lost: int
    touch: Touch


@dataclass(frozen=True, slots=True)
class WireFault(Fault):
    """A fault that acts on transfers; each method gives None where it lets them through.

    once  it acts on one message of a transfer at most
    """

    once: ClassVar[bool] = True

    def refuse(self) -> Refusal | None:
        """What becomes of a message before its address is acknowledged."""
        return None

    def spoil_write(self, _data: bytes, _rng: Random, /) -> Spoilt | None:
        """What reaches the chip of a write message, its register number first."""
        return None

    def split(self, _registers: list[int | None], _rng: Random, /) -> Break | None:
        """Where a read of these registers breaks."""
        return None

    def spoil_read(self, _data: bytes, _registers: list[int | None], _rng: Random, /) -> Spoilt | None:
        """What arrives of a read message."""
        return None

    def stretch(self) -> float:
        """How many times its time a transfer takes."""
        return 1.0


@dataclass(frozen=True, slots=True)
class NotAcknowledged(WireFault):
    """The address is not acknowledged, though the chip is there."""

    name: ClassVar[str] = "nack"

    def refuse(self) -> Refusal:
        return Refusal(None, Touch("not acknowledged"))


@dataclass(frozen=True, slots=True)
class TimedOut(WireFault):
    """SDA is held low: a transfer with any address ends with ETIMEDOUT after `takes` s (1, as on a Raspberry Pi)."""

    name: ClassVar[str] = "time-out"
    takes_s: float = 1.0

    def refuse(self) -> Refusal:
        return Refusal(errno.ETIMEDOUT, Touch(f"ETIMEDOUT after {self.takes_s:g} s"), self.takes_s)


@dataclass(frozen=True, slots=True)
class InputOutputError(WireFault):
    """The transfer ends with EIO."""

    name: ClassVar[str] = "eio"

    def refuse(self) -> Refusal:
        return Refusal(errno.EIO, Touch("EIO"))


@dataclass(frozen=True, slots=True)
class LostArbitration(WireFault):
    """The adapter loses the wires to another master: the transfer ends with EAGAIN."""

    name: ClassVar[str] = "arbitration"

    def refuse(self) -> Refusal:
        return Refusal(errno.EAGAIN, Touch("EAGAIN"))


@dataclass(frozen=True, slots=True)
class FlippedRead(WireFault):
    """One bit of what is read arrives wrong: of `register`, number `byte` of the read, `bit`, or any."""

    name: ClassVar[str] = "flip"
    register: int | None = None
    byte: int | None = None
    bit: int | None = None

    def spoil_read(self, data: bytes, registers: list[int | None], rng: Random, /) -> Spoilt | None:
        places = [
            i for i, r in enumerate(registers) if self.register in (None, r) and (self.byte is None or i == self.byte)
        ]
        return _flipped(data, one_of(places, rng), self.bit, registers, rng)


@dataclass(frozen=True, slots=True)
class FlippedWrite(WireFault):
    """One bit of a written value reaches the chip wrong: of `register`, `bit`, or any."""

    name: ClassVar[str] = "flip-write"
    register: int | None = None
    bit: int | None = None

    def spoil_write(self, data: bytes, rng: Random, /) -> Spoilt | None:
        if len(data) < 2:
            return None
        registers = registers_from(data[0] & 0x7F, len(data) - 1)
        place = one_of([i for i, r in enumerate(registers) if self.register in (None, r)], rng)
        spoilt = _flipped(data[1:], place, self.bit, registers, rng)
        return spoilt and Spoilt(data[:1] + spoilt.data, spoilt.touch)


@dataclass(frozen=True, slots=True)
class CutWrite(WireFault):
    """A write is cut: the first `keep` of its values (half of them) reach the chip, the next is not acknowledged."""

    name: ClassVar[str] = "cut-write"
    keep: int | None = None

    def spoil_write(self, data: bytes, _rng: Random, /) -> Spoilt | None:
        values = len(data) - 1
        keep = values // 2 if self.keep is None else self.keep
        if keep >= values:
            return None
        return Spoilt(data[: 1 + keep], Touch(f"cut after {keep} of {values} values", byte=keep), cut=True)


@dataclass(frozen=True, slots=True)
class Torn(WireFault):
    """A read breaks before `byte` (any) and goes on with registers `later` s later, with the FIFO `lost` bytes on."""

    name: ClassVar[str] = "torn"
    byte: int | None = None
    later_s: float = 0.01
    lost: int = 1

    def split(self, registers: list[int | None], rng: Random, /) -> Break | None:
        byte = one_of([i for i in range(1, len(registers)) if self.byte in (None, i)], rng)
        if byte is None:
            return None
        register = registers[byte]
        if register == reg.FIFO_R_W:
            return Break(byte, 0.0, self.lost, Touch(f"{self.lost} bytes of the FIFO lost", register, byte))
        return Break(byte, self.later_s, 0, Touch(f"went on {self.later_s:g} s later", register, byte))


@dataclass(frozen=True, slots=True)
class Garbage(WireFault):
    """What is read arrives as noise from number `byte` (any) on."""

    name: ClassVar[str] = "garbage"
    byte: int | None = None

    def spoil_read(self, data: bytes, registers: list[int | None], rng: Random, /) -> Spoilt | None:
        byte = one_of([i for i in range(len(data)) if self.byte in (None, i)], rng)
        if byte is None:
            return None
        return Spoilt(data[:byte] + rng.randbytes(len(data) - byte), Touch("noise", registers[byte], byte))


@dataclass(frozen=True, slots=True)
class AllZero(WireFault):
    """All that is read arrives as 0x00."""

    name: ClassVar[str] = "zeros"
    once: ClassVar[bool] = False

    def spoil_read(self, data: bytes, _registers: list[int | None], _rng: Random, /) -> Spoilt | None:
        return Spoilt(bytes(len(data)), Touch("all 0x00")) if data else None


@dataclass(frozen=True, slots=True)
class AllOnes(WireFault):
    """All that is read arrives as 0xFF."""

    name: ClassVar[str] = "ones"
    once: ClassVar[bool] = False

    def spoil_read(self, data: bytes, _registers: list[int | None], _rng: Random, /) -> Spoilt | None:
        return Spoilt(b"\xff" * len(data), Touch("all 0xff")) if data else None


@dataclass(frozen=True, slots=True)
class SlowWires(WireFault):
    """The chip stretches the clock: a transfer takes `factor` times its time."""

    name: ClassVar[str] = "slow"
    factor: float = 4.0

    def __post_init__(self) -> None:
        check(self)
        if self.factor <= 1:
            raise ValueError(f"factor {self.factor:g} of slow is not above 1")

    def stretch(self) -> float:
        return self.factor


def _flipped(
    data: bytes, place: int | None, bit: int | None, registers: list[int | None], rng: Random
) -> Spoilt | None:
    if place is None:
        return None
    bit = rng.randrange(8) if bit is None else bit
    spoilt = bytearray(data)
    spoilt[place] ^= 1 << bit
    return Spoilt(bytes(spoilt), Touch(f"0x{data[place]:02x} for 0x{spoilt[place]:02x}", registers[place], place, bit))


WIRE_FAULTS: tuple[type[WireFault], ...] = (
    NotAcknowledged,
    TimedOut,
    InputOutputError,
    LostArbitration,
    FlippedRead,
    FlippedWrite,
    CutWrite,
    Torn,
    Garbage,
    AllZero,
    AllOnes,
    SlowWires,
)
