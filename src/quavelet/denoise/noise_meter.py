"""The noise's sigma along a stream, from the wavelet details themselves."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from quavelet.core.blocks import FloatArray
from quavelet.denoise.thresholds import mad_sigma

WINDOW = 512
"""Details that sigma is the MAD of: it is then good to about 5 % (1.17/sqrt(n))."""
EVERY = 64
"""Rows between two looks. Counted over the whole stream, so that blocks have no part in it."""


class NoiseMeter:
    """Sigma for each column and level; 0, that is unknown, for the first `EVERY` rows."""

    def __init__(self, levels: int) -> None:
        self.levels = levels
        self._count = 0
        self._sigma: FloatArray | None = None
        self._recent: FloatArray | None = None

    def follow(self, details: Sequence[FloatArray]) -> FloatArray:
        """The details of each level (N, k); sigma (levels, N, k) as it was known when each row came."""
        new = np.stack(details)
        levels, n, k = new.shape
        sigma = np.empty_like(new)
        if self._sigma is None or self._recent is None:
            self._sigma, self._recent = np.zeros((levels, k)), np.empty((levels, 0, k))
        start = 0
        while start < n:
            end = min(n, start + EVERY - self._count)
            sigma[:, start:end] = self._sigma[:, None]
            self._recent = np.concatenate([self._recent, new[:, start:end]], axis=1)[:, -WINDOW:]
            self._count += end - start
            if self._count == EVERY:
                self._count = 0
                self._sigma = np.stack([mad_sigma(level) for level in self._recent])
            start = end
        return sigma

    def held(self, n: int, k: int) -> FloatArray:
        """Sigma (levels, n, k) as it is known, for rows that are not to be measured."""
        sigma = np.zeros((self.levels, k)) if self._sigma is None else self._sigma
        return np.repeat(sigma[:, None], n, axis=1)

    def state(self) -> tuple[int, tuple[FloatArray, ...]]:
        """The count since the last look, and sigma and recent details where there are any."""
        if self._sigma is None or self._recent is None:
            return 0, ()
        return self._count, (self._sigma.copy(), self._recent.copy())

    def restore(self, count: int, arrays: Sequence[FloatArray]) -> None:
        self._count = count
        self._sigma, self._recent = arrays if arrays else (None, None)
