"""Least squares with a prior: Levenberg and Marquardt's way, covariance, and how far each row is explained."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from quavelet.core.blocks import FloatArray, IntArray
from quavelet.core.errors import CalibrationError

ROUNDS = 60
ENOUGH, NEARLY = 1e-4, 0.05
"""The search ends where the next step is so small a part of the parameters' sigmas, or where none gets better any more
and it is nearly so small: a Jacobian need not be exact."""

Model = Callable[[FloatArray], tuple[FloatArray, FloatArray]]
"""Parameters (P,) to residuals (R,), each divided by its sigma, and their Jacobian (R, P)."""


@dataclass(frozen=True, slots=True, eq=False)
class Fit:
    """P parameters from R rows.

    value, sigma   (P,) the parameters and one sigma of each, covariance (P, P)
    residual       (R,) in sigmas of the rows as given
    leverage       (R,) what part of each row's freedom the fit took, 0 to 1
    jacobian       (R, P) of the residuals
    """

    value: FloatArray
    covariance: FloatArray
    residual: FloatArray
    leverage: FloatArray
    jacobian: FloatArray

    @property
    def sigma(self) -> FloatArray:
        return np.sqrt(np.diag(self.covariance))

    def observed_sigma(
        self, rows: slice | IntArray, *, taken: float, assumed: float, weight: float, known: FloatArray | None = None
    ) -> float:
        """The sigma of these rows as their residuals say, `taken` having been taken; `assumed` before there were any,
        which is worth `weight` rows. `known` (R,): the part of the residuals' squares that has another cause; three
        quarters of them at most are believed to have."""
        freedom = float((1.0 - self.leverage[rows]).sum())
        squares = float((self.residual[rows] ** 2).sum())
        if known is not None:
            squares = max(squares - float(known[rows].sum()), 0.25 * squares)
        return float(np.sqrt((weight * assumed**2 + squares * taken**2) / (weight + freedom)))


def solved(model: Model, *, prior_sigma: FloatArray, start: FloatArray | None = None) -> Fit:
    """The parameters nearest to the rows and to 0 +- prior_sigma (P,); `start` (P,), else 0.

    Raises CalibrationError where the search does not end.
    """
    x = np.zeros(len(prior_sigma)) if start is None else start.copy()
    weight = 1.0 / prior_sigma
    residual, jacobian = model(x)
    cost = _cost(residual, weight * x)
    damping, length = 1e-4, np.inf
    for _ in range(ROUNDS):
        normal = _normal(jacobian, weight)
        gradient = (jacobian.T @ residual) / weight + weight * x
        newton = np.linalg.solve(normal, gradient)
        length = float(np.sqrt(newton @ normal @ newton))
        if length < ENOUGH or damping > 1e12:
            break
        moved = x - np.linalg.solve(normal + damping * np.diag(np.diag(normal)), gradient) / weight
        new_residual, new_jacobian = model(moved)
        new_cost = _cost(new_residual, weight * moved)
        # `not <` also refuses NaN.
        if not new_cost < cost:
            damping = max(damping, 1e-6) * 8.0
            continue
        x, residual, jacobian, cost, damping = moved, new_residual, new_jacobian, new_cost, damping / 8.0
    # `not <` also refuses NaN.
    if not length < NEARLY:
        raise CalibrationError("the measurements do not come together to a calibration: measure them again")
    return _fit(x, residual, jacobian, weight)


def _cost(residual: FloatArray, prior: FloatArray) -> float:
    return float(residual @ residual + prior @ prior)


def _normal(jacobian: FloatArray, weight: FloatArray) -> FloatArray:
    """The normal matrix in units of the priors' sigmas, in which it is well conditioned."""
    scaled = jacobian / weight
    normal: FloatArray = scaled.T @ scaled + np.eye(len(weight))
    return normal


def _fit(x: FloatArray, residual: FloatArray, jacobian: FloatArray, weight: FloatArray) -> Fit:
    inverse = np.linalg.inv(_normal(jacobian, weight))
    scaled = jacobian / weight
    leverage = np.einsum("ri,ij,rj->r", scaled, inverse, scaled)
    return Fit(x, inverse / np.outer(weight, weight), residual, leverage, jacobian)
