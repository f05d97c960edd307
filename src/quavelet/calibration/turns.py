"""The gyroscope's scale and misalignment out of turns between two still poses.

The rate is integrated from pose to pose. Gravity in both poses is what the accelerometer, calibrated before, says: so
every turn shows what the gyroscope makes of tilt. A turn about the vertical shows no scale by itself; there the angle
must be known: whole turns against an edge. Turns both ways cancel what is left of the bias.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from quavelet.calibration.accelerometer import AccelerometerFit
from quavelet.calibration.least_squares import solved
from quavelet.calibration.model import Matrix, Vector
from quavelet.calibration.poses import StillPose, vector
from quavelet.core.blocks import Flag, FloatArray, ImuBlock
from quavelet.core.errors import CalibrationError
from quavelet.core.quaternion import from_rotation_vector, multiply, to_matrix
from quavelet.core.units import DEG_PER_RAD, RAD_PER_DEG

NAMES = tuple(f"scale {a}" if a == b else f"misalignment {a}{b}" for a in "xyz" for b in "xyz")
LIMITS = np.array([0.03 if i % 4 == 0 else 0.02 for i in range(9)])
PRIOR = 2.0 * LIMITS
DETERMINED = 0.3
ANGLE_SIGMA_RAD = 0.5 * RAD_PER_DEG
"""How well a board is brought back against an edge, one sigma."""
TILT_SIGMA_RAD = 0.05 * RAD_PER_DEG
RANDOM_WALK_RAD_RTS = 0.005 * RAD_PER_DEG
"""Angle random walk by the data sheet (PS 6.1: 0.005 deg/s/rtHz, one-sided) and more; the residuals say the rest."""
NEAREST_RAD = 20.0 * RAD_PER_DEG
"""So far from a whole number of quarter turns an integrated angle is none of them."""
SURE_ROWS = 5.0
"""The sigmas above count as so many measurements of them; then the residuals say."""
OUTLIER = 4.5


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Turn:
    """Samples between two still poses; N rows.

    rate_rad_s   (N, 3) as measured, less the bias
    period_s     (N,)
    before_up, after_up   gravity's direction in the body, up, calibrated
    angle_rad    turned about the board's `axis` (0, 1, 2), signed, whole turns counted; None: only that it ended still
    """

    rate_rad_s: FloatArray
    period_s: FloatArray
    before_up: Vector
    after_up: Vector
    axis: int | None = None
    angle_rad: float | None = None


@dataclass(frozen=True, slots=True)
class Trust:
    """One sigma of gravity's direction in a pose, and of an angle that is said to be known."""

    tilt_rad: float
    angle_rad: float


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class TurnFit:
    """rate = matrix (measured - bias).

    covariance     (12, 12) of the matrix, row by row, and of what was left of the bias, rad/s
    bias_rad_s     what the turns say is left of the bias
    undetermined   names of what the turns do not show
    residual_deg   (T, 3) of each turn, about the vertical last; where the angle was not known that is nan
    used           indices of the turns that were not thrown out
    """

    matrix: Matrix
    covariance: FloatArray
    bias_rad_s: Vector
    undetermined: tuple[str, ...]
    residual_deg: FloatArray
    used: tuple[int, ...]

    @property
    def sigma(self) -> FloatArray:
        """(9,) one sigma of the matrix, row by row."""
        return np.sqrt(np.diag(self.covariance)[:9])

    @property
    def scale_sigma(self) -> float:
        """One sigma of a turned angle, relative: the worst axis."""
        return float(self.sigma[[0, 4, 8]].max())


