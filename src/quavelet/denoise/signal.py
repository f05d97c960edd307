"""What every function here takes: an array of one or more columns, all of it finite."""

from __future__ import annotations

import numpy as np

from quavelet.core.blocks import FloatArray


def as_columns(signal: FloatArray) -> FloatArray:
    """The signal (N,) or (N, k) as (N, k) float64. Raises ValueError where it is empty or not finite."""
    x = np.asarray(signal, dtype=np.float64)
    if x.ndim not in (1, 2) or x.size == 0:
        raise ValueError(f"a signal of shape {x.shape} does not fit: give (N,) or (N, k), N at least 1")
    x = x.reshape(len(x), -1)
    check_finite(x)
    return x


def check_finite(rows: FloatArray) -> None:
    """Raises ValueError that names the first row of (N, k) which is not finite: one would spoil all after it."""
    finite = np.isfinite(rows)
    if not finite.all():
        row = int(np.argmin(finite.all(axis=1)))
        raise ValueError(f"row {row} is not finite: leave such samples out, and treat what is left as having a gap")


def like(signal: FloatArray, columns: FloatArray) -> FloatArray:
    """The columns in the shape the signal came in."""
    return columns[:, 0] if np.ndim(signal) == 1 else columns


def odd_window(window: int) -> int:
    """The window, if it has a middle. Raises ValueError otherwise."""
    if window < 1 or window % 2 == 0:
        raise ValueError(f"window = {window} has no middle: give an odd number of samples")
    return window
