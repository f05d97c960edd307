"""The gyroscope's bias out of still poses: over temperature, and what a force adds to it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from quavelet.calibration.model import BiasCurve, Matrix, Vector
from quavelet.calibration.poses import StillPose, noise_of, vector
from quavelet.core.blocks import FloatArray, ImuBlock
from quavelet.core.errors import CalibrationError
from quavelet.core.units import NS_PER_S, RAD_PER_DEG, STANDARD_GRAVITY_M_S2

WANDER_RAD_S = 0.003 * RAD_PER_DEG
WANDER_S = 100.0
"""The zero wanders so much, and forgets itself so fast, as Allan deviations of single parts show."""
SLOPE_PRIOR_RAD_S_DEGC = 20.0 / 60.0 / 3**0.5 * RAD_PER_DEG
"""PS 6.1: 20 deg/s over the 60 degC to each end; where the temperature did not move, so much is not known."""
FORCE_PRIOR = 0.1 / 3**0.5 * RAD_PER_DEG / STANDARD_GRAVITY_M_S2
"""PS 6.1: 0.1 deg/s/g."""
BIAS_PRIOR_RAD_S = 100.0 * RAD_PER_DEG
MOST_DEGREE = 4
SPAN_OF_A_DEGREE_DEGC = 4.0
TURN_ON_RAD_S = 0.05 * RAD_PER_DEG
"""One sigma of what a bias is off after the chip was off for long. No figure of the data sheet: an assumption."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class BiasFit:
    """The bias of all poses: sum of coefficient_k (temperature - reference)^k + per_force force.

    coefficients_rad_s   of powers 0 to `degree`
    per_force            rad/s for 1 m/s^2, rows x y z of the gyroscope
    covariance           (degree + 4, degree + 4) of one axis: coefficients, then per_force's row; all axes alike but
                         for their noise, of which it is the largest
    lowest_degc, highest_degc   of the poses
    evidence             how much less likely each lower degree is: natural logarithm, by degree
    residual_rad_s       (N, 3) of each pose
    """

    reference_degc: float
    coefficients_rad_s: tuple[Vector, ...]
    per_force: Matrix
    covariance: FloatArray
    lowest_degc: float
    highest_degc: float
    evidence: tuple[float, ...]
    residual_rad_s: FloatArray

    @property
    def degree(self) -> int:
        return len(self.coefficients_rad_s) - 1

    def sigma_at(self, temp_degc: float) -> float:
        """One sigma in rad/s of an axis' bias at a temperature, without force."""
        x = np.append((temp_degc - self.reference_degc) ** np.arange(self.degree + 1), np.zeros(3))
        return float(np.sqrt(x @ self.covariance @ x))

    def curve(self) -> BiasCurve:
        """The bias as the pipeline takes it, with what a chip does that was off."""
        temperatures = np.linspace(self.lowest_degc, self.highest_degc, 9)
        sigma = max(self.sigma_at(float(t)) for t in temperatures)
        slopes = [self._slope_sigma(float(t)) for t in temperatures]
        return BiasCurve(
            reference_degc=self.reference_degc,
            coefficients_rad_s=self.coefficients_rad_s,
            lowest_degc=self.lowest_degc,
            highest_degc=self.highest_degc,
            sigma_rad_s=float(np.hypot(sigma, TURN_ON_RAD_S)),
            slope_sigma_rad_s_degc=float(np.median(slopes)),
        )

    def rows(self, block: ImuBlock) -> FloatArray:
        """The bias (N, 3) of each of a block's samples, with what its force adds."""
        force: FloatArray = block.accel_m_s2 @ np.array(self.per_force).T
        return self.curve().at(block.temp_degc) + force

    def _slope_sigma(self, temp_degc: float) -> float:
        k = np.arange(self.degree + 1)
        x = np.append(k * (temp_degc - self.reference_degc) ** np.maximum(k - 1, 0), np.zeros(3))
        return float(np.sqrt(x @ self.covariance @ x))


def fit_gyro_bias(poses: Sequence[StillPose]) -> BiasFit:
    """The bias of a board at rest in these poses, whose forces are calibrated (`AccelerometerFit.pose`).

    More than one direction shows what force does, more than one temperature how it goes with that; the degree is that
    which the evidence asks for. Raises CalibrationError for no poses.
    """
    if not poses:
        raise CalibrationError("no still pose shows the gyroscope's bias: lay the board down and let go")
    temps = np.array([pose.temp_degc for pose in poses])
    low, high = float(temps.min()), float(temps.max())
    most = max(1, min(MOST_DEGREE, int((high - low) / SPAN_OF_A_DEGREE_DEGC)))
    reference = 0.5 * (low + high)
    fits = [_fitted(poses, reference, degree) for degree in range(1, most + 1)]
    best = max(range(len(fits)), key=lambda k: fits[k][0])
    _, coefficients, covariance, residual = fits[best]
    x, y, z = (vector(row) for row in coefficients[-3:].T)
    return BiasFit(
        reference_degc=reference,
        coefficients_rad_s=tuple(vector(row) for row in coefficients[:-3]),
        per_force=(x, y, z),
        covariance=covariance,
        lowest_degc=low,
        highest_degc=high,
        evidence=tuple(fits[best][0] - fit[0] for fit in fits),
        residual_rad_s=residual,
    )


def _fitted(
    poses: Sequence[StillPose], reference: float, degree: int
) -> tuple[float, FloatArray, FloatArray, FloatArray]:
    """Logarithm of the evidence, coefficients (degree + 4, 3), their covariance, residuals (N, 3).

    Each axis is a Gaussian process: the polynomial and the force with their priors, the slow wander, white noise.
    """
    temps = np.array([pose.temp_degc for pose in poses]) - reference
    forces = np.array([pose.accel_m_s2 for pose in poses])
    rates = np.array([pose.gyro_rad_s for pose in poses])
    times = np.array([0.5 * (pose.begin_ns + pose.end_ns) for pose in poses]) / NS_PER_S
    noise = noise_of(poses)[0]
    design = np.hstack([temps[:, None] ** np.arange(degree + 1), forces])
    half = max(1.0, 0.5 * float(np.ptp(temps)))
    # The bend, over the whole of the temperatures seen, is not larger than the slope.
    bends = [SLOPE_PRIOR_RAD_S_DEGC * half ** (1 - k) for k in range(1, degree + 1)]
    prior = np.array([BIAS_PRIOR_RAD_S, *bends, *[FORCE_PRIOR] * 3])
    wander = WANDER_RAD_S**2 * np.exp(-np.abs(times[:, None] - times) / WANDER_S)
    evidence, columns, worst = 0.0, [], np.zeros((degree + 4, degree + 4))
    for axis in range(3):
        white = noise[axis] ** 2 / np.array([pose.windows for pose in poses])
        spread = wander + np.diag(white)
        root = np.linalg.cholesky(spread)
        rows = np.linalg.solve(root, np.column_stack([design, rates[:, axis]]))
        scaled = rows[:, :-1] * prior
        normal = scaled.T @ scaled + np.eye(len(prior))
        inverse = np.linalg.inv(normal)
        found = inverse @ scaled.T @ rows[:, -1]
        misfit = float(rows[:, -1] @ (rows[:, -1] - scaled @ found))
        evidence -= 0.5 * (misfit + float(np.linalg.slogdet(normal)[1]))
        covariance = inverse * np.outer(prior, prior)
        worst = covariance if covariance[0, 0] >= worst[0, 0] else worst
        columns.append(found * prior)
    coefficients = np.stack(columns, axis=1)
    return evidence, coefficients, worst, rates - design @ coefficients
