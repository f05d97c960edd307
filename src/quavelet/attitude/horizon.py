"""Where the horizon is, from a velocity that cannot grow: a Kalman filter over short chunks of motion.

Rotated into the world by the gyroscope's attitude and summed up, the accelerometer gives a velocity. A board that is
carried about keeps its velocity near zero however hard it is shaken, while a tilt error makes it grow by g times the
error every second, so the velocity found is the tilt error's trace. For a constant gain that is a second order
Butterworth low-pass of the acceleration in an almost inertial frame, the idea of Laidig and Seel (VQF, 2023); as a
Kalman filter it also starts fast, learns the rate's bias and the gyroscope's matrix, and says how sure it is.

The error's sixteen numbers: tilt about world x and y in rad, velocity along them in m/s, bias x y z of the body in
rad/s, and the gyroscope's matrix row by row. As bought its scale is off by up to 3 % and up to 2 % goes across the
axes (PS 6.1), half a degree for every twenty turned, and each turn about a horizontal axis shows it.

An accelerometer that is off, or late, shows the same to a board that always turns the same way. Its own errors are
not learned, for the attitude is to follow it; but what they may have made of each number is carried along, and the
matrix is learned only as far as they cannot be the cause (a Schmidt-Kalman filter in these rows).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import sqrt

import numpy as np

from quavelet.attitude.doubt import Residual
from quavelet.attitude.kernel import Quaternion, Vector
from quavelet.attitude.swing import Swing
from quavelet.core.blocks import FloatArray
from quavelet.core.quaternion import to_matrix
from quavelet.core.units import RAD_PER_DEG, STANDARD_GRAVITY_M_S2

GYRO_DENSITY_RAD = 0.03 * RAD_PER_DEG
"""Rate noise in rad/s/rtHz. Real chips lying still show 0.013 to 0.02 deg/s/rtHz; moving, they are worse."""
TURNING = 5e-4
"""Of the rate's size, in sqrt(s): errors over the range and by acceleration, as a noise that grows with the rate."""
BIAS_WALK_RAD = 5e-4 * RAD_PER_DEG
"""How a bias wanders, rad/s/sqrt(s): 0.004 deg/s in a minute."""
MATRIX_WALK = 2e-5
"""How a scale wanders, 1/sqrt(s): 0.06 % in a quarter of an hour, as the chip warms."""
ACROSS = 2.0 / 3.0
"""A gyroscope's errors across the axes in units of those of its scale (PS 6.1: 2 and 3 %)."""
OFFSET_SHARE, FORCE_SCALE_SHARE, FORCE_ACROSS_SHARE = 0.75, 0.43, 0.29
"""Of the accelerometer's residual as a tilt: offset, scale and cross-axis error (PS 6.2: 50 mg, 3 and 2 % in 40 mg)."""
LEARNED_SIGMAS = 2.0
"""The matrix is off by no more than so many sigma of what the motion has shown of it. Errors that are no noise push a
number that is hardly seen for hours, always the same way."""
LAG_S = 0.005
"""One sigma of the force's delay against the rate's: half a sample of a slow one, or filters that differ."""
SURPRISE = 20.0
"""A velocity is believed up to so many sigma: a fall is none that stays near zero."""
MISFIT_TAU_S = 5.0
BLIND_RAD_S = 3.0
"""One sigma of a rate beyond the range."""
SWAY_TAU_S, AGITATION_TAU_S = 1.5, 3.0
AGITATION, WILDEST = 10.0, 3000.0
"""A board that is thrown about has a velocity of its own. The size of the force says so, whatever the attitude: the
mean square in (m/s^2)^2 of what it departs from its running mean, times AGITATION, is how much more of the velocity is
taken to be real, where that is more than 1, and up to WILDEST."""

TILT, VELOCITY, BIAS, MATRIX = slice(0, 2), slice(2, 4), slice(4, 7), slice(7, 16)
_DIAGONAL = np.eye(3, dtype=bool).ravel()


