"""The accelerometer out of still poses: whichever way the board lies, the force is 1 g."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from quavelet.calibration.least_squares import Fit, solved
from quavelet.calibration.model import Matrix, Vector
from quavelet.calibration.poses import StillPose, face_up, in_g, noise_of, vector
from quavelet.core.blocks import BoolArray, FloatArray, ImuBlock, IntArray
from quavelet.core.errors import CalibrationError
from quavelet.core.units import RAD_PER_DEG, STANDARD_GRAVITY_M_S2

NAMES = (
    *(f"offset {a}" for a in "xyz"),
    *(f"scale {a}" if a == b else f"misalignment {a}{b}" for a in "xyz" for b in "xyz"),
)
LIMITS = np.array([0.05, 0.05, 0.08, *(0.03 if i % 4 == 0 else 0.02 for i in range(9))])
"""Of the data sheet, g and parts (PS 6.2)."""
PRIOR = 2.0 * LIMITS
"""One sigma beforehand: boards beyond the data sheet are found, too."""
DETERMINED = 0.3
"""A parameter is found when its sigma is below this part of its limit."""
GAUGE = 1e-6
"""Norms do not see a rotation of all axes together; without faces it is 0 to so much."""
FLOOR_G = 0.0001
"""One sigma of a pose's mean that no longer rest makes better: the zero wanders."""
BENT_G = 0.0003
"""The parabola that 0.5 % of nonlinearity over +-16 g (PS 6.2) makes of 1 g is 0.63 mg at most; two of these hold 95 %
of what is even between."""
PLACED_RAD = 0.3 * RAD_PER_DEG
"""How a board is put on a face, one sigma each way, until the faces themselves say; worth three measurements."""
PLACED_ROWS = 3.0
SURE_ROWS = 10.0
"""The sigmas that are assumed for the norms count as so many measurements of them."""
OUTLIER = 4.5
MOST_OUTLIERS = 0.25
TEMPERATURE_G = 0.0014
"""What 2.5 degC away make of the zero (35 mg over 35 degC at most, PS 6.2), one sigma."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class AccelerometerFit:
    """true = matrix (measured - offset).

    covariance        (12, 12) of offset x y z in g and of the matrix, row by row
    frame             "faces": the axes are those of the faces the board was put on; "sensor": nearest to the sensor's
                      own three axes (a symmetric matrix), since norms alone do not see a rotation of all of them
    undetermined      names of what the poses do not show; it stays near nominal, with the sigma of the data sheet
    residual_g        (N,) norm less 1 g of each pose, used or not
    used              indices of the poses that were not thrown out as disturbed
    rms_before_g      of the used poses' norms uncalibrated, and rms_after_g calibrated
    placed_sigma_rad  how well the board was put on its faces, one sigma, but for how the table leans where it was put
                      on a face twice; None without faces
    tilt_sigma_rad    one sigma of the tilt of a board at rest, in the mean over all poses, at this temperature
    """

    offset_m_s2: Vector
    matrix: Matrix
    covariance: FloatArray
    frame: str
    undetermined: tuple[str, ...]
    residual_g: tuple[float, ...]
    used: tuple[int, ...]
    rms_before_g: float
    rms_after_g: float
    placed_sigma_rad: float | None
    tilt_sigma_rad: float

    @property
    def sigma(self) -> FloatArray:
        """(12,) one sigma of offset in g and of the matrix, row by row."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def accel_sigma_m_s2(self) -> float:
        """One sigma of what an axis is off, with what a few degC do to it."""
        return float(np.hypot(self.tilt_sigma_rad, TEMPERATURE_G) * STANDARD_GRAVITY_M_S2)

    def corrected(self, force_m_s2: FloatArray) -> FloatArray:
        """Measured forces (N, 3) as they were."""
        true: FloatArray = (force_m_s2 - self.offset_m_s2) @ np.array(self.matrix).T
        return true

    def pose(self, pose: StillPose) -> StillPose:
        """The pose with its force as it was: what the fits of the gyroscope take."""
        return replace(pose, accel_m_s2=vector(self.corrected(np.array([pose.accel_m_s2]))[0]))

    def block(self, block: ImuBlock) -> ImuBlock:
        """The samples with their forces as they were."""
        return replace(block, accel_m_s2=self.corrected(block.accel_m_s2))


