"""The attitude from gravity and the earth's own rate, at a known latitude: gyrocompassing (Xu et al., 2020)."""

from __future__ import annotations

from math import cos, hypot, inf, sin, tan

import numpy as np

from quavelet.alignment.result import (
    EARTH_RATE_RAD_S,
    HEADING_LIMIT_RAD,
    POLE_COSINE,
    Alignment,
    Heading,
    good_to,
    with_heading,
    without_heading,
)
from quavelet.alignment.sensors import (
    SensorErrors,
    checked,
    checked_force,
    checked_period,
    mean_and_sigma,
    world_sigma,
)
from quavelet.alignment.two_vectors import UP, level_matrix, tilt_sigma, triad
from quavelet.core.blocks import FloatArray
from quavelet.core.units import DEG_PER_RAD

SURPRISE = 5.0
"""A rate that is so many sigmas off the earth's is another one."""


def earth_rate_matrix(gyro_rad_s: FloatArray, accel_m_s2: FloatArray, *, latitude_rad: float) -> FloatArray:
    """Rotation matrices (..., 3, 3), body to ENU, of mean rates and forces (..., 3); it judges nothing.

    By TRIAD. The paper's inverse of [f, f x w, (f x w) x f] is not orthogonal with noise, and its gravity of -g up
    goes with no accelerometer that reads +g up.
    """
    return triad(UP, np.array([0.0, cos(latitude_rad), sin(latitude_rad)]), accel_m_s2, gyro_rad_s)


def gyrocompass(errors: SensorErrors, *, latitude_rad: float, tilt_rad: float = 0.0) -> tuple[Heading, float, str]:
    """Whether such a gyroscope can find north at this latitude: the verdict, the heading's sigma in rad, a sentence.

    heading error = eps_E / (w_ie cos L) - tilt tan L, for whatever method takes north from the earth's rate.
    tilt_rad is one sigma of the tilt about north.
    """
    return judged(errors.gyro_bias_rad_s, latitude_rad=latitude_rad, tilt_rad=tilt_rad)


def judged(rate_sigma_rad_s: float, *, latitude_rad: float, tilt_rad: float) -> tuple[Heading, float, str]:
    """As `gyrocompass`, from one sigma of the mean rate along east."""
    horizontal = cos(latitude_rad)
    if abs(horizontal) < POLE_COSINE:
        where = f"latitude {DEG_PER_RAD * latitude_rad:.1f} deg"
        return Heading.NEAR_POLE, inf, f"{where} is within a degree of a pole, where the earth's rate is vertical"
    heading = hypot(rate_sigma_rad_s / (EARTH_RATE_RAD_S * horizontal), tilt_rad * tan(latitude_rad))
    figures = (
        f"{good_to(heading)}: {DEG_PER_RAD * rate_sigma_rad_s:.2g} deg/s of gyroscope error "
        f"in {DEG_PER_RAD * EARTH_RATE_RAD_S * horizontal:.4f} deg/s of horizontal earth rate"
    )
    hidden = heading > HEADING_LIMIT_RAD
    return (Heading.EARTH_RATE_HIDDEN if hidden else Heading.OBSERVED), heading, figures


def align_earth_rate(
    gyro_rad_s: FloatArray,
    accel_m_s2: FloatArray,
    *,
    period_s: float,
    latitude_rad: float,
    errors: SensorErrors,
) -> Alignment:
    """Attitude from the means of rate and specific force, each (N, 3), of a board at rest on the earth.

    The gyroscope's bias must come off by a calibration: one taken from this very rest takes the earth's rate with it.
    Disturbed data is denoised before (median 13, then db4 over 5 levels, soft): a mean bears no impulses.
    Raises ValueError where samples are not finite or not gravity, or the latitude is none.
    """
    if not abs(latitude_rad) <= np.pi / 2:
        raise ValueError(f"latitude_rad = {latitude_rad:g} is no latitude: give -pi/2 to pi/2, north positive")
    period_s = checked_period(period_s)
    force, force_sigma = mean_and_sigma(
        checked_force(accel_m_s2), noise_sd=errors.accel_sd_m_s2(period_s), bias_sigma=errors.accel_bias_m_s2
    )
    rate, rate_sigma = mean_and_sigma(
        checked(gyro_rad_s, name="gyro_rad_s"),
        noise_sd=errors.gyro_sd_rad_s(period_s),
        bias_sigma=errors.gyro_bias_rad_s,
    )
    level = level_matrix(force)
    matrix = earth_rate_matrix(rate, force, latitude_rad=latitude_rad)
    if not np.isfinite(matrix).all():
        matrix = level
    tilt = tilt_sigma(matrix, force, force_sigma)
    east_sigma = float(world_sigma(matrix, rate_sigma)[0])
    heading, heading_rad, reason = judged(east_sigma, latitude_rad=latitude_rad, tilt_rad=float(tilt[1]))
    if heading is Heading.OBSERVED:
        earth = EARTH_RATE_RAD_S * np.array([0.0, cos(latitude_rad), sin(latitude_rad)])
        # The heading was chosen so that nothing is left to the east; north and up are free to disagree.
        off = np.abs(matrix @ rate - earth)
        allowed = SURPRISE * np.hypot(world_sigma(matrix, rate_sigma), EARTH_RATE_RAD_S * tilt.max())
        if (off > allowed).any():
            heading = Heading.NOT_EARTH_RATE
            reason = (
                f"the mean rate is {DEG_PER_RAD * float(off.max()):.2g} deg/s off the earth's at this latitude, more "
                f"than {SURPRISE:g} sigma: the board turns, its bias is not removed, or the latitude is wrong"
            )
    if heading is not Heading.OBSERVED:
        # Of vectors that are nearly parallel the matrix is off in tilt as well.
        tilt = tilt_sigma(level, force, force_sigma)
        return without_heading(level, tilt_rad=tilt, heading=heading, reason=reason, heading_rad=heading_rad)
    return with_heading(matrix, tilt_rad=tilt, heading_rad=heading_rad, reason=reason)
