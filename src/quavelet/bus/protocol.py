"""What a driver needs of the wires: to move bytes to and from an address, and to hear of a pulse."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from types import TracebackType
from typing import Protocol, Self, runtime_checkable

from quavelet.core.blocks import FloatArray, IntArray
from quavelet.core.instruction import Instruction


class I2CBus(Protocol):
    """An I2C bus. Every failure is a `BusError` or a kind of it; a transfer of no bytes is a ValueError.

    `name` is what the bus was opened by ("linux:1", "fake:tilt"); it goes into every output as `src`.
    """

    @property
    def name(self) -> str: ...

    def write(self, address: int, data: bytes) -> None:
        """One transaction: START, address, all bytes of `data`, STOP. `data` is not empty."""
        ...

    def write_read(self, address: int, data: bytes, n: int) -> bytes:
        """One transaction: write `data`, repeated START, read `n` bytes (1 to 8192), STOP."""
        ...

    def close(self) -> None:
        """Let go of the bus; a closed bus refuses every transfer. May be called twice."""
        ...

    def __enter__(self) -> Self: ...

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None, /
    ) -> None: ...


@dataclass(frozen=True, slots=True)
class Edge:
    """The line became active.

    t_ns   when, CLOCK_MONOTONIC, taken in the interrupt and not when somebody got round to it
    seq    1, 2, 3, ... since the line was opened; a missing number is an edge that found no room while nobody asked
    """

    t_ns: int
    seq: int


class DataReady(Protocol):
    """A wire from the chip's INT pin, which gives a pulse with each sample. Every failure is a `BusError`.

    `name` is what the line was opened by ("pinctrl-rp1:17").
    """

    @property
    def name(self) -> str: ...

    def wait(self, timeout_s: float) -> list[Edge]:
        """All edges since the last call, oldest first, as soon as there is one; none after `timeout_s` >= 0."""
        ...

    def close(self) -> None:
        """Let go of the line; a closed one refuses to wait. May be called twice."""
        ...

    def __enter__(self) -> Self: ...

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None, /
    ) -> None: ...


@runtime_checkable
class HasDataReady(Protocol):
    """A bus that has pins of its own, to which the INT pins of its chips go: no other line belongs to them."""

    def data_ready(self, name: str, /, *, address: int) -> DataReady:
        """The line called `name` from the chip at `address`. Raises SettingsError where there is none."""
        ...


@runtime_checkable
class FollowsInstructions(Protocol):
    """A bus whose board does by itself what a person at the bench is asked to do with it: no real one."""

    def follow(self, instruction: Instruction, /) -> None:
        """Begin to do it now; it takes as long as it takes a person."""
        ...


@dataclass(frozen=True, slots=True)
class OfferedFault:
    """A fault that can be ordered.

    name   one word
    title  what happens, in words for somebody who knows nothing of the wires
    text   what `FailsOnOrder.fail` takes
    """

    name: str
    title: str
    text: str


@dataclass(frozen=True, slots=True)
class OrderedFault:
    """What has become of an order; times of the bus's clock.

    n         the number that `FailsOnOrder.fail` gave
    began_ns  when it first touched a transfer or the chip, None while it has not
    ended_ns  when it was over, None while it is not; of one that touched nothing, when it would have been
    """

    n: int
    text: str
    began_ns: int | None = None
    ended_ns: int | None = None


@runtime_checkable
class FailsOnOrder(Protocol):
    """A bus on which something can be made to go wrong: no real one. All methods may be called on any thread, and
    return at once."""

    def faults(self) -> Sequence[OfferedFault]:
        """What it offers."""
        ...

    def fail(self, text: str, /) -> int:
        """Let it go wrong with the next transfer; gives the order's number.

        Raises SettingsError for a text that is no fault, or one that is not for now.
        """
        ...

    def ordered(self) -> Sequence[OrderedFault]:
        """What has become of the orders that were taken up by a transfer, the oldest first; old ones are forgotten."""
        ...


@runtime_checkable
class KnowsTruth(Protocol):
    """A bus that knows how its board really lies: no real one."""

    def attitude(self, t_ns: IntArray, /) -> FloatArray:
        """Body (as the chip has it) to world, (N, 4) at times (N,) of the bus's clock; NaN where it is not known. May
        be called on any thread."""
        ...
