"""Square roots of a covariance in plain floats: P = D D^T, so that P stays a covariance whatever the rounding.

Two kinds, for the two filters of paper 003. The lower-triangular root ("rows", row i has i + 1 numbers) is kept so by
Givens rotations and by Carlson's form of the measurement update; the full root by Potter's. Both leave what the
Joseph form leaves.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import hypot, sqrt

Rows = list[list[float]]
"""A square root by rows; a lower-triangular one holds only what is left of its diagonal, and that."""
Frozen = tuple[tuple[float, ...], ...]
"""The same as a value."""


def diagonal_root(sigmas: Sequence[float]) -> Frozen:
    """The lower-triangular root of a covariance without correlations."""
    return tuple((0.0,) * i + (sigma,) for i, sigma in enumerate(sigmas))


def frozen(rows: Rows) -> Frozen:
    """`rows` as a value."""
    return tuple(map(tuple, rows))


def thawed(root: Frozen) -> Rows:
    """Rows that can be changed."""
    return list(map(list, root))


def sigma(row: Sequence[float]) -> float:
    """One sigma of the state that this row of a root belongs to."""
    return hypot(*row)


def add_noise(rows: Rows, i: int, sd: float) -> None:
    """P grows by sd^2 in state i: a rank-one update by Givens rotations, from column i on."""
    n = len(rows)
    added = [0.0] * n
    added[i] = sd
    for k in range(i, n):
        row, v = rows[k], added[k]
        r = hypot(row[k], v)
        if r == 0.0:
            continue
        c, s = row[k] / r, v / r
        row[k] = r
        for j in range(k + 1, n):
            below, w = rows[j], added[j]
            t = below[k]
            below[k], added[j] = c * t + s * w, c * w - s * t


def isolate(rows: Rows, i: int, sd: float) -> None:
    """State i has this sigma from here on and goes with no other; the others keep theirs, and their correlation
    with those before i."""
    rows[i] = [0.0] * i + [sd]
    for row in rows[i + 1 :]:
        row[-1], row[i] = hypot(row[-1], row[i]), 0.0


def measure(rows: Rows, m: int, variance: float) -> list[float]:
    """State m itself was measured with this variance: P becomes (I - K h^T) P, by Carlson's triangular form.

    Returns the gain K, one number a state: what a residual of 1 moves it by.
    """
    n = len(rows)
    phi = rows[m][:]
    gain = [0.0] * n
    alpha = variance
    for j in range(m, -1, -1):
        f = phi[j]
        before, alpha = alpha, alpha + f * f
        keep, take = sqrt(before / alpha), f / sqrt(before * alpha)
        for i in range(j, n):
            row, e = rows[i], gain[i]
            t = row[j]
            row[j], gain[i] = keep * t - take * e, e + t * f
    return [e / alpha for e in gain]


def potter(rows: Rows, h: Sequence[float], variance: float, forgetting: float = 1.0) -> list[float]:
    """The scalar measurement h . x with this variance, on a full root, by Potter's form; returns the gain K.

    P becomes (I - K h^T) P / forgetting with K = P h / (h^T P h + forgetting variance): recursive least squares
    that forgets. With several scalars a time step, `forgetting` goes with the first.
    """
    n = len(rows)
    phi = [sum(rows[i][j] * h[i] for i in range(n)) for j in range(n)]
    r = forgetting * variance
    s = sum(f * f for f in phi) + r
    gain = [sum(x * f for x, f in zip(row, phi, strict=True)) / s for row in rows]
    gamma, grown = 1.0 / (1.0 + sqrt(r / s)), 1.0 / sqrt(forgetting)
    for row, k in zip(rows, gain, strict=True):
        for j in range(n):
            row[j] = (row[j] - gamma * k * phi[j]) * grown
    return gain
