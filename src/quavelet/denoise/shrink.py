"""What is left of a wavelet coefficient w at a threshold T >= 0: nothing below T, and above it

    hard      w
    soft      w - T
    improved  w - T exp(-k u^alpha),       u = (w - T)/T      (paper 001, in the form of the sister papers)
    sigmoid   w - 2T/(1 + exp(k u^alpha))
    power     (w^k - T^k)^(1/k)

for w > 0, and odd in w. The last three lie between soft (k -> 0; power: k = 1) and hard (k -> inf). The
paper prints the parameters k and alpha but not its function; with k = 9 to 20 the three differ little.
Dividing by T makes them independent of the unit.

Thresholds are a number or an array that broadcasts against the coefficients. Every function works element
by element, so that cutting an array does not change it.
"""

from __future__ import annotations

from typing import Literal

import numpy as np

from quavelet.core.blocks import FloatArray

Shrink = Literal["hard", "soft", "improved", "sigmoid", "power"]

Threshold = float | FloatArray


def hard(w: FloatArray, t: Threshold) -> FloatArray:
    """w where |w| >= T, else 0."""
    return np.where(np.abs(w) >= t, w, 0.0)


def soft(w: FloatArray, t: Threshold) -> FloatArray:
    """sgn(w) max(|w| - T, 0)."""
    return np.copysign(np.maximum(np.abs(w) - t, 0.0), w)


def improved(w: FloatArray, t: Threshold, *, k: float = 16.0, alpha: float = 1.0) -> FloatArray:
    """sgn(w) (|w| - T exp(-k ((|w|-T)/T)^alpha)), paper 001's improved function. k > 0, alpha > 0."""
    size, x = _exponent(w, t, k, alpha)
    return _signed(size - t * np.exp(-x), w, t)


def sigmoid(w: FloatArray, t: Threshold, *, k: float = 16.0, alpha: float = 1.0) -> FloatArray:
    """sgn(w) (|w| - 2T/(1 + exp(k ((|w|-T)/T)^alpha))). k > 0, alpha > 0."""
    size, x = _exponent(w, t, k, alpha)
    decay = np.exp(-x)
    return _signed(size - 2.0 * t * decay / (1.0 + decay), w, t)


def power(w: FloatArray, t: Threshold, *, k: float = 16.0) -> FloatArray:
    """sgn(w) (|w|^k - T^k)^(1/k). k >= 1."""
    if not k >= 1.0:
        raise ValueError(f"k = {k} does not fit the power form: give 1 (soft) or more")
    size = np.abs(w)
    # Of the ratio, which cannot overflow.
    ratio = np.divide(t, size, out=np.ones_like(size), where=size > t)
    return _signed(size * (1.0 - ratio**k) ** (1.0 / k), w, t)


def shrink(w: FloatArray, t: Threshold, *, kind: Shrink, k: float = 16.0, alpha: float = 1.0) -> FloatArray:
    """The function called `kind`; hard and soft make no use of k and alpha. Raises ValueError for another name."""
    if kind == "hard":
        return hard(w, t)
    if kind == "soft":
        return soft(w, t)
    if kind == "improved":
        return improved(w, t, k=k, alpha=alpha)
    if kind == "sigmoid":
        return sigmoid(w, t, k=k, alpha=alpha)
    if kind == "power":
        return power(w, t, k=k)
    raise ValueError(f"shrink {kind!r} is not known: give hard, soft, improved, sigmoid or power")


def _exponent(w: FloatArray, t: Threshold, k: float, alpha: float) -> tuple[FloatArray, FloatArray]:
    """|w| and k u^alpha; infinite where T is 0 or so small that the quotient overflows, which is hard."""
    if not (k > 0.0 and alpha > 0.0):
        raise ValueError(f"k = {k}, alpha = {alpha} do not fit: give positive numbers")
    size = np.abs(w)
    over = np.maximum(size - t, 0.0)
    with np.errstate(over="ignore"):
        u = np.divide(over, t, out=np.full_like(size, np.inf), where=np.asarray(t) > 0.0)
        return size, k * (u if alpha == 1.0 else u**alpha)


def _signed(size: FloatArray, w: FloatArray, t: Threshold) -> FloatArray:
    return np.where(np.abs(w) > t, np.copysign(size, w), np.copysign(0.0, w))
