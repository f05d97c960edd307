"""How large a wavelet coefficient must be to count as more than noise."""

from __future__ import annotations

from math import log, log2, sqrt
from typing import Literal

import numpy as np

from quavelet.core.blocks import FloatArray

Rule = Literal["universal", "level_scaled", "sure", "heursure"]

StreamRule = Literal["universal", "level_scaled"]
"""Those that need sigma only, which a stream can measure along the way."""

Noise = Literal["first", "level"]
"""Whose details measure the noise: level 1's, or each level's own. Level 1 sees the least of the motion. A level's
own is right for noise that is not white, but where a level holds motion most of the time it takes that for noise."""

MAD_PER_SIGMA = 0.6745
"""The median of |x| of a normal x, in its sigma."""


def mad_sigma(details: FloatArray) -> FloatArray:
    """The noise's sigma as median(|d|)/0.6745 along the first axis: what little signal there is does not move it.

    details: (n,) or (n, k), n >= 1. Gives a number (of shape ()) or (k,), in the unit of the details.
    """
    return np.asarray(np.median(np.abs(details), axis=0) / MAD_PER_SIGMA)


def universal(sigma: float, *, n: int) -> float:
    """sigma sqrt(2 ln n): n values of noise alone hardly exceed it (Donoho and Johnstone)."""
    return sigma * sqrt(2.0 * log(max(n, 1)))


def level_scaled(sigma: float, *, n: int, level: int) -> float:
    """sigma sqrt(2 ln n)/ln(j + 1), paper 001: 1.44 of the universal one at level 1, 0.62 at level 4."""
    return universal(sigma, n=n) / log(level + 1)


def sure(details: FloatArray, *, sigma: float) -> float:
    """The soft threshold of least risk by Stein's unbiased estimate (paper 002), of those that are a |d| themselves.

    With y = |d|/sigma in ascending order, risk_i = (n - 2i + sum_{m<=i} y_m^2 + (n-i) y_i^2)/n at T = sigma y_i.
    On noise alone the risk is flat and the choice may be small: `heursure` is safer there.
    """
    n = len(details)
    if n == 0 or sigma <= 0.0:
        return 0.0
    y = np.sort(np.abs(details)) / sigma
    i = np.arange(1, n + 1)
    risk = n - 2 * i + np.cumsum(y * y) + (n - i) * y * y
    return sigma * float(y[np.argmin(risk)])


def heursure(details: FloatArray, *, sigma: float) -> float:
    """The universal threshold where the details hold hardly more than noise, else the smaller of it and `sure`.

    Hardly more: mean(y^2) - 1 < log2(n)^1.5/sqrt(n) (Donoho and Johnstone's hybrid scheme).
    """
    n = len(details)
    if n == 0 or sigma <= 0.0:
        return 0.0
    y = details / sigma
    flat = universal(sigma, n=n)
    if float(np.mean(y * y)) - 1.0 < log2(n) ** 1.5 / sqrt(n):
        return flat
    return min(flat, sure(details, sigma=sigma))


def threshold(details: FloatArray, *, rule: Rule, sigma: float, n: int, level: int) -> float:
    """The threshold of one level's details (m,) of a signal of n samples. Raises ValueError for an unknown rule."""
    if rule == "universal":
        return universal(sigma, n=n)
    if rule == "level_scaled":
        return level_scaled(sigma, n=n, level=level)
    if rule == "sure":
        return sure(details, sigma=sigma)
    if rule == "heursure":
        return heursure(details, sigma=sigma)
    raise ValueError(f"rule {rule!r} is not known: give universal, level_scaled, sure or heursure")
