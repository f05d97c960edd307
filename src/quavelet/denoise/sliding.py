"""The decimated transform along a stream: a window that moves by 2^J rows gives the offline result.

The decimated transform depends on where its coefficients fall, so the windows must start on multiples of
2^J of the run's rows. A row may be given once every coefficient it is made of has all its input: the last of
a hop when (2^J - 1)(L-1) further rows, rounded down to hops, are there. db3 with 2 levels: hop 4, lag 12 to 15.
"""

from __future__ import annotations

import numpy as np

from quavelet.core.blocks import FloatArray
from quavelet.denoise.offline import Recipe
from quavelet.denoise.rows import Memory
from quavelet.denoise.wavelets import filters, shortest


class SlidingFilter:
    """A `RowFilter` that gives `recipe.apply` of the whole run, late; the recipe must have a fixed threshold.

    Rows come out of the windows by hops, and are handed on one for one, so the delay is lag + hop - 1.

    Memory: count rows so far; arrays[0] the last rows from a multiple of the hop on, arrays[1] rows that are
    done but not yet due.
    """

    def __init__(self, recipe: Recipe) -> None:
        if recipe.threshold is None:
            raise ValueError("a window is too short to find a threshold in: give a recipe with a fixed one")
        self._recipe = recipe
        self._fewest = shortest(recipe.wavelet, recipe.levels)
        reach = (len(filters(recipe.wavelet)) - 1) * ((1 << recipe.levels) - 1)
        self.hop = 1 << recipe.levels
        self.lag = reach // self.hop * self.hop
        self._window = -(-reach // self.hop) * self.hop + self.hop + self.lag
        self._count = 0
        self._seen = self._done = np.empty((0, 0))

    @property
    def delay(self) -> int:
        return self.lag + self.hop - 1

    def push(self, rows: FloatArray) -> FloatArray:
        if not len(rows):
            return rows
        k = rows.shape[1]
        seen = np.concatenate([self._seen, rows]) if self._count else rows
        first = self._count + len(rows) - len(seen)
        done = [self._done if self._count else np.repeat(rows[:1], self.delay, axis=0)]
        count = self._count + len(rows)
        for end in range(self._count // self.hop * self.hop + self.hop, count + 1, self.hop):
            if end >= self.lag + self.hop:
                start = max(0, end - self._window)
                window = self._applied(seen[start - first : end - first])
                done.append(window[end - start - self.lag - self.hop : end - start - self.lag])
        ready = np.concatenate(done)
        keep = max(0, count // self.hop * self.hop - self._window - self.hop)
        self._count, self._seen, self._done = count, seen[keep - first :].copy(), ready[len(rows) :].copy()
        return ready[: len(rows)].reshape(-1, k)

    def drain(self) -> FloatArray:
        """The end of the run is the end of the signal, as offline. Raises ValueError where the run is too short."""
        first = self._count - len(self._seen)
        whole = self._recipe.apply(self._seen)
        due = max(0, self._count - self.delay)
        early = self._done[: max(0, self.delay - self._count)]
        self.restore(Memory())
        return np.concatenate([early, whole[due - first :]])

    def state(self) -> Memory:
        return Memory(self._count, (self._seen.copy(), self._done.copy()) if self._count else ())

    def restore(self, state: Memory) -> None:
        self._count = state.count
        empty = np.empty((0, 0))
        self._seen, self._done = (a.copy() for a in state.arrays) if state.arrays else (empty, empty)

    def _applied(self, window: FloatArray) -> FloatArray:
        """The recipe on a window; a short one is filled up, with rows that do not reach those that are taken."""
        missing = max(0, self._fewest - len(window))
        return self._recipe.apply(np.concatenate([window, np.repeat(window[-1:], missing, axis=0)]))
