"""Allan deviation of a still sensor, and the noise figures read off it.

Densities are one-sided, as the data sheet's: white noise of density N has a standard deviation of
N sqrt(rate / 2) in a sample. The angle random walk that others quote is N / sqrt(2).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from math import log, pi, sqrt
from typing import Literal

import numpy as np

from quavelet.core.blocks import FloatArray
from quavelet.core.units import RAD_PER_DEG, STANDARD_GRAVITY_M_S2

LONGEST_SHARE = 1 / 4
"""The longest averaging time, as a share of the record: of fewer than four averages nothing can be said."""
FIT_FROM_S = 0.1
"""The fit leaves out shorter averages: there the chip's low-pass, its quantisation and vibration show."""
FIT_TO_S = 2.5
"""A record whose curve ends before this gives no figures."""
FIT_ROUNDS = 4
FEWEST_SAMPLES = 64

Word = Literal["good", "usual", "poor"]


@dataclass(frozen=True, slots=True, eq=False)
class AllanCurve:
    """K averaging times (K,), the overlapping Allan deviation at each, and its relative one-sigma error."""

    tau_s: FloatArray
    deviation: FloatArray
    relative_sigma: FloatArray

    def bounds(self) -> tuple[FloatArray, FloatArray]:
        """The deviation's 95 % confidence interval (K,), (K,), chi-squared (Wilson and Hilferty's approximation)."""
        freedom = 0.5 / self.relative_sigma**2
        part = 2.0 / (9.0 * freedom)
        low, high = ((1.0 - part + z * np.sqrt(part)) ** 3 for z in (1.96, -1.96))
        # Below one degree of freedom the approximation goes through zero: nothing is known upwards then.
        return self.deviation / np.sqrt(low), self.deviation / np.sqrt(np.maximum(high, 1e-6))

    def minimum(self) -> tuple[float, float]:
        """The smallest deviation and the averaging time it is at: no longer mean is any better."""
        k = int(np.argmin(self.deviation))
        return float(self.deviation[k]), float(self.tau_s[k])


@dataclass(frozen=True, slots=True)
class Term:
    """One figure of the fit.

    value   0 where the record does not show it
    sigma   one sigma of the value
    limit   more than this the record excludes (95 %), whatever the other terms are
    """

    value: float
    sigma: float
    limit: float

    @property
    def seen(self) -> bool:
        """Is it told from nothing?"""
        return self.value > 2.0 * self.sigma


@dataclass(frozen=True, slots=True)
class NoiseFit:
    """What the deviation is made of; U is the unit of the values (rad/s, m/s^2).

    density        U/sqrt(Hz), one-sided; at tau the deviation is density / sqrt(2 tau)
    instability    U, bias instability (flicker noise): the flat part over 0.664
    walk           U/sqrt(s), random walk of the bias: walk sqrt(tau / 3)
    ramp           U/s, a steady drift, as of a chip that warms up: ramp tau / sqrt(2)
    """

    density: Term
    instability: Term
    walk: Term
    ramp: Term

    def deviation(self, tau_s: FloatArray) -> FloatArray:
        """The deviation (K,) of this fit."""
        squares = np.array([self.density.value, self.instability.value, self.walk.value, self.ramp.value]) ** 2
        fitted: FloatArray = np.sqrt(_shapes(tau_s) @ squares)
        return fitted


@dataclass(frozen=True, slots=True)
class DataSheet:
    """A sensor's noise as its data sheet has it: `unit_si` is one of the sheet's units in SI."""

    name: str
    unit: str
    unit_si: float
    density: float

    def word(self, density_si: float) -> Word:
        """The noise density in a word: as the sheet says, as real boards are, or worse than those."""
        ratio = density_si / self.unit_si / self.density
        return "good" if ratio <= GOOD else "usual" if ratio <= USUAL else "poor"


GOOD, USUAL = 1.5, 4.0
"""Times the data sheet's noise. Its figure is a typical one at 10 Hz; real gyroscopes show two to three and a half."""
GYRO = DataSheet("gyroscope", "deg/s", RAD_PER_DEG, 0.005)
"""PS 6.1: 0.005 deg/s/sqrt(Hz)."""
ACCEL = DataSheet("accelerometer", "ug", 1e-6 * STANDARD_GRAVITY_M_S2, 400.0)
"""PS 6.2: 400 ug/sqrt(Hz)."""


def allan_deviation(values: FloatArray, *, period_s: float, tau_s: FloatArray | None = None) -> AllanCurve:
    """The overlapping Allan deviation of one axis (N,), a rate or a force sampled every `period_s`.

    `tau_s` are rounded to whole samples; without them twelve a decade, up to a quarter of the record.
    Raises ValueError for fewer than 64 samples, values that are not finite, or a tau that does not fit.
    """
    n = len(values)
    if values.ndim != 1 or n < FEWEST_SAMPLES:
        raise ValueError(f"{n} samples are too few for an Allan deviation: record at least {FEWEST_SAMPLES}")
    if not np.isfinite(values).all():
        raise ValueError("values that are not finite have no Allan deviation: leave them out")
    averaged = _averages(n) if tau_s is None else np.unique(np.round(tau_s / period_s).astype(np.int64))
    if averaged.size == 0 or averaged[0] < 1 or averaged[-1] > (n - 1) // 2:
        raise ValueError(f"averaging times go from {period_s:g} to {period_s * ((n - 1) // 2):g} s here")
    # The mean goes first: the sum of a large constant would cost digits.
    angle = np.concatenate([[0.0], np.cumsum(values - values.mean())]) * period_s
    deviation: FloatArray = np.empty(len(averaged))
    for k, m in enumerate(averaged.tolist()):
        second = angle[2 * m :] - 2.0 * angle[m:-m] + angle[: -2 * m]
        deviation[k] = sqrt(float(np.mean(second**2)) / 2.0) / (m * period_s)
    tau: FloatArray = averaged.astype(np.float64) * period_s
    return AllanCurve(tau, deviation, _relative_sigma(n + 1, averaged.astype(np.float64)))


