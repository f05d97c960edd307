"""The attitude from two vectors known in the world and measured in the body: gravity and the magnetic field."""

from __future__ import annotations

from math import atan2, hypot

import numpy as np

from quavelet.alignment.result import HEADING_LIMIT_RAD, Alignment, Heading, good_to, with_heading, without_heading
from quavelet.alignment.sensors import (
    SensorErrors,
    checked,
    checked_force,
    checked_period,
    mean_and_sigma,
    world_sigma,
)
from quavelet.core.blocks import FloatArray
from quavelet.core.units import DEG_PER_RAD

UP = np.array([0.0, 0.0, 1.0])
PARALLEL_SINE = 0.1
"""Below this sine of the angle between the two vectors their cross product is mostly error."""


def triad(
    first_world: FloatArray, second_world: FloatArray, first_body: FloatArray, second_body: FloatArray
) -> FloatArray:
    """Rotation matrices (..., 3, 3), body to world; the vectors (..., 3) are of any length.

    The first vector is believed wholly, of the second only the direction about the first. On unit vectors, so that the
    matrix is orthogonal whatever the scales of the sensors; [f, f x M, (f x M) x f] as printed in patent application
    201810777853.4 is not. NaN where two vectors are parallel.
    """
    world, body = _triads(first_world, second_world), _triads(first_body, second_body)
    matrix: FloatArray = np.swapaxes(world, -1, -2) @ body
    return matrix


def _triads(first: FloatArray, second: FloatArray) -> FloatArray:
    """Rows: the first unit vector, the unit normal of both, and the third of the set."""
    t1, t2 = _unit(first), _unit(np.cross(first, second))
    return np.stack([t1, t2, np.cross(t2, t1)], axis=-2)


def _unit(v: FloatArray) -> FloatArray:
    length = np.linalg.norm(v, axis=-1, keepdims=True)
    with np.errstate(invalid="ignore", divide="ignore"):
        unit: FloatArray = v / length
    return unit


def level_matrix(force: FloatArray) -> FloatArray:
    """A rotation matrix (3, 3), body to a level frame of some azimuth, that turns the force (3,) up."""
    weakest = np.eye(3)[int(np.abs(force).argmin())]
    return triad(UP, np.array([1.0, 0.0, 0.0]), force, weakest)


def tilt_sigma(matrix: FloatArray, force_m_s2: FloatArray, sigma_m_s2: FloatArray) -> FloatArray:
    """One sigma (2,) of the rotation about world x and y, of a force (3,) with this sigma on each body axis.

    An error to the north turns the attitude about the east axis, and the other way round.
    """
    east, north = world_sigma(matrix, sigma_m_s2)[:2] / np.linalg.norm(force_m_s2)
    return np.array([north, east])


def align_level(accel_m_s2: FloatArray, *, period_s: float, errors: SensorErrors) -> Alignment:
    """Tilt alone, from the mean specific force (N, 3) of a board at rest: gravity does not tell north.

    Raises ValueError where the samples are not finite or not gravity.
    """
    sd = errors.accel_sd_m_s2(checked_period(period_s))
    force, sigma = mean_and_sigma(checked_force(accel_m_s2), noise_sd=sd, bias_sigma=errors.accel_bias_m_s2)
    matrix = level_matrix(force)
    return without_heading(
        matrix,
        tilt_rad=tilt_sigma(matrix, force, sigma),
        heading=Heading.NO_REFERENCE,
        reason="gravity alone was measured, and it is the same at every azimuth",
    )


def align_field(
    accel_m_s2: FloatArray,
    field_ut: FloatArray,
    *,
    period_s: float,
    errors: SensorErrors,
    declination_rad: float = 0.0,
    declination_sigma_rad: float = 0.0,
) -> Alignment:
    """Attitude from the means of specific force and magnetic field, each (N, 3), of a board at rest.

    declination_rad   of magnetic north from true north, east positive; 0 gives magnetic heading. The dip drops out.

    The heading's sigma is that of the field's east component over its horizontal one, and of the tilt about magnetic
    north, times the tangent of the dip. Raises ValueError where samples are not finite or not gravity, or all zero.
    """
    sd = errors.accel_sd_m_s2(checked_period(period_s))
    force, force_sigma = mean_and_sigma(checked_force(accel_m_s2), noise_sd=sd, bias_sigma=errors.accel_bias_m_s2)
    field, field_sigma = mean_and_sigma(
        checked(field_ut, name="field_ut"), noise_sd=errors.field_noise_ut, bias_sigma=errors.field_bias_ut
    )
    total_ut = float(np.linalg.norm(field))
    if total_ut == 0.0:
        raise ValueError("field_ut is zero: the magnetometer gives nothing")
    up = force / np.linalg.norm(force)
    vertical_ut = float(field @ up)
    horizontal_ut = float(np.linalg.norm(np.cross(up, field)))
    if horizontal_ut < PARALLEL_SINE * total_ut:
        matrix = level_matrix(force)
        return without_heading(
            matrix,
            tilt_rad=tilt_sigma(matrix, force, force_sigma),
            heading=Heading.FIELD_ALONG_GRAVITY,
            reason=f"the field of {total_ut:.1f} uT has {horizontal_ut:.1f} uT across gravity, "
            f"less than {PARALLEL_SINE:.0%} of it: no heading near a magnetic pole or a magnet",
        )
    magnetic = triad(UP, np.array([0.0, 1.0, 0.0]), force, field)
    east_ut = float(world_sigma(magnetic, field_sigma)[0])
    about_north = float(tilt_sigma(magnetic, force, force_sigma)[1])
    heading = hypot(east_ut / horizontal_ut, about_north * vertical_ut / horizontal_ut, declination_sigma_rad)
    figures = (
        f"{good_to(heading)}: {east_ut:.2g} uT of error in {horizontal_ut:.1f} uT of horizontal "
        f"field, dip {DEG_PER_RAD * atan2(-vertical_ut, horizontal_ut):.0f} deg"
    )
    north = np.array([np.sin(declination_rad), np.cos(declination_rad), 0.0])
    matrix = triad(UP, north, force, field)
    tilt = tilt_sigma(matrix, force, force_sigma)
    if heading > HEADING_LIMIT_RAD:
        return without_heading(matrix, tilt_rad=tilt, heading=Heading.FIELD_UNSURE, reason=figures, heading_rad=heading)
    return with_heading(matrix, tilt_rad=tilt, heading_rad=heading, reason=figures)