def fit_accelerometer(poses: Sequence[StillPose], *, placed: Sequence[StillPose] = ()) -> AccelerometerFit:
    """Offset, scale and misalignment of still poses in any directions.

    placed   poses in which the board was put on a face, its axis exactly upright: they give the axes of the board, and
             misalignment where there are no others. They count among the norms; do not give them twice.

    Nine parameters from norms alone need nine directions well spread; what they do not show is named. Raises
    CalibrationError where not even the offset is found.
    """
    every = [*placed, *poses]
    if len(every) < 4:
        raise CalibrationError(f"{len(every)} still poses are too few: hold the board still in six directions or more")
    faces = _faces_of(placed)
    measured, noise = in_g(every), noise_of(every)[1].mean() / STANDARD_GRAVITY_M_S2
    sigma = np.sqrt(noise**2 / np.array([pose.windows for pose in every]) + FLOOR_G**2)
    used = np.ones(len(every), dtype=np.bool_)
    placed_sigma = (PLACED_RAD, PLACED_RAD)
    while True:
        fit, placed_sigma = _weighed(measured, sigma, used, faces, placed_sigma)
        worst = _worst(fit, measured, sigma, used)
        if worst is None or (~used).sum() + 1 > MOST_OUTLIERS * len(every):
            break
        used[worst] = False
    wrong = [name for name in _undetermined(fit) if name.startswith("offset")]
    if wrong:
        raise CalibrationError(
            f"the poses do not show the accelerometer's {', '.join(wrong)}: hold the board still with each axis up and "
            f"down"
        )
    offset, matrix = fit.value[:3], np.eye(3) + fit.value[3:].reshape(3, 3)
    norms = np.linalg.norm((measured - offset) @ matrix.T, axis=1) - 1.0
    before = np.linalg.norm(measured[used], axis=1) - 1.0
    x, y, z = (vector(row) for row in matrix)
    return AccelerometerFit(
        offset_m_s2=vector(offset * STANDARD_GRAVITY_M_S2),
        matrix=(x, y, z),
        covariance=fit.covariance,
        frame="faces" if faces else "sensor",
        undetermined=_undetermined(fit),
        residual_g=tuple(norms.tolist()),
        used=tuple(np.flatnonzero(used).tolist()),
        rms_before_g=float(np.sqrt((before**2).mean())),
        rms_after_g=float(np.sqrt((norms[used] ** 2).mean())),
        placed_sigma_rad=placed_sigma[0] if faces else None,
        tilt_sigma_rad=_tilt_sigma_rad(fit, matrix),
    )


def _faces_of(placed: Sequence[StillPose]) -> list[str]:
    """The face that is up in each placed pose. At least two axes, or the rotation is not known."""
    faces = []
    for pose in placed:
        face = face_up(pose.accel_m_s2)
        if face is None:
            raise CalibrationError("a placed pose lies on no face: put the board flat on one of its six faces")
        faces.append(face)
    if placed and len({face[1] for face in faces}) < 2:
        raise CalibrationError("one pair of faces does not show the board's axes: put it on another face, too")
    return faces


@dataclass(frozen=True, slots=True)
class _Side:
    """What a placed board shows sideways, which should be nothing.

    weights   of each pose in it: two on one face, turned half round in between, are taken together and apart; how
              the table leans is in the second alone
    side      0 to 2 for x to z
    """

    weights: tuple[tuple[int, float], ...]
    side: int


def _sides_of(faces: list[str], used: BoolArray) -> tuple[list[_Side], list[_Side]]:
    """Of the poses that are used: those in which the table's lean cancels, and the others."""
    together, apart = [], []
    kept = [int(k) for k in np.flatnonzero(used[: len(faces)])]
    while kept:
        first = kept.pop(0)
        second = next((k for k in kept if faces[k] == faces[first]), None)
        if second is not None:
            kept.remove(second)
        for side in range(3):
            if side == "xyz".index(faces[first][1]):
                continue
            if second is None:
                apart.append(_Side(((first, 1.0),), side))
            else:
                together.append(_Side(((first, 0.5**0.5), (second, 0.5**0.5)), side))
                apart.append(_Side(((first, 0.5**0.5), (second, -(0.5**0.5))), side))
    return (together, apart) if together else (apart, [])


def _weighed(
    measured: FloatArray,
    sigma: FloatArray,
    used: BoolArray,
    faces: list[str],
    placed_sigma: tuple[float, float],
) -> tuple[Fit, tuple[float, float]]:
    """The fit, and the sigmas of placing, without and with the table: they and those of the norms become what the
    fit's own residuals say."""
    sides = _sides_of(faces, used)
    together = len(sides[0])
    placed = [*sides[0], *sides[1]]
    scale = 1.0
    norms = int(used.sum())
    for _ in range(4):
        kept = np.flatnonzero(used)
        by_side = np.repeat(placed_sigma, [together, len(placed) - together])
        model = partial(_rows, measured=measured, sigma=sigma * scale, kept=kept, placed=placed, placed_sigma=by_side)
        fit = solved(model, prior_sigma=PRIOR)
        scale = fit.observed_sigma(slice(0, norms), taken=scale, assumed=1.0, weight=SURE_ROWS)
        if placed:
            one, other = (
                fit.observed_sigma(rows, taken=taken, assumed=PLACED_RAD, weight=PLACED_ROWS)
                for rows, taken in zip(
                    (slice(norms, norms + together), slice(norms + together, norms + len(placed))),
                    placed_sigma,
                    strict=True,
                )
            )
            placed_sigma = one, other
    return _with_bend(fit, measured[used], norms), placed_sigma