def allan_deviation_of(stretches: Sequence[FloatArray], *, period_s: float) -> AllanCurve:
    """The same of several stretches of one axis, between which samples are missing: at each averaging time their
    variances, weighted by their degrees of freedom; a stretch counts up to a quarter of its length.

    Raises ValueError as `allan_deviation`, and for no stretch at all.
    """
    if not stretches:
        raise ValueError("no stretch has no Allan deviation: give one")
    tau_s = allan_deviation(max(stretches, key=len), period_s=period_s).tau_s
    squares, freedom = np.zeros(len(tau_s)), np.zeros(len(tau_s))
    for values in stretches:
        fits = tau_s <= max(1, int(len(values) * LONGEST_SHARE)) * period_s * (1.0 + 1e-9)
        curve = allan_deviation(values, period_s=period_s, tau_s=tau_s[fits])
        free = 0.5 / curve.relative_sigma**2
        squares[fits] += free * curve.deviation**2
        freedom[fits] += free
    return AllanCurve(tau_s, np.sqrt(squares / freedom), 1.0 / np.sqrt(2.0 * freedom))


def fit_noise(curve: AllanCurve) -> NoiseFit:
    """The four terms of a curve, none below zero, by least squares of its squares, each weighted by its error.

    Neighbouring points share their samples, so the fit's own covariance would be far too good: each term is as
    sure as the one point that shows it best. Raises ValueError where the record is too short or shows nothing.
    """
    used = (curve.tau_s >= FIT_FROM_S) & (curve.deviation > 0.0)
    if not used.any() or int(used.sum()) < 5 or curve.tau_s[used][-1] < FIT_TO_S:
        raise ValueError("the record shows no noise figures: give ten seconds or more of a sensor that lies still")
    shapes, squares = _shapes(curve.tau_s[used]), curve.deviation[used] ** 2
    relative = 2.0 * curve.relative_sigma[used]  # of the squares
    expected = squares
    for _ in range(FIT_ROUNDS):
        # By the measured squares themselves a point that happens to be low would weigh more, and the fit be low.
        found = _not_negative(shapes / (relative * expected)[:, None], squares / (relative * expected))
        expected = shapes @ found
    parts = shapes * found / (shapes @ found)[:, None]
    most = curve.bounds()[1][used]
    terms = []
    for k in range(shapes.shape[1]):
        value, limit = sqrt(found[k]), float(np.min(most / np.sqrt(shapes[:, k])))
        sure = float(np.min(relative / np.maximum(parts[:, k], 1e-12))) / 2.0
        terms.append(Term(value, min(value * sure, limit), max(value, limit)))
    return NoiseFit(*terms)


def _averages(n: int) -> np.ndarray[tuple[int], np.dtype[np.int64]]:
    most = max(1, int(n * LONGEST_SHARE))
    return np.unique(np.round(np.logspace(0, np.log10(most), 1 + int(12 * np.log10(most)))).astype(np.int64))


def _shapes(tau_s: FloatArray) -> FloatArray:
    """(K, 4): the square of the deviation that a unit of each term has (IEEE 952, annex C; one-sided density)."""
    return np.column_stack([0.5 / tau_s, np.full(len(tau_s), 2.0 * log(2.0) / pi), tau_s / 3.0, tau_s**2 / 2.0])


def _relative_sigma(phases: int, m: FloatArray) -> FloatArray:
    """Relative one-sigma error (K,) of the overlapping deviation of white noise: NIST SP 1065, 5.4.1."""
    freedom = (3.0 * (phases - 1) / (2.0 * m) - 2.0 * (phases - 2) / phases) * 4.0 * m**2 / (4.0 * m**2 + 5.0)
    sigma: FloatArray = 1.0 / np.sqrt(2.0 * np.maximum(freedom, 1.0))
    return sigma


def _not_negative(a: FloatArray, b: FloatArray) -> FloatArray:
    """x >= 0 with the least |a x - b|: of the few subsets of columns the best whose solution is not negative."""
    scale = np.linalg.norm(a, axis=0)
    best, least = np.zeros(a.shape[1]), float(b @ b)
    for n in range(1, a.shape[1] + 1):
        for columns in combinations(range(a.shape[1]), n):
            chosen = list(columns)
            x, *_ = np.linalg.lstsq(a[:, chosen] / scale[chosen], b, rcond=None)
            rest = float(np.sum((a[:, chosen] / scale[chosen] @ x - b) ** 2))
            if (x >= 0.0).all() and rest < least:
                best, least = np.zeros(a.shape[1]), rest
                best[chosen] = x / scale[chosen]
    return best