def fit_turns(
    turns: Sequence[Turn],
    *,
    bias_sigma_rad_s: float,
    angle_sigma_rad: float = ANGLE_SIGMA_RAD,
    accelerometer: AccelerometerFit | None = None,
    axes: tuple[Matrix, Matrix] | None = None,
) -> TurnFit:
    """Scale and misalignment of the gyroscope, in the axes of the accelerometer.

    bias_sigma_rad_s   one sigma of the bias that was taken off the rates
    angle_sigma_rad    of the angles that are said to be known
    accelerometer      by which gravity was seen: what it is off, all turns are, and the sigmas have it
    axes               a matrix from before, and its sigmas: of it the axes are believed, and the scale is found anew

    Raises CalibrationError where no axis' scale is found.
    """
    if not turns:
        raise CalibrationError("no turn shows the gyroscope's scale: turn the board about each of its axes")
    used, trust = list(range(len(turns))), Trust(TILT_SIGMA_RAD, angle_sigma_rad)
    prior, before = np.append(PRIOR, np.full(3, bias_sigma_rad_s)), np.eye(3)
    if axes is not None:
        before, across = np.array(axes[0]), np.flatnonzero(~np.eye(3, dtype=np.bool_))
        prior[across] = np.clip(np.ravel(axes[1])[across], 1e-6, prior[across])
        turns = [replace(turn, rate_rad_s=turn.rate_rad_s @ before.T) for turn in turns]
    while True:
        fit = solved(partial(_all_rows, turns=[turns[k] for k in used], trust=trust), prior_sigma=prior)
        size = np.array([np.abs(_rows(turns[k], fit.value, trust)[0]).max() for k in used])
        if size.max() <= OUTLIER or len(used) <= max(3, 0.75 * len(turns)):
            break
        used.pop(int(size.argmax()))
    kept = [turns[k] for k in used]
    is_tilt = np.concatenate([[True, True, False][: 2 if turn.angle_rad is None else 3] for turn in kept])
    seen = np.zeros((len(is_tilt), 0))
    for _ in range(3):
        if accelerometer is not None:
            seen = _by_accelerometer(kept, fit.value, trust, accelerometer)
        # What the accelerometer leaves in the residuals has its own place in the covariance.
        left = seen - fit.jacobian @ (fit.covariance @ fit.jacobian.T @ seen)
        known = (left**2).sum(axis=1)
        tilt, angle = (
            fit.observed_sigma(np.flatnonzero(rows), taken=taken, assumed=assumed, weight=SURE_ROWS, known=known)
            for rows, taken, assumed in (
                (is_tilt, trust.tilt_rad, TILT_SIGMA_RAD),
                (~is_tilt, trust.angle_rad, angle_sigma_rad),
            )
        )
        trust = Trust(tilt, angle)
        fit = solved(partial(_all_rows, turns=kept, trust=trust), prior_sigma=prior, start=fit.value)
    if accelerometer is not None:
        seen = _by_accelerometer(kept, fit.value, trust, accelerometer)
    shift = fit.covariance @ fit.jacobian.T @ seen
    covariance = fit.covariance + shift @ shift.T
    sigma = np.sqrt(np.diag(covariance)[:9])
    wanting = tuple(n for n, s, limit in zip(NAMES, sigma, LIMITS, strict=True) if s > DETERMINED * limit)
    if sum(name.startswith("scale") for name in wanting) == 3:
        raise CalibrationError("the turns show no axis' scale: turn the board by 360 degrees about each of its axes")
    x, y, z = (vector(row) for row in (np.eye(3) + fit.value[:9].reshape(3, 3)) @ before)
    return TurnFit(
        matrix=(x, y, z),
        covariance=covariance,
        bias_rad_s=vector(fit.value[9:]),
        undetermined=wanting,
        residual_deg=np.array([_residual_deg(turn, fit.value) for turn in turns]),
        used=tuple(used),
    )