@dataclass(frozen=True, slots=True, eq=False)
class Horizon:
    """The filter's memory.

    cov        (16, 16) covariance of the error, were the accelerometer right
    influence  (16, 13) what an accelerometer's offset in m/s^2, matrix and delay in s have made of each number
    matrix_ms  (9,) mean squares of the gyroscope's matrix, less the identity, before anything was learned
    force_ms   (13,) mean squares of the accelerometer's errors
    matrix     what the rate less its bias is to be multiplied by, less the identity, row by row
    velocity   the velocity found, m/s
    misfit     how much larger its square is than it should be, running mean
    force      running mean of the force's size, m/s^2; 0 before the first swing
    agitation  running mean of the square of what it departs from that, (m/s^2)^2
    """

    cov: FloatArray
    influence: FloatArray
    matrix_ms: FloatArray
    force_ms: FloatArray
    matrix: tuple[float, ...] = (0.0,) * 9
    velocity: tuple[float, float] = (0.0, 0.0)
    misfit: float = 1.0
    force: float = 0.0
    agitation: float = 0.0

    @property
    def tilt_ms(self) -> float:
        """Mean square of the tilt error about one axis, rad^2; more than the model says where motion shows it."""
        return float(0.5 * (self.cov[0, 0] + self.cov[1, 1])) * max(1.0, self.misfit)

    @property
    def bias_variance(self) -> FloatArray:
        """Variance of each axis' bias, (rad/s)^2."""
        return np.diag(self.cov)[BIAS].copy()

    @property
    def matrix_variance(self) -> FloatArray:
        """Variance (9,) of what the matrix still is wrong by."""
        by_force: FloatArray = self.influence[MATRIX] ** 2 @ self.force_ms
        return np.diag(self.cov)[MATRIX] + by_force

    def restarted(self, q: Quaternion, tilt_rad: float, bias_variance: FloatArray) -> Horizon:
        """The same knowledge of the matrix, the board in the attitude `q`, which is the accelerometer's mean to
        `tilt_rad` (one sigma), and at no velocity."""
        cov, influence = np.zeros_like(self.cov), np.zeros_like(self.influence)
        cov[TILT, TILT] = tilt_rad * tilt_rad * np.eye(2)
        cov[BIAS, BIAS] = np.diag(bias_variance)
        cov[MATRIX, MATRIX] = self.cov[MATRIX, MATRIX]
        influence[MATRIX] = self.influence[MATRIX]
        rows = to_matrix(np.array(q))
        pull = STANDARD_GRAVITY_M_S2 * (rows[:2, :, None] * rows[2]).reshape(2, 9)
        along_x, along_y = _by_force(rows[:2], pull, np.zeros(2))
        influence[TILT] = np.stack([-along_y, along_x]) / STANDARD_GRAVITY_M_S2
        return Horizon(cov, influence, self.matrix_ms, self.force_ms, self.matrix)


@dataclass(frozen=True, slots=True)
class Found:
    """What is to be corrected: rotation about world x and y in rad, and what the bias is more than thought."""

    tilt_rad: tuple[float, float]
    bias_rad_s: Vector


def unseen(residual: Residual) -> Horizon:
    """Before the first sample: nothing but what the calibration leaves open."""
    matrix = residual.gyro_scale * np.where(_DIAGONAL, 1.0, ACROSS)
    offset = np.full(3, OFFSET_SHARE * STANDARD_GRAVITY_M_S2)
    force = residual.tilt_rad * np.concatenate([offset, np.where(_DIAGONAL, FORCE_SCALE_SHARE, FORCE_ACROSS_SHARE)])
    force = np.append(force, LAG_S)
    cov = np.diag(np.concatenate([np.zeros(7), matrix**2]))
    return Horizon(cov, np.zeros((len(cov), len(force))), matrix**2, force**2)


