"""What a fault is: a small piece of data with a name; and what it touched when it happened."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from random import Random
from typing import ClassVar

from hw_fakes.chip import registers as reg

PORTS = (reg.MEM_R_W, reg.FIFO_R_W)  # the pointer stays there

_LEAST_AND_MOST = {
    "register": (0, reg.COUNT - 1),
    "value": (0, 0xFF),
    "bit": (0, 7),
    "byte": (0, 8191),
    "keep": (0, 8191),
    "lost": (1, 1024),
    "bytes": (-1024, 1024),
}


@dataclass(frozen=True, slots=True)
class Fault:
    """One kind of fault with what is to be said about it; `fault_plan.FaultEntry` says when.

    name   in the text form
    lasts  whether it can have a duration; the others are over as soon as they have happened

    Raises ValueError for a number that makes no sense.
    """

    name: ClassVar[str]
    lasts: ClassVar[bool] = True

    def __post_init__(self) -> None:
        check(self)

    @classmethod
    def does(cls) -> str:
        """One line on what it does."""
        return (cls.__doc__ or "").partition("\n")[0]


def check(fault: Fault) -> None:
    """Raises ValueError for a field out of its range."""
    for field in fields(fault):
        value = getattr(fault, field.name)
        if value is None:
            continue
        if field.name in _LEAST_AND_MOST:
            least, most = _LEAST_AND_MOST[field.name]
            if not least <= value <= most:
                raise ValueError(f"{field.name} {value} of {fault.name} is not from {least} to {most}")
        elif field.name.endswith("_s") and not 0 < value < math.inf:
            raise ValueError(f"{field.name} {value} of {fault.name} is not a time above 0")
        elif isinstance(value, float) and not math.isfinite(value):
            raise ValueError(f"{field.name} {value} of {fault.name} is not a number to work with")


@dataclass(frozen=True, slots=True)
class Touch:
    """What a fault did: in words, and where it was one place, which.

    register  of the chip
    byte      its number in what was read or written, from 0; of a write the register number itself is not counted
    bit       from 0, the lowest
    """

    what: str
    register: int | None = None
    byte: int | None = None
    bit: int | None = None


@dataclass(frozen=True, slots=True)
class Happened:
    """A fault that happened, at clock time `t_ns` to the chip or the transfer at `address`."""

    t_ns: int
    kind: Fault
    address: int
    touch: Touch


def registers_from(pointer: int | None, n: int) -> list[int | None]:
    """The registers that `n` bytes from `pointer` on belong to; None where the pointer is not known."""
    found: list[int | None] = []
    for _ in range(n):
        found.append(pointer)
        if pointer is not None and pointer not in PORTS:
            pointer = (pointer + 1) % reg.COUNT
    return found


def one_of(places: list[int], rng: Random) -> int | None:
    """A place, None where there is none."""
    return rng.choice(places) if places else None
