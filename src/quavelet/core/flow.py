"""The protocols of the flow: where blocks come from, what changes them, where they go."""

from __future__ import annotations

from typing import Protocol, TypeVar

from quavelet.core.blocks import AttitudeBlock, Block, ImuBlock, RawBlock

In = TypeVar("In", bound=Block, contravariant=True)
Out = TypeVar("Out", bound=Block, covariant=True)
State = TypeVar("State")


class BlockSource(Protocol):
    """Where raw blocks come from: the chip, or a recording that stands in for it."""

    def read(self) -> RawBlock | None:
        """What has come since the last call, possibly no rows; None once there will be nothing more."""
        ...


class Stage(Protocol[In, Out, State]):
    """Block in, block out, memory in a visible state.

    Law: splitting a block anywhere, and saving and restoring the state in between, gives bit-identical
    output.
    """

    def process(self, block: In, /) -> Out:
        """The output for these rows."""
        ...

    def state(self) -> State:
        """All memory, as an immutable value."""
        ...

    def restore(self, state: State, /) -> None:
        """Go on as if `state` had just been reached."""
        ...


class AttitudeFilter(Stage[ImuBlock, AttitudeBlock, State], Protocol[State]):
    """A stage that gives attitude."""

    def count_yaw_anew(self) -> None:
        """Sigma of yaw is from the next row on what grows from the last one on; for between two blocks. The attitude
        stays as it is."""
        ...


class Sink(Protocol):
    """An output. It runs on its own thread, never on the loop's."""

    def write(self, block: AttitudeBlock, /) -> None:
        """Put out these rows."""
        ...

    def close(self) -> None:
        """Finish what is begun."""
        ...