def velocity_density(tau_s: float) -> float:
    """The squared density in (m/s)^2 s of a carried board's velocity for which the filter's time constant is tau_s."""
    return (STANDARD_GRAVITY_M_S2 * GYRO_DENSITY_RAD) ** 2 * tau_s**4


def after_swing(h: Horizon, swing: Swing, *, density: float) -> tuple[Horizon, Found]:
    """The memory after one more chunk, and what it found."""
    h = _agitated(_moved(h, swing), swing)
    cov, influence, numbers = h.cov, h.influence, len(h.cov)
    noise = density * min(max(1.0, AGITATION * h.agitation), WILDEST) / swing.duration_s
    velocity = np.array(h.velocity) + swing.velocity
    found, square = np.zeros(numbers), 0.0
    for axis in (2, 3):
        row, shown = cov[axis], influence[axis]
        variance, by_force = float(row[axis]) + noise, shown * h.force_ms
        gain = row / variance
        gain[MATRIX] = (row[MATRIX] + influence[MATRIX] @ by_force) / (variance + float(shown @ by_force))
        surprise = -velocity[axis - 2] - found[axis]
        square += 0.5 * float(surprise * surprise / variance)
        limit = SURPRISE * sqrt(variance)
        found += gain * min(max(surprise, -limit), limit)
        # For any gain, not only the best: the matrix has another one than the rest.
        cov = cov - np.outer(gain, row) - np.outer(row, gain) + variance * np.outer(gain, gain)
        influence = influence - np.outer(gain, shown)
    fade = swing.duration_s / (MISFIT_TAU_S + swing.duration_s)
    vx, vy = (velocity + found[VELOCITY]).tolist()
    after = replace(
        h,
        cov=0.5 * (cov + cov.T),
        influence=influence,
        velocity=(vx, vy),
        misfit=h.misfit + fade * (square - h.misfit),
    )
    tilt_x, tilt_y, _, _, bx, by, bz = found[:7].tolist()
    return _learned(after, found[MATRIX]), Found((tilt_x, tilt_y), (bx, by, bz))


def _moved(h: Horizon, swing: Swing) -> Horizon:
    """How the errors go on through one chunk."""
    t, g = swing.duration_s, STANDARD_GRAVITY_M_S2
    f = np.eye(len(h.cov))
    f[TILT, BIAS], f[TILT, MATRIX] = -swing.across, swing.spin
    f[2, 1], f[3, 0] = g * t, -g * t
    f[2, 4:], f[3, 4:] = 0.5 * g * t * f[1, 4:], -0.5 * g * t * f[0, 4:]
    cov, influence = f @ h.cov @ f.T, f @ h.influence
    influence[VELOCITY] -= _by_force(swing.across, swing.pull, swing.swept)
    spread = GYRO_DENSITY_RAD**2 * t + TURNING**2 * swing.turning + (BLIND_RAD_S * swing.blind_s) ** 2
    walk = np.repeat([spread, 0.0, BIAS_WALK_RAD**2 * t, MATRIX_WALK**2 * t], [2, 2, 3, 9])
    return replace(h, cov=cov + np.diag(walk), influence=influence)


def _by_force(across: FloatArray, pull: FloatArray, swept: FloatArray) -> FloatArray:
    """(2, 13) what the accelerometer's errors add to what it shows along the horizontal."""
    return np.concatenate([across, pull, swept[:, None]], axis=1)


def _learned(h: Horizon, found: FloatArray) -> Horizon:
    most = LEARNED_SIGMAS * np.sqrt(np.maximum(0.0, h.matrix_ms - h.matrix_variance))
    return replace(h, matrix=tuple(np.clip(h.matrix + found, -most, most).tolist()))


def _agitated(h: Horizon, swing: Swing) -> Horizon:
    t = swing.duration_s
    force = h.force + t / (SWAY_TAU_S + t) * (swing.force - h.force) if h.force else swing.force
    square = (swing.force - force) ** 2
    return replace(h, force=force, agitation=h.agitation + t / (AGITATION_TAU_S + t) * (square - h.agitation))
