"""Where the horizon is, from a velocity that cannot grow: a Kalman filter over short chunks of motion.

Rotated into the world by the gyroscope's attitude and summed up, the accelerometer gives a velocity. A board that is
carried about keeps its velocity near zero however hard it is shaken, while a tilt error makes it grow by g times the
error every second, so the velocity found is the tilt error's trace. For a constant gain that is a second order
Butterworth low-pass of the acceleration in an almost inertial frame, the idea of Laidig and Seel (VQF, 2023); as a
Kalman filter it also starts fast, learns the rate's bias and scale, and says how sure it is.

The error's ten numbers: tilt about world x and y in rad, velocity along them in m/s, and for x y z of the body the
rate's bias in rad/s and relative scale. An uncalibrated scale is off by up to 3 % (PS 6.1), half a degree for every
twenty turned; each turn about a horizontal axis shows it.
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
TURNING, TURNING_LEAST = 0.5, 5e-4
"""Of the rate's size, in sqrt(s), a noise that grows with the rate: what is left of the scale's sigma in errors across
the axes and over the range, and no less than that for the best."""
BIAS_WALK_RAD = 5e-4 * RAD_PER_DEG
"""How a bias wanders, rad/s/sqrt(s): 0.004 deg/s in a minute."""
SURPRISE = 20.0
"""A velocity is believed up to so many sigma: a fall is none that stays near zero."""
MISFIT_TAU_S = 5.0
SCALE_WALK = 2e-5
"""How a scale wanders, 1/sqrt(s): 0.06 % in a quarter of an hour, as the chip warms."""
BLIND_RAD_S = 3.0
"""One sigma of a rate beyond the range."""
SWAY_TAU_S, AGITATION_TAU_S = 1.5, 3.0
AGITATION, WILDEST = 10.0, 3000.0
"""A board that is thrown about keeps a velocity that goes with its acceleration: its mean square in (m/s^2)^2, without
what lasts longer than SWAY_TAU_S, times AGITATION is how much more of the velocity is believed to be real, where that
is more than 1, and up to WILDEST."""

TILT, VELOCITY, BIAS, SCALE = slice(0, 2), slice(2, 4), slice(4, 7), slice(7, 10)


@dataclass(frozen=True, slots=True)
class Swing:
    """What one chunk of motion adds up to.

    duration_s   its length
    velocity     change of the horizontal velocity in m/s, world x and y
    across       2 by 3, row by row: the integral of the attitude matrix' horizontal rows, s
    spin         2 by 3: the same, each column times the rate about its axis, rad
    turning      integral of the squared rate, rad^2/s
    blind_s      time for which a rate stood at the end of its range
    """

    duration_s: float = 0.0
    velocity: tuple[float, float] = (0.0, 0.0)
    across: tuple[float, ...] = (0.0,) * 6
    spin: tuple[float, ...] = (0.0,) * 6
    turning: float = 0.0
    blind_s: float = 0.0


@dataclass(frozen=True, slots=True, eq=False)
class Horizon:
    """The filter's memory.

    cov        (10, 10) covariance of the error
    velocity   the velocity found, m/s
    misfit     how much larger its square is than it should be, running mean
    sway       the horizontal acceleration's running mean, m/s^2
    agitation  running mean of the square of what it departs from that, (m/s^2)^2
    """

    cov: FloatArray
    velocity: tuple[float, float] = (0.0, 0.0)
    misfit: float = 1.0
    sway: tuple[float, float] = (0.0, 0.0)
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
    def scale_cov(self) -> FloatArray:
        """(3, 3) covariance of the axes' relative scales."""
        return self.cov[SCALE, SCALE].copy()

    def with_tilt(self, tilt_rad: float) -> Horizon:
        """The same knowledge of bias and scale, the tilt known to `tilt_rad` (one sigma), the board at rest."""
        return started(tilt_rad, self.bias_variance, self.scale_cov)


@dataclass(frozen=True, slots=True)
class Found:
    """What is to be corrected: rotation about world x and y in rad, and what bias and scale are more than thought."""

    tilt_rad: tuple[float, float]
    bias_rad_s: Vector
    scale: Vector


def started(tilt_rad: float, bias_variance: FloatArray, scale_cov: FloatArray) -> Horizon:
    """Nothing known but this."""
    cov = np.diag(np.concatenate([np.full(2, tilt_rad * tilt_rad), np.zeros(2), bias_variance, np.zeros(3)]))
    cov[SCALE, SCALE] = scale_cov
    return Horizon(cov)


def velocity_density(tau_s: float) -> float:
    """The squared density in (m/s)^2 s of a carried board's velocity for which the filter's time constant is tau_s."""
    return (STANDARD_GRAVITY_M_S2 * GYRO_DENSITY_RAD) ** 2 * tau_s**4


def after_swing(h: Horizon, swing: Swing, *, density: float, scale_sigma: float) -> tuple[Horizon, Found]:
    """The memory after one more chunk, and what it found; scale_sigma is the scale's before anything was learned."""
    t, g = swing.duration_s, STANDARD_GRAVITY_M_S2
    across, spin = np.array(swing.across).reshape(2, 3), np.array(swing.spin).reshape(2, 3)
    f = np.eye(10)
    f[TILT, BIAS], f[TILT, SCALE] = -across, spin
    f[2, 1], f[3, 0] = g * t, -g * t
    f[2, BIAS], f[3, BIAS] = -0.5 * g * t * across[1], 0.5 * g * t * across[0]
    f[2, SCALE], f[3, SCALE] = 0.5 * g * t * spin[1], -0.5 * g * t * spin[0]
    p = f @ h.cov @ f.T
    turning = max(TURNING * scale_sigma, TURNING_LEAST)
    spread = GYRO_DENSITY_RAD**2 * t + turning**2 * swing.turning + (BLIND_RAD_S * swing.blind_s) ** 2
    p[[0, 1], [0, 1]] += spread
    p[[4, 5, 6], [4, 5, 6]] += BIAS_WALK_RAD**2 * t
    p[[7, 8, 9], [7, 8, 9]] += SCALE_WALK**2 * t
    sway, agitation = _agitated(h, swing)
    density *= min(max(1.0, AGITATION * agitation), WILDEST)
    velocity = np.array(h.velocity) + swing.velocity
    found, square = np.zeros(10), 0.0
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
    tilt_x, tilt_y, _, _, bx, by, bz, sx, sy, sz = found.tolist()
    vx, vy = velocity.tolist()
    horizon = Horizon(0.5 * (p + p.T), (vx, vy), h.misfit + fade * (square - h.misfit), sway, agitation)
    return horizon, Found((tilt_x, tilt_y), (bx, by, bz), (sx, sy, sz))


def _agitated(h: Horizon, swing: Swing) -> tuple[tuple[float, float], float]:
    """The running means of the horizontal acceleration, and of its square without them."""
    t = swing.duration_s
    fade = t / (SWAY_TAU_S + t)
    ax, ay = swing.velocity[0] / t, swing.velocity[1] / t
    sway = (h.sway[0] + fade * (ax - h.sway[0]), h.sway[1] + fade * (ay - h.sway[1]))
    square = (ax - sway[0]) ** 2 + (ay - sway[1]) ** 2
    return sway, h.agitation + t / (AGITATION_TAU_S + t) * (square - h.agitation)
