"""The PID correction of paper 000: from the tilt error to a rate that is added to the gyroscope's."""

from __future__ import annotations

from dataclasses import dataclass

from quavelet.attitude.kernel import ZERO, Vector, across, clamped


@dataclass(frozen=True, slots=True)
class Gains:
    """kp 1/s, ki 1/s^2, kd (no unit), the derivative's low-pass in s, and the integral's limit in rad/s."""

    kp: float
    ki: float
    kd: float
    kd_tau_s: float
    integral_limit_rad_s: float


@dataclass(frozen=True, slots=True)
class Correction:
    """The loop's memory and what it gives.

    rate_rad_s      to be added to the measured rate: kp e + integral + kd D
    integral_rad_s  the integral's part of it, the negative of a bias
    derivative      D, the low-passed derivative of the error, rad/s
    error_rad       the last error
    """

    rate_rad_s: Vector = ZERO
    integral_rad_s: Vector = ZERO
    derivative: Vector = ZERO
    error_rad: Vector = ZERO


def corrected(last: Correction, error: Vector, up: Vector, dt: float, gains: Gains) -> Correction:
    """The correction after one more step with this tilt error; `up` is the world's up in the body.

    The derivative is low-passed: unfiltered it would pass the accelerometer's noise straight on, with a
    gain of sqrt(kd^2/(1-kd^2)). Its part along `up` is taken off, for gravity must not steer heading;
    the error itself has none. The integral may have one: a bias found while another axis was up.
    """
    ex, ey, ez = error
    ix, iy, iz = last.integral_rad_s
    step = gains.ki * dt
    integral = clamped((ix + step * ex, iy + step * ey, iz + step * ez), gains.integral_limit_rad_s)
    derivative = last.derivative
    if gains.kd > 0.0:
        lx, ly, lz = last.error_rad
        dx, dy, dz = derivative
        share = dt / (gains.kd_tau_s + dt)
        derivative = (
            dx + share * ((ex - lx) / dt - dx),
            dy + share * ((ey - ly) / dt - dy),
            dz + share * ((ez - lz) / dt - dz),
        )
    dx, dy, dz = across(derivative, up)
    kp, kd = gains.kp, gains.kd
    rate = (kp * ex + integral[0] + kd * dx, kp * ey + integral[1] + kd * dy, kp * ez + integral[2] + kd * dz)
    return Correction(rate, integral, derivative, error)