def _rows(
    x: FloatArray,
    measured: FloatArray,
    sigma: FloatArray,
    kept: IntArray,
    placed: list[_Side],
    placed_sigma: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    """Residuals and Jacobian: norms, then the sideways parts of placed poses, then the gauge where there are none."""
    offset, matrix = x[:3], np.eye(3) + x[3:].reshape(3, 3)
    away = measured - offset
    force = away @ matrix.T
    norm = np.linalg.norm(force, axis=1)
    up = force / norm[:, None]
    residual = [((norm - 1.0) / sigma)[kept]]
    by_matrix = (up[:, :, None] * away[:, None, :]).reshape(-1, 9)
    jacobian = [(np.hstack([-up @ matrix, by_matrix]) / sigma[:, None])[kept]]
    for one, row_sigma in zip(placed, placed_sigma, strict=True):
        row, off = np.zeros(12), 0.0
        for k, weight in one.weights:
            row[:3] -= weight * matrix[one.side]
            row[3 + 3 * one.side : 6 + 3 * one.side] += weight * away[k]
            off += weight * force[k, one.side]
        residual.append(np.array([off / row_sigma]))
        jacobian.append(row[None] / row_sigma)
    if not placed:
        for i, j in ((0, 1), (0, 2), (1, 2)):
            row = np.zeros(12)
            row[3 + 3 * i + j], row[3 + 3 * j + i] = 1.0 / GAUGE, -1.0 / GAUGE
            residual.append(np.array([row @ x]))
            jacobian.append(row[None])
    return np.concatenate(residual), np.vstack(jacobian)


def _with_bend(fit: Fit, measured: FloatArray, norms: int) -> Fit:
    """The covariance with what the sensor's nonlinearity, which the model has not, does to the parameters."""
    up = measured / np.linalg.norm(measured, axis=1)[:, None]
    rows = fit.jacobian[:norms]
    # One row of the Jacobian is sensitive to an offset along `up` by 1/sigma: that gives back each norm's sigma.
    weight = np.linalg.norm(rows[:, :3], axis=1)
    shift = fit.covariance @ rows.T @ (weight[:, None] * up * measured**2)
    return Fit(fit.value, fit.covariance + BENT_G**2 * shift @ shift.T, fit.residual, fit.leverage, fit.jacobian)


def _worst(fit: Fit, measured: FloatArray, sigma: FloatArray, used: BoolArray) -> int | None:
    """The pose whose norm is farthest from what all poses say, None where none is an outlier."""
    offset, matrix = fit.value[:3], np.eye(3) + fit.value[3:].reshape(3, 3)
    norms = np.abs(np.linalg.norm((measured - offset) @ matrix.T, axis=1) - 1.0)
    typical = max(1.4826 * float(np.median(norms[used])), float(np.median(sigma)), 2 * BENT_G)
    norms[~used] = 0.0
    worst = int(np.argmax(norms))
    return worst if norms[worst] > OUTLIER * typical else None


def _undetermined(fit: Fit) -> tuple[str, ...]:
    return tuple(n for n, s, limit in zip(NAMES, fit.sigma, LIMITS, strict=True) if s > DETERMINED * limit)


def _tilt_sigma_rad(fit: Fit, matrix: FloatArray) -> float:
    """Root mean square over many directions of one sigma of tilt about a horizontal axis."""
    squares = []
    inverse = np.linalg.inv(matrix)
    for up in sphere_points(40):
        away = inverse @ up
        change = np.hstack([-matrix, np.kron(np.eye(3), away)])
        spread = change @ fit.covariance @ change.T
        squares.append(0.5 * (np.trace(spread) - up @ spread @ up))
    return float(np.sqrt(np.mean(squares)))


def sphere_points(n: int) -> FloatArray:
    """(n, 3) unit vectors spread evenly over the sphere: a spiral of golden angles."""
    z = 1.0 - (2.0 * np.arange(n) + 1.0) / n
    turn = np.pi * (3.0 - np.sqrt(5.0)) * np.arange(n)
    r = np.sqrt(1.0 - z * z)
    return np.column_stack([r * np.cos(turn), r * np.sin(turn), z])
