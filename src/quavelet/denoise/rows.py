"""The filters that go along with a stream: rows in, as many rows out, later by a fixed number of rows."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from quavelet.core.blocks import FloatArray
from quavelet.denoise.signal import as_columns, like


@dataclass(frozen=True, slots=True, eq=False)
class Memory:
    """All a filter remembers: numbers and arrays, whose meaning each filter states. No arrays: nothing pushed yet."""

    count: int = 0
    arrays: tuple[FloatArray, ...] = ()


class RowFilter(Protocol):
    """Columns are filtered each by itself. The block law holds to the bit.

    A run is what is pushed between two `drain`s. Before its first row, and for `drain` after its last one, the
    signal is taken to stand still: the nearest row is repeated. Nothing outside of a run goes into its rows.
    """

    @property
    def delay(self) -> int:
        """By how many rows the output is later than the input."""
        ...

    def push(self, rows: FloatArray, /) -> FloatArray:
        """(N, k) in, (N, k) out: the output's last row belongs to the input row `delay` rows before the newest.

        The first `delay` rows of a run belong to rows before it, and are to be thrown away.
        """
        ...

    def drain(self) -> FloatArray:
        """The `delay` rows still due, (delay, k); the run is over. Only after a row has been pushed."""
        ...

    def state(self) -> Memory:
        """All memory, as a value."""
        ...

    def restore(self, state: Memory, /) -> None:
        """Go on as if `state` had just been reached."""
        ...


def whole(row_filter: RowFilter, signal: FloatArray) -> FloatArray:
    """A whole signal (N,) or (N, k) through a new filter, each row where its input stood. Raises ValueError."""
    pushed = row_filter.push(as_columns(signal))
    return like(signal, np.concatenate([pushed, row_filter.drain()])[row_filter.delay :])
