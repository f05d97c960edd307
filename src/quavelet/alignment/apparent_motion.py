"""North from gravity's apparent motion, at an unknown latitude (Liu et al., 2016): three vectors, or all by least
squares."""

from __future__ import annotations

from math import sqrt

import numpy as np

from quavelet.alignment.arc import Arc, walk_in_fit
from quavelet.alignment.cone import basis, fit_cone, gram_inverse
from quavelet.alignment.inertial import apparent_gravity, integrate
from quavelet.alignment.result import EARTH_RATE_RAD_S, Alignment
from quavelet.alignment.sensors import SensorErrors, checked, checked_period
from quavelet.core.blocks import FloatArray

COEFFICIENTS = 3


def align_three(
    times_s: FloatArray,
    force_m_s2: FloatArray,
    attitude: FloatArray,
    *,
    force_sd_m_s2: float,
    errors: SensorErrors,
) -> Alignment:
    """Attitude at the last of three instants, of apparent forces (3, 3) at them (see `inertial.apparent_gravity`).

    times_s         (3,) since the start, increasing
    attitude        (4,) of the body at the last instant against the start
    force_sd_m_s2   one sigma of such a force along an axis, after denoising

    Every other sample is thrown away: `align_motion` needs a tenth of the time. Raises ValueError where the numbers
    are not finite or the times do not increase.
    """
    forces = checked(force_m_s2, name="force_m_s2", at_least=COEFFICIENTS)
    if np.shape(attitude) != (4,) or not np.isfinite(attitude).all():
        raise ValueError(f"attitude = {attitude} is no quaternion: give w, x, y, z of the last instant")
    times: FloatArray = np.asarray(times_s, dtype=np.float64)
    if times.shape != (COEFFICIENTS,) or len(forces) != COEFFICIENTS:
        raise ValueError(f"{times.size} times and {len(forces)} forces: give three of each")
    if not (np.isfinite(times).all() and times[0] >= 0.0 and (np.diff(times) > 0.0).all()):
        raise ValueError("times_s does not increase from the start on: give three instants in order")
    angle = EARTH_RATE_RAD_S * times[-1]
    slope = EARTH_RATE_RAD_S * np.array([0.0, np.cos(angle), np.sin(angle)])
    curvature = EARTH_RATE_RAD_S**2 * np.array([0.0, 0.0, 1.0])
    # A step of the random walk is in all forces after it.
    weights = np.cumsum((np.array([slope, curvature]) @ np.linalg.inv(basis(times)))[:, ::-1], axis=1)[:, ::-1]
    slope_per_s, curvature_per_s3 = (weights**2 @ np.diff(times, prepend=0.0)).tolist()
    arc = Arc(
        fit_cone(times, forces),
        gram_inverse(times),
        force_sd_m_s2,
        float(times[-1]),
        attitude,
        slope_per_s,
        curvature_per_s3,
    )
    return arc.align(errors)


def align_motion(gyro_rad_s: FloatArray, accel_m_s2: FloatArray, *, period_s: float, errors: SensorErrors) -> Alignment:
    """Attitude at the last sample, from rates and specific forces (N, 3): all of them, by least squares.

    The board may swing, but not travel. The gyroscope's bias must come off by a calibration, not by this rest.
    Raw samples are best: denoising before a fit takes nothing off its error. Raises ValueError where samples are not
    finite, not gravity, or fewer than 4.
    """
    period_s = checked_period(period_s)
    gyro = checked(gyro_rad_s, name="gyro_rad_s", at_least=COEFFICIENTS + 1)
    accel = checked(accel_m_s2, name="accel_m_s2", at_least=COEFFICIENTS + 1)
    if len(gyro) != len(accel):
        raise ValueError(f"{len(gyro)} rates and {len(accel)} forces: give as many of each")
    q = integrate(gyro, period_s=period_s)
    force = apparent_gravity(q, accel)
    n = len(force)
    times: FloatArray = period_s * np.arange(1, n + 1, dtype=np.float64)
    cone = fit_cone(times, force)
    left = force - basis(times) @ cone
    measured = sqrt(float((left**2).sum()) / (3 * (n - COEFFICIENTS)))
    arc = Arc(
        cone,
        gram_inverse(times),
        max(measured, errors.accel_sd_m_s2(period_s)),
        n * period_s,
        q[-1],
        *walk_in_fit(n * period_s),
    )
    return arc.align(errors)
