"""The slow wander of a sensor's zero, as a smooth function of time."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

_TONES = 24
# The top 2 % of the power is left out, tones of a period under a fifth of the correlation time: it is far below the
# white noise, and without it the wander within a chunk of samples is all but straight.
_FASTEST = 0.98


class Drift:
    """A random but fixed function with the spectrum of a first-order Gauss-Markov process.

    Each axis is a sum of tones of one amplitude and random phase, whose frequencies are spread as the process's power
    is: evenly in the arc tangent of 2 pi f tau.
    """

    def __init__(self, rng: np.random.Generator, *, sd: float, correlation_s: float) -> None:
        """`sd` of each axis, in its unit; `correlation_s` is the process's tau."""
        share = _FASTEST * (np.arange(_TONES) + rng.uniform(size=(3, _TONES))) / _TONES
        self._omega_rad_s = np.tan(np.pi / 2 * share) / correlation_s
        self._phase_rad = rng.uniform(0, 2 * np.pi, (3, _TONES))
        self._amplitude = sd * np.sqrt(2 / _TONES)

    def at(self, t_s: FloatArray) -> FloatArray:
        """The wander (N, 3) at increasing times (N,) in s, exact to a straight line over each 16th of their span."""
        if len(t_s) <= 32:
            return self._exact(t_s)
        knots_s = np.linspace(t_s[0], t_s[-1], 17)
        return np.stack([np.interp(t_s, knots_s, axis) for axis in self._exact(knots_s).T], 1)

    def _exact(self, t_s: FloatArray) -> FloatArray:
        phase = t_s[:, None, None] * self._omega_rad_s + self._phase_rad
        wander: FloatArray = self._amplitude * np.sin(phase).sum(2)
        return wander