def turn_between(block: ImuBlock, before: StillPose, after: StillPose, *, bias_rad_s: FloatArray) -> Turn:
    """The turn from one pose to the next, angle unknown; samples and poses with their forces calibrated.

    bias_rad_s   (3,), or a row for each of the block's samples (`BiasFit.rows`)

    Raises CalibrationError where samples are missing in between or a rate is beyond the range.
    """
    inside = (block.t_ns > before.end_ns) & (block.t_ns <= after.begin_ns)
    bad = block.flags[inside] & (Flag.GAP | Flag.GYRO_CLIPPED)
    if bad.any() or not inside.any():
        raise CalibrationError(
            "samples are missing within the turn, or its rate is beyond the range: turn again, slower"
        )
    up_before, up_after = (np.array(pose.accel_m_s2) for pose in (before, after))
    return Turn(
        rate_rad_s=(block.gyro_rad_s - bias_rad_s)[inside],
        period_s=block.period_s[inside],
        before_up=vector(up_before / np.linalg.norm(up_before)),
        after_up=vector(up_after / np.linalg.norm(up_after)),
    )


def turned_deg(turn: Turn) -> FloatArray:
    """(3,) rate added up about each of the board's axes, in degrees: whole turns counted, as measured."""
    total: FloatArray = DEG_PER_RAD * (turn.rate_rad_s * turn.period_s[:, None]).sum(axis=0)
    return total


def recognised(turn: Turn) -> tuple[int, float] | None:
    """Axis and angle in rad of a turn by a whole number of quarters about one of the board's axes, None for others."""
    total = RAD_PER_DEG * turned_deg(turn)
    axis = int(np.argmax(np.abs(total)))
    quarters = round(total[axis] / (np.pi / 2))
    across = np.delete(total, axis)
    # A few per cent of scale and cross-axis sensitivity grow with the angle.
    allowed = max(NEAREST_RAD, 0.06 * abs(float(total[axis])))
    if quarters == 0 or allowed > np.pi / 4 or np.abs(across).max() > allowed:
        return None
    angle = quarters * np.pi / 2
    return (axis, angle) if abs(total[axis] - angle) < allowed else None


def _all_rows(x: FloatArray, *, turns: Sequence[Turn], trust: Trust) -> tuple[FloatArray, FloatArray]:
    rows = [_rows(turn, x, trust) for turn in turns]
    return np.concatenate([row[0] for row in rows]), np.vstack([row[1] for row in rows])


def _rows(turn: Turn, x: FloatArray, trust: Trust) -> tuple[FloatArray, FloatArray]:
    """Residuals (2,) or (3,) in sigmas and Jacobian: the turn left over, in the axes of the pose it ends in."""
    total, change = _integrated(turn, x)
    left = _left_over(turn, total, np.array(turn.before_up), np.array(turn.after_up))
    skew = _skew(left)
    jacobian = (np.eye(3) + 0.5 * skew + skew @ skew / 12.0) @ change
    weights = _weights(turn, trust)
    return weights @ left, weights @ jacobian


def _weights(turn: Turn, trust: Trust) -> FloatArray:
    """(2, 3) or (3, 3): from a rotation left over to residuals, two of tilt and, where the angle is known, heading."""
    walk = RANDOM_WALK_RAD_RTS * np.sqrt(turn.period_s.sum())
    tilt, angle = np.hypot(trust.tilt_rad, walk), np.hypot(trust.angle_rad, walk)
    weights: FloatArray = _standing(np.array(turn.after_up)) / np.array([tilt, tilt, angle])[:, None]
    return weights[: 2 if turn.angle_rad is None else 3]


def _residual_deg(turn: Turn, x: FloatArray) -> FloatArray:
    before, after = np.array(turn.before_up), np.array(turn.after_up)
    residual: FloatArray = DEG_PER_RAD * _standing(after) @ _left_over(turn, _integrated(turn, x)[0], before, after)
    if turn.angle_rad is None:
        residual[2] = np.nan
    return residual


