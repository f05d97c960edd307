"""The magnetometer out of a board that is turned through all directions: the ellipsoid becomes a sphere."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import numpy as np

from quavelet.calibration.accelerometer import sphere_points
from quavelet.calibration.least_squares import Fit, solved
from quavelet.calibration.model import MagnetometerCalibration
from quavelet.calibration.poses import vector
from quavelet.core.blocks import BoolArray, FloatArray
from quavelet.core.errors import CalibrationError

MOST_SAMPLES = 1500
CELLS = 50
CELL_RAD = np.radians(20.0)
"""A direction is seen when a sample is so near: fifty such caps cover the sphere."""
LEAST_COVERAGE = 0.7
SOFT_PRIOR = 0.3
HARD_PRIOR = 10.0
"""One sigma of soft and hard iron beforehand, in parts of the field."""
NOISE = 0.02
SURE_ROWS = 5.0
OUTLIER = 5.0
_PAIRS = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class MagnetometerFit:
    """true = soft_iron (measured - hard_iron).

    calibration   for the pipeline; its soft iron is symmetric (a rotation of all axes is not seen) and keeps volume
    field_ut      strength of the field
    covariance    (9, 9) of hard iron in parts of the field and of soft iron: xx yy zz xy xz yz
    coverage      part of all directions that were seen, 0 to 1
    residual      (N,) strength of each sample that was looked at, relative, less 1
    used          (N,) which of them were not thrown out
    rms_before, rms_after   of the used ones, relative
    """

    calibration: MagnetometerCalibration
    field_ut: float
    covariance: FloatArray
    coverage: float
    residual: FloatArray
    used: BoolArray
    rms_before: float
    rms_after: float


def fit_magnetometer(field_ut: FloatArray) -> MagnetometerFit:
    """Hard and soft iron from samples (N, 3) in uT, in as many directions as can be had.

    Raises CalibrationError where the directions do not cover the sphere.
    """
    if len(field_ut) < 30:
        raise CalibrationError(f"{len(field_ut)} samples of the magnetic field are too few: turn the board for longer")
    samples = field_ut[:: max(1, len(field_ut) // MOST_SAMPLES)]
    centre, radius = _sphere(samples)
    ball = (samples - centre) / radius
    prior = np.array([HARD_PRIOR] * 3 + [SOFT_PRIOR] * 6)
    used, noise = np.ones(len(ball), dtype=np.bool_), NOISE
    for _ in range(6):
        fit = solved(partial(_rows, samples=ball[used], sigma=noise), prior_sigma=prior)
        noise = fit.observed_sigma(slice(None), taken=noise, assumed=NOISE, weight=SURE_ROWS)
        strength = np.linalg.norm(_corrected(fit, ball), axis=1) - 1.0
        typical = 1.4826 * float(np.median(np.abs(strength)))
        now = np.abs(strength) <= OUTLIER * max(typical, 1e-6)
        if (now == used).all():
            break
        used = now
    seen = coverage_of(_corrected(fit, ball[used]))
    if seen < LEAST_COVERAGE:
        raise CalibrationError(
            f"the board was turned through {100 * seen:.0f} % of all directions only: turn it on, each axis up and down"
        )
    soft = _matrix(fit.value)
    size = float(np.linalg.det(soft)) ** (1 / 3)
    x, y, z = (vector(row) for row in soft / size)
    before = np.linalg.norm(samples[used], axis=1)
    return MagnetometerFit(
        calibration=MagnetometerCalibration(
            hard_iron_ut=vector(centre + radius * fit.value[:3]),
            hard_iron_sigma_ut=vector(np.sqrt(np.diag(fit.covariance)[:3]) * float(radius / size)),
            soft_iron=(x, y, z),
            field_ut=float(radius / size),
            field_sigma=float(noise),
        ),
        field_ut=float(radius / size),
        covariance=fit.covariance,
        coverage=seen,
        residual=strength,
        used=used,
        rms_before=float(before.std() / before.mean()),
        rms_after=float(np.sqrt((strength[used] ** 2).mean())),
    )


def coverage_of(directions: FloatArray) -> float:
    """What part of all directions is near one of these vectors (N, 3): for showing while the board is turned. A vector
    of no length has no direction."""
    length = np.linalg.norm(directions, axis=1)
    if not length.any():
        return 0.0
    unit = directions[length > 0.0] / length[length > 0.0, None]
    return float(((sphere_points(CELLS) @ unit.T).max(axis=1) > np.cos(CELL_RAD)).mean())


def _sphere(samples: FloatArray) -> tuple[FloatArray, float]:
    """Centre and radius of the nearest sphere: |m|^2 = 2 c m + (r^2 - c^2) is linear."""
    design = np.column_stack([2.0 * samples, np.ones(len(samples))])
    (x, y, z, rest), *_ = np.linalg.lstsq(design, (samples**2).sum(axis=1), rcond=None)
    centre = np.array([x, y, z])
    return centre, float(np.sqrt(max(rest + centre @ centre, 1e-12)))


def _matrix(x: FloatArray) -> FloatArray:
    soft = np.eye(3)
    for k, (i, j) in enumerate(_PAIRS):
        soft[i, j] += x[3 + k]
        if i != j:
            soft[j, i] += x[3 + k]
    return soft


def _corrected(fit: Fit, samples: FloatArray) -> FloatArray:
    corrected: FloatArray = (samples - fit.value[:3]) @ _matrix(fit.value)
    return corrected


def _rows(x: FloatArray, samples: FloatArray, sigma: float) -> tuple[FloatArray, FloatArray]:
    soft, away = _matrix(x), samples - x[:3]
    true = away @ soft
    norm = np.linalg.norm(true, axis=1)
    up = true / norm[:, None]
    by_soft = [up[:, i] * away[:, j] + (up[:, j] * away[:, i] if i != j else 0.0) for i, j in _PAIRS]
    return (norm - 1.0) / sigma, np.column_stack([-up @ soft, *by_soft]) / sigma
