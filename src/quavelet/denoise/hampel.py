"""Impulses replaced, all else left as it is: paper 003's removal of obvious outliers, as a Hampel filter."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from quavelet.core.blocks import FloatArray
from quavelet.core.units import RAD_PER_DEG
from quavelet.denoise.rows import Memory, whole
from quavelet.denoise.signal import odd_window

SIGMA_PER_MAD = 1.4826
GYRO_FLOOR_RAD_S = 0.03 * RAD_PER_DEG
"""About the noise of the gyroscope (PS 6.1: 0.033 deg/s from 1 to 10 Hz): a smaller spread is chance or rounding."""
ACCEL_FLOOR_M_S2 = 0.0235
"""The same for the accelerometer: 400 ug/sqrt(Hz) (PS 6.2) over 36 Hz, where the gyroscope's floor lies, 2.4 mg."""


class HampelFilter:
    """A `RowFilter`: a row that is further than `sigmas` from the median of its window becomes that median.

    The spread is max(1.4826 MAD, floor) of the centred window; it is (window - 1)/2 rows late.
    floor   in the unit of the signal, one number or one for each column

    Memory: arrays[0] the last window - 1 rows.
    """

    def __init__(self, window: int = 5, *, sigmas: float = 4.0, floor: float | Sequence[float] = 0.0) -> None:
        self.window = odd_window(window)
        if not sigmas > 0.0:
            raise ValueError(f"sigmas = {sigmas} does not fit: give a positive number")
        self.sigmas = sigmas
        self.floor = np.asarray(floor, dtype=np.float64)
        self._recent: FloatArray | None = None

    @property
    def delay(self) -> int:
        return self.window // 2

    def push(self, rows: FloatArray) -> FloatArray:
        if not len(rows):
            return rows
        if self._recent is None:
            self._recent = np.repeat(rows[:1], self.window - 1, axis=0)
        seen = np.concatenate([self._recent, rows])
        self._recent = seen[len(rows) :].copy()
        windows = sliding_window_view(seen, self.window, axis=0)
        centre = seen[self.delay : self.delay + len(rows)]
        median: FloatArray = np.median(windows, axis=-1)
        mad = np.median(np.abs(windows - median[..., None]), axis=-1)
        spread = np.maximum(SIGMA_PER_MAD * mad, self.floor)
        return np.where(np.abs(centre - median) > self.sigmas * spread, median, centre)

    def drain(self) -> FloatArray:
        assert self._recent is not None, "nothing to drain: push a row first"
        # A window of one row remembers none and owes none.
        rest = self.push(np.repeat(self._recent[-1:], self.delay, axis=0))
        self._recent = None
        return rest

    def state(self) -> Memory:
        return Memory() if self._recent is None else Memory(arrays=(self._recent.copy(),))

    def restore(self, state: Memory) -> None:
        self._recent = state.arrays[0].copy() if state.arrays else None


def hampel_filter(
    x: FloatArray, window: int = 5, *, sigmas: float = 4.0, floor: float | Sequence[float] = 0.0
) -> FloatArray:
    """`HampelFilter` over a whole signal (N,) or (N, k), each row where it stood. Raises ValueError."""
    return whole(HampelFilter(window, sigmas=sigmas, floor=floor), x)