def _by_accelerometer(
    turns: Sequence[Turn], x: FloatArray, trust: Trust, accelerometer: AccelerometerFit
) -> FloatArray:
    """How the residuals change by one sigma of each of the accelerometer's twelve independent errors (R, 12)."""
    matrix = np.array(accelerometer.matrix)
    inverse = np.linalg.inv(matrix)
    step = 1e-4
    rows = []
    for turn in turns:
        total, _ = _integrated(turn, x)
        weights = _weights(turn, trust)
        ups = np.array(turn.before_up), np.array(turn.after_up)
        # up = matrix (measured - offset), of length one.
        moves = [np.hstack([-matrix, np.kron(np.eye(3), inverse @ up)]) for up in ups]
        plain = _left_over(turn, total, *ups)
        columns = []
        for k in range(12):
            before, after = (
                (up + step * move[:, k]) / np.linalg.norm(up + step * move[:, k])
                for up, move in zip(ups, moves, strict=True)
            )
            columns.append((_left_over(turn, total, before, after) - plain) / step)
        rows.append(weights @ np.stack(columns, axis=1))
    variance, mixture = np.linalg.eigh(accelerometer.covariance)
    change: FloatArray = np.vstack(rows) @ (mixture * np.sqrt(np.maximum(variance, 0.0)))
    return change


def _integrated(turn: Turn, x: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The turn (3, 3), body after to body before, and how it turns on, in the body after, by each parameter (3, 12)."""
    matrix, bias = np.eye(3) + x[:9].reshape(3, 3), x[9:]
    clean = turn.rate_rad_s - bias
    step = clean @ matrix.T * turn.period_s[:, None]
    quaternions = _running_product(from_rotation_vector(step))
    total = to_matrix(quaternions[-1:])[0]
    # The middle of each step as seen from the end: the error of a step turns the rest of the way with the board.
    seen = total.T @ to_matrix(multiply(quaternions, from_rotation_vector(-0.5 * step)))
    moved = clean * turn.period_s[:, None]
    by_matrix = np.einsum("nik,nj->ikj", seen, moved).reshape(3, 9)
    by_bias = -np.einsum("nik,n->ik", seen, turn.period_s) @ matrix
    return total, np.hstack([by_matrix, by_bias])


def _left_over(turn: Turn, total: FloatArray, before: FloatArray, after: FloatArray) -> FloatArray:
    """The rotation (3,) between the integrated turn and what it was, in the body as it is after the turn."""
    expected = total if turn.angle_rad is None or turn.axis is None else _about(turn.axis, turn.angle_rad)
    # The expected turn, corrected by as little as makes gravity agree in both poses.
    true = expected @ _shortest(after, expected.T @ before)
    return _rotation_vector(true.T @ total)


def _running_product(q: FloatArray) -> FloatArray:
    """(N, 4): the product of all quaternions up to each, by doubling: log2 N vector operations."""
    product, step = q.copy(), 1
    while step < len(product):
        product[step:] = multiply(product[:-step], product[step:])
        step *= 2
    return product


def _about(axis: int, angle_rad: float) -> FloatArray:
    rotation: FloatArray = to_matrix(from_rotation_vector(angle_rad * np.eye(3)[axis : axis + 1]))[0]
    return rotation


def _shortest(a: FloatArray, b: FloatArray) -> FloatArray:
    """The shortest rotation that takes unit vector a to b, which are not opposite."""
    skew = _skew(np.cross(a, b))
    turned: FloatArray = np.eye(3) + skew + skew @ skew / (1.0 + float(a @ b))
    return turned


def _skew(v: FloatArray) -> FloatArray:
    x, y, z = v
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


def _rotation_vector(c: FloatArray) -> FloatArray:
    """The rotation vector (3,) of a matrix whose angle is below pi."""
    axis = 0.5 * np.array([c[2, 1] - c[1, 2], c[0, 2] - c[2, 0], c[1, 0] - c[0, 1]])
    sine = float(np.linalg.norm(axis))
    angle = np.arctan2(sine, 0.5 * (float(np.trace(c)) - 1.0))
    vector_rad: FloatArray = axis * (angle / sine if sine > 1e-12 else 1.0)
    return vector_rad


def _standing(up: FloatArray) -> FloatArray:
    """(3, 3) rows: two horizontal directions, then up."""
    side = np.cross(up, np.eye(3)[int(np.argmin(np.abs(up)))])
    side /= np.linalg.norm(side)
    return np.stack([side, np.cross(up, side), up])
