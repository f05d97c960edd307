"""What an alignment gives: the first attitude, how sure it is, and whether it says where north is."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from math import cos, inf, pi, radians, sqrt

import numpy as np

from quavelet.core.blocks import FloatArray
from quavelet.core.euler import from_euler, to_euler
from quavelet.core.quaternion import from_matrix
from quavelet.core.units import DEG_PER_RAD

EARTH_RATE_RAD_S = 7.292115e-5
"""15.0411 deg/h."""
UNIFORM_RAD = pi / sqrt(3.0)
"""One sigma of a heading of which nothing is known: 103.9 deg."""
HEADING_LIMIT_RAD = 0.2
"""Above this a heading is refused: 11.5 deg, about where the linear error formulas end."""
POLE_COSINE = cos(radians(89.0))
"""Within a degree of a pole the earth's rate is vertical and points nowhere."""


class Heading(Enum):
    """Whether heading was observed, or what stood in its way."""

    OBSERVED = "observed"
    NO_REFERENCE = "nothing measured tells north"
    FIELD_ALONG_GRAVITY = "the magnetic field is parallel to gravity"
    FIELD_UNSURE = "the magnetometer's error hides north"
    EARTH_RATE_HIDDEN = "the gyroscope's error hides the earth's rate"
    NOT_EARTH_RATE = "the rate measured is not the earth's"
    ARC_TOO_SHORT = "gravity's apparent motion is lost in noise"
    NEAR_POLE = "at a pole the earth's rate points nowhere"


@dataclass(frozen=True, slots=True, eq=False)
class Alignment:
    """The first attitude of a board.

    q                   (4,) body to world, Hamilton, scalar first; ENU where heading is OBSERVED, else level, with the
                        azimuth that makes the yaw of order "zyx" 0
    sigma_rad           (3,) one sigma of the small rotation about world x, y (tilt) and z (heading)
    heading, reason     whether heading was observed, and one sentence with the figures
    heading_sigma_rad   what the sensors' errors make of heading, also where it is refused; infinite where nothing
                        measured tells of it
    latitude_rad        where it was estimated, with its sigma; never an input handed back
    """

    q: FloatArray
    sigma_rad: FloatArray
    heading: Heading
    reason: str
    heading_sigma_rad: float = inf
    latitude_rad: float | None = None
    latitude_sigma_rad: float | None = None

    @property
    def has_heading(self) -> bool:
        return self.heading is Heading.OBSERVED


def with_heading(matrix: FloatArray, *, tilt_rad: FloatArray, heading_rad: float, reason: str) -> Alignment:
    """The alignment of a rotation matrix (3, 3), body to ENU; sigmas of tilt (2,) and heading."""
    sigma = np.append(tilt_rad, heading_rad)
    return Alignment(from_matrix(matrix), sigma, Heading.OBSERVED, reason, heading_rad)


def without_heading(
    matrix: FloatArray, *, tilt_rad: FloatArray, heading: Heading, reason: str, heading_rad: float = inf
) -> Alignment:
    """The alignment of the tilt alone of a rotation matrix (3, 3), body to level, with its sigmas (2,)."""
    roll, pitch, yaw = to_euler(from_matrix(matrix))
    c, s = np.cos(yaw), np.sin(yaw)
    x, y = tilt_rad
    level = np.array([np.hypot(c * x, s * y), np.hypot(s * x, c * y), UNIFORM_RAD])
    return Alignment(from_euler(np.array([roll, pitch, 0.0])), level, heading, reason, heading_rad)


def good_to(sigma_rad: float) -> str:
    """How good heading is, as the beginning of a sentence."""
    if not sigma_rad < UNIFORM_RAD:
        return "heading would be anywhere"
    return f"heading is good to {sigma_rad * DEG_PER_RAD:.3g} deg"
