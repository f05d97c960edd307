"""Where the horizon is, from a velocity that cannot grow: a Kalman filter over short chunks of motion.

Rotated into the world by the gyroscope's attitude and summed up, the accelerometer gives a velocity. A board that is
carried about keeps its velocity near zero however hard it is shaken, while a tilt error makes it grow by g times the
error every second, so the velocity found is the tilt error's trace. For a constant gain that is a second order
Butterworth low-pass of the acceleration in an almost inertial frame, the idea of Laidig and Seel (VQF, 2023); as a
Kalman filter it also starts fast, learns the rate's bias, and says how sure it is.

The error's seven numbers: tilt about world x and y in rad, velocity along them in m/s, bias x y z of the body in rad/s.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import sqrt

import numpy as np

from quavelet.attitude.kernel import Vector
from quavelet.core.blocks import FloatArray
from quavelet.core.units import RAD_PER_DEG, STANDARD_GRAVITY_M_S2

GYRO_DENSITY_RAD = 0.03 * RAD_PER_DEG
"""Rate noise in rad/s/rtHz. Real chips lying still show 0.013 to 0.02 deg/s/rtHz; moving, they are worse."""
TURNING = 5e-4
"""Of the rate's size, in sqrt(s): scale and cross-axis errors, as a noise that grows with the rate."""
BIAS_WALK_RAD = 5e-4 * RAD_PER_DEG
"""How a bias wanders, rad/s/sqrt(s): 0.004 deg/s in a minute."""
SURPRISE = 20.0
"""A velocity is believed up to so many sigma: a fall is none that stays near zero."""
MISFIT_TAU_S = 5.0
BLIND_RAD_S = 3.0
"""One sigma of a rate beyond the range."""
LEAN_TAU_S = 8.0
LEAN_SHARE = 0.3
WORST = 20.0
"""A velocity that leans to one side for LEAN_TAU_S, where noise would do so by far less, is no motion: the tilt is
wrong, and the gyroscope's scale worse than TURNING, up to WORST times (an uncalibrated one has 3 %)."""

TILT, VELOCITY, BIAS = slice(0, 2), slice(2, 4), slice(4, 7)


@dataclass(frozen=True, slots=True)
class Swing:
    """What one chunk of motion adds up to.

    duration_s   its length
    velocity     change of the horizontal velocity in m/s, world x and y
    across       2 by 3, row by row: the integral of the attitude matrix' horizontal rows, s
    turning      integral of the squared rate, rad^2/s
    blind_s      time for which a rate stood at the end of its range
    """

    duration_s: float = 0.0
    velocity: tuple[float, float] = (0.0, 0.0)
    across: tuple[float, ...] = (0.0,) * 6
    turning: float = 0.0
    blind_s: float = 0.0


@dataclass(frozen=True, slots=True, eq=False)
class Horizon:
    """The filter's memory.

    cov       (7, 7) covariance of the error
    velocity  the velocity found, m/s
    misfit    how much larger its square is than it should be, running mean
    lean      its own running mean, m/s
    """

    cov: FloatArray
    velocity: tuple[float, float] = (0.0, 0.0)
    misfit: float = 1.0
    lean: tuple[float, float] = (0.0, 0.0)

    @property
    def tilt_ms(self) -> float:
        """Mean square of the tilt error about one axis, rad^2; more than the model says where motion shows it."""
        return float(0.5 * (self.cov[0, 0] + self.cov[1, 1])) * max(1.0, self.misfit)

    @property
    def bias_variance(self) -> FloatArray:
        """Variance of each axis' bias, (rad/s)^2."""
        return np.diag(self.cov)[BIAS].copy()

    def with_tilt(self, tilt_rad: float) -> Horizon:
        """The same knowledge of the bias, the tilt known to `tilt_rad` (one sigma), the board at rest."""
        return started(tilt_rad, self.bias_variance)


@dataclass(frozen=True, slots=True)
class Found:
    """What is to be corrected: rotation about world x and y in rad, and what the bias is more than thought."""

    tilt_rad: tuple[float, float]
    bias_rad_s: Vector


def started(tilt_rad: float, bias_variance: FloatArray) -> Horizon:
    """Nothing known but this."""
    return Horizon(np.diag(np.concatenate([np.full(2, tilt_rad * tilt_rad), np.zeros(2), bias_variance])))


def velocity_density(tau_s: float) -> float:
    """The squared density in (m/s)^2 s of a carried board's velocity for which the filter's time constant is tau_s."""
    return (STANDARD_GRAVITY_M_S2 * GYRO_DENSITY_RAD) ** 2 * tau_s**4


def after_swing(h: Horizon, swing: Swing, *, density: float) -> tuple[Horizon, Found]:
    """The memory after one more chunk, and what it found."""
    t, g = swing.duration_s, STANDARD_GRAVITY_M_S2
    across = np.array(swing.across).reshape(2, 3)
    f = np.eye(7)
    f[TILT, BIAS] = -across
    f[2, 1], f[3, 0] = g * t, -g * t
    f[2, BIAS], f[3, BIAS] = -0.5 * g * t * across[1], 0.5 * g * t * across[0]
    p = f @ h.cov @ f.T
    lean_ms = (h.lean[0] * h.lean[0] + h.lean[1] * h.lean[1]) * LEAN_TAU_S / density
    worse = min(max(1.0, LEAN_SHARE * lean_ms), WORST * WORST)
    spread = GYRO_DENSITY_RAD * GYRO_DENSITY_RAD * t + worse * TURNING * TURNING * swing.turning
    spread += (BLIND_RAD_S * swing.blind_s) ** 2
    p[0, 0] += spread
    p[1, 1] += spread
    for i in (4, 5, 6):
        p[i, i] += BIAS_WALK_RAD * BIAS_WALK_RAD * t
    velocity = np.array(h.velocity) + swing.velocity
    fade = t / (LEAN_TAU_S + t)
    lean = (h.lean[0] + fade * (float(velocity[0]) - h.lean[0]), h.lean[1] + fade * (float(velocity[1]) - h.lean[1]))
    found, square = np.zeros(7), 0.0
    for axis in (2, 3):
        variance = p[axis, axis] + density / t
        gain = p[:, axis] / variance
        surprise = -velocity[axis - 2] - found[axis]
        square += 0.5 * float(surprise * surprise / variance)
        limit = SURPRISE * sqrt(variance)
        found += gain * min(max(surprise, -limit), limit)
        p = p - np.outer(gain, p[axis])
    velocity += found[VELOCITY]
    fade = t / (MISFIT_TAU_S + t)
    tilt_x, tilt_y, _, _, bx, by, bz = found.tolist()
    vx, vy = velocity.tolist()
    horizon = Horizon(0.5 * (p + p.T), (vx, vy), h.misfit + fade * (square - h.misfit), lean)
    return horizon, Found((tilt_x, tilt_y), (bx, by, bz))
