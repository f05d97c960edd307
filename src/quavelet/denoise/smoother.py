"""Weighted least squares with forgetting: a straight line through the past, the newest counting most (paper 003).

The line y = c0 + c1 t that minimises S = sum lambda^(m-i) r_i^2 (equation 2) over a run's rows, its value at
the newest row. No row is waited for, and a ramp comes out without lag.
"""

from __future__ import annotations

from math import sqrt

import numpy as np

from quavelet.core.blocks import FloatArray
from quavelet.denoise.rows import Memory, whole


def noise_gain(forgetting: float) -> float:
    """Sigma out over sigma in for white noise, after the start: 0.713 at 0.6, 0.504 at 0.8.

    From the weights of the line's value at the newest row: sqrt((1-l)(1+4l+5l^2)/(1+l)^3).
    """
    f = _checked(forgetting)
    return sqrt((1.0 - f) * (1.0 + 4.0 * f + 5.0 * f * f) / (1.0 + f) ** 3)


class LineSmoother:
    """A `RowFilter` without delay, exact from the first row on: with n rows it is the weighted fit to those n.

    Recursive: the newest row's difference from the line moves level and slope by gains from the normal
    matrix; they settle at 1 - lambda^2 and (1 - lambda)^2. (For n = 1 the line is level.)

    Memory: count rows so far; arrays[0] level, arrays[1] slope a row, arrays[2] the normal matrix's sums
    lambda^i, i lambda^i, i^2 lambda^i over the rows' ages i.
    """

    def __init__(self, forgetting: float = 0.6) -> None:
        self.forgetting = _checked(forgetting)
        self._count = 0
        self._level: list[float] = []
        self._slope: list[float] = []
        self._sums = [0.0, 0.0, 0.0]

    @property
    def delay(self) -> int:
        return 0

    def push(self, rows: FloatArray) -> FloatArray:
        if not len(rows):
            return rows
        if self._count == 0:
            self._level, self._slope = rows[0].tolist(), [0.0] * rows.shape[1]
        gains = [self._next_gains() for _ in range(len(rows))]
        out = np.empty_like(rows)
        for column, values in enumerate(rows.T.tolist()):
            out[:, column] = self._along(column, values, gains)
        return out

    def drain(self) -> FloatArray:
        nothing = np.empty((0, len(self._level)))
        self.restore(Memory())
        return nothing

    def state(self) -> Memory:
        if self._count == 0:
            return Memory()
        return Memory(self._count, (np.array(self._level), np.array(self._slope), np.array(self._sums)))

    def restore(self, state: Memory) -> None:
        self._count = state.count
        arrays = (a.tolist() for a in state.arrays) if state.count else ([], [], [0.0, 0.0, 0.0])
        self._level, self._slope, self._sums = arrays

    def _along(self, column: int, values: list[float], gains: list[tuple[float, float]]) -> list[float]:
        level, slope, out = self._level[column], self._slope[column], []
        for value, (to_level, to_slope) in zip(values, gains, strict=True):
            level += slope
            error = value - level
            level += to_level * error
            slope += to_slope * error
            out.append(level)
        self._level[column], self._slope[column] = level, slope
        return out

    def _next_gains(self) -> tuple[float, float]:
        f, (s0, s1, s2) = self.forgetting, self._sums
        s0, s1, s2 = 1.0 + f * s0, f * (s1 + s0), f * (s2 + 2.0 * s1 + s0)
        self._sums = [s0, s1, s2]
        self._count += 1
        if self._count == 1:
            return 1.0, 0.0
        determinant = s0 * s2 - s1 * s1
        return s2 / determinant, s1 / determinant


def smooth(x: FloatArray, *, forgetting: float = 0.6) -> FloatArray:
    """`LineSmoother` over a whole signal (N,) or (N, k). Raises ValueError."""
    return whole(LineSmoother(forgetting), x)


def _checked(forgetting: float) -> float:
    if not 0.0 < forgetting < 1.0:
        raise ValueError(
            f"forgetting = {forgetting} does not fit: give a number between 0 and 1, the larger the smoother"
        )
    return forgetting
