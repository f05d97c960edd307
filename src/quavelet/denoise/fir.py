"""The approximation alone, as one symmetric filter: no threshold, nothing that depends on the signal."""

from __future__ import annotations

import numpy as np

from quavelet.core.blocks import FloatArray
from quavelet.denoise.rows import Memory
from quavelet.denoise.wavelets import filters


def approximation_taps(wavelet: str = "db3", levels: int = 2) -> FloatArray:
    """The filter that the undecimated A_J alone is: each level gives 1/2 dec_lo * rec_lo, its taps 2^(j-1) apart.

    db3 with 2 levels: 31 taps, -3 dB at 0.106 of the sample rate, white noise to 0.460 of its sigma.
    """
    f = filters(wavelet)
    pair = 0.5 * np.convolve(f.dec_lo, f.rec_lo)
    taps = np.ones(1)
    for i in range(levels):
        spread = np.zeros(((len(pair) - 1) << i) + 1)
        spread[:: 1 << i] = pair
        taps = np.convolve(taps, spread)
    return taps


class FirFilter:
    """A `RowFilter`: symmetric taps, an odd number of them, that sum to 1; late by half of them.

    Memory: arrays[0] the last rows, one fewer than there are taps.
    """

    def __init__(self, taps: FloatArray) -> None:
        self._taps = np.asarray(taps, dtype=np.float64)
        if self._taps.ndim != 1 or len(self._taps) % 2 == 0 or not np.allclose(self._taps, self._taps[::-1]):
            raise ValueError("these taps have no middle: give an odd number of them, the same from both ends")
        self._recent: FloatArray | None = None

    @property
    def delay(self) -> int:
        return len(self._taps) // 2

    def push(self, rows: FloatArray) -> FloatArray:
        n, taps = len(rows), self._taps
        if not n:
            return rows
        if self._recent is None:
            self._recent = np.repeat(rows[:1], len(taps) - 1, axis=0)
        seen = np.concatenate([self._recent, rows])
        self._recent = seen[n:].copy()
        # Tap by tap: a matrix product may round differently by the block's length.
        out: FloatArray = taps[0] * seen[:n]
        for i in range(1, len(taps)):
            out += taps[i] * seen[i : i + n]
        return out

    def drain(self) -> FloatArray:
        assert self._recent is not None, "nothing to drain: push a row first"
        rest = self.push(np.repeat(self._recent[-1:], self.delay, axis=0))
        self._recent = None
        return rest

    def state(self) -> Memory:
        return Memory() if self._recent is None else Memory(arrays=(self._recent.copy(),))

    def restore(self, state: Memory) -> None:
        self._recent = state.arrays[0].copy() if state.arrays else None
