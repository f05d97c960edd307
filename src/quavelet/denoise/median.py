"""The median of a moving window, paper 004's answer to impulses."""

from __future__ import annotations

from bisect import bisect_left, insort

import numpy as np

from quavelet.core.blocks import FloatArray
from quavelet.denoise.rows import Memory, whole
from quavelet.denoise.signal import odd_window


class MedianFilter:
    """A `RowFilter`: the median of the last `window` rows (odd), which is the centred one (window - 1)/2 rows late.

    An impulse of up to (window - 1)/2 rows leaves no trace, a step stays where it was.
    The window is kept sorted. Memory: arrays[0] its rows (window, k) in the order of time.
    """

    def __init__(self, window: int) -> None:
        self.window = odd_window(window)
        self._recent: FloatArray | None = None
        self._sorted: list[list[float]] = []

    @property
    def delay(self) -> int:
        return self.window // 2

    def push(self, rows: FloatArray) -> FloatArray:
        if not len(rows):
            return rows
        if self._recent is None:
            self._remember(np.repeat(rows[:1], self.window, axis=0))
        assert self._recent is not None
        seen = np.concatenate([self._recent, rows])
        out = np.empty_like(rows)
        for column, window in enumerate(self._sorted):
            out[:, column] = self._medians(window, seen[:, column].tolist())
        self._recent = seen[-self.window :].copy()
        return out

    def drain(self) -> FloatArray:
        assert self._recent is not None, "nothing to drain: push a row first"
        rest = self.push(np.repeat(self._recent[-1:], self.delay, axis=0))
        self.restore(Memory())
        return rest

    def state(self) -> Memory:
        return Memory() if self._recent is None else Memory(arrays=(self._recent.copy(),))

    def restore(self, state: Memory) -> None:
        if state.arrays:
            self._remember(state.arrays[0].copy())
        else:
            self._recent, self._sorted = None, []

    def _remember(self, recent: FloatArray) -> None:
        self._recent = recent
        self._sorted = [sorted(column) for column in recent.T.tolist()]

    def _medians(self, window: list[float], values: list[float]) -> list[float]:
        """The medians as `window`, sorted, moves over all but the first of its length in `values`."""
        middle, out = self.window // 2, []
        for oldest, newest in zip(values, values[self.window :], strict=False):
            del window[bisect_left(window, oldest)]
            insort(window, newest)
            out.append(window[middle])
        return out


def median_filter(x: FloatArray, window: int) -> FloatArray:
    """The centred median of (N,) or (N, k) along the first axis, the ends repeated beyond themselves.

    Raises ValueError for an even window and for values that are not finite.
    """
    return whole(MedianFilter(window), x)
