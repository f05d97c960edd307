"""What a seen piece of gravity's cone says of the attitude, and how surely."""

from __future__ import annotations

from dataclasses import dataclass
from math import acos, asin, cos, hypot, inf, sin, sqrt

import numpy as np

from quavelet.alignment.cone import axis_of_cone, basis, earth_frame
from quavelet.alignment.earth_rate import SURPRISE, judged
from quavelet.alignment.result import (
    EARTH_RATE_RAD_S,
    HEADING_LIMIT_RAD,
    POLE_COSINE,
    Alignment,
    Heading,
    good_to,
    without_heading,
)
from quavelet.alignment.sensors import SensorErrors, check_gravity
from quavelet.alignment.two_vectors import level_matrix
from quavelet.core.blocks import FloatArray
from quavelet.core.quaternion import from_matrix, to_matrix
from quavelet.core.units import DEG_PER_RAD

SAGITTA_LIMIT = 0.2
"""Noise out of the arc's plane over the arc's sagitta: the error of the plane in rad, and of the latitude."""
WALK_IN_END = 3.0 / 35.0
"""Variance of the end of a parabola fitted to a random walk of unit intensity on [0, 1], against the walk's own end."""
WALK_IN_SLOPE = 192.0 / 35.0
"""And of the slope of that parabola at its end."""
WALK_IN_CURVATURE = 120.0 / 7.0
"""And of its second derivative."""


def walk_in_fit(duration_s: float) -> tuple[float, float]:
    """`slope_per_s` and `curvature_per_s3` of a fit to samples all along an arc."""
    return WALK_IN_SLOPE / duration_s, WALK_IN_CURVATURE / duration_s**3


@dataclass(frozen=True, slots=True, eq=False)
class Arc:
    """An observed arc of the cone.

    cone            (3, 3) its coefficients, see `cone.fit_cone`
    gram_inverse    (3, 3) covariance of the coefficients along an axis over the variance of a force
    force_sd_m_s2   one sigma of a force along an axis
    end_s           when the attitude is asked for, since the start
    attitude        (4,) of the body then against the start
    slope_per_s, curvature_per_s3   what the gyroscope's random walk makes of the slope at the end and of the second
                    derivative: their variances over the walk's in a second
    """

    cone: FloatArray
    gram_inverse: FloatArray
    force_sd_m_s2: float
    end_s: float
    attitude: FloatArray
    slope_per_s: float
    curvature_per_s3: float

    def align(self, errors: SensorErrors) -> Alignment:
        """The attitude at the end, with heading and latitude where they can be seen.

        A constant gyroscope error turns the cone about the sum of it and the earth's rate, so no method that takes
        north from the cone is better than `earth_rate.judged`; the noise of the fit comes on top. Raises ValueError
        where the cone is not one of gravity: the board turned, or a large bias was not removed.
        """
        angle = EARTH_RATE_RAD_S * self.end_s
        at_end, slope_at_end = basis(np.array([self.end_s]))[0], np.array([0.0, cos(angle), sin(angle)])
        up = at_end @ self.cone
        check_gravity(up)
        g = float(np.linalg.norm(up))
        walk = errors.gyro_noise_rad_s_rthz**2 / 2
        tilt = hypot(errors.accel_bias_m_s2 / g, self._sd(at_end) / g, sqrt(WALK_IN_END * walk * self.end_s))
        to_start = to_matrix(self.attitude)
        tilts = np.full(2, tilt)

        def refused(heading: Heading, reason: str, heading_rad: float = inf) -> Alignment:
            level = level_matrix(to_start.T @ up)
            return without_heading(level, tilt_rad=tilts, heading=heading, reason=reason, heading_rad=heading_rad)

        heading, by_bias, figures = judged(errors.gyro_bias_rad_s, latitude_rad=0.0, tilt_rad=0.0)
        if heading is not Heading.OBSERVED:
            return refused(heading, f"even at the equator {figures}", by_bias)
        # Gravity's apparent speed, over that at the equator, is cos L.
        speed, speed_sd = float(np.linalg.norm(slope_at_end @ self.cone)) / g, self._sd(slope_at_end) / g
        walk_sd = sqrt(walk * self.slope_per_s) / EARTH_RATE_RAD_S
        if speed - 1.0 > SURPRISE * hypot(speed_sd, walk_sd, tilt, errors.gyro_bias_rad_s / EARTH_RATE_RAD_S):
            reason = (
                f"gravity moves {speed:.2g} times as fast as it can on the earth: the board turns or travels, or the "
                "gyroscope's bias is not removed"
            )
            return refused(Heading.NOT_EARTH_RATE, reason)
        if max(speed, speed_sd, walk_sd) < POLE_COSINE:
            reason = (
                f"gravity moves at {speed:.1%} of its speed at the equator: a pole within a degree, or a gyroscope "
                "that lost the earth's rate together with its bias"
            )
            return refused(Heading.NEAR_POLE, reason)
        curvature = float(np.linalg.norm(self.cone[2]))
        noise = hypot(
            self._sd(np.array([0.0, 0.0, 1.0])) / curvature if curvature else inf,
            sqrt(walk * self.curvature_per_s3) / EARTH_RATE_RAD_S**2,
        )
        if noise > SAGITTA_LIMIT:
            reason = (
                f"in {self.end_s:.0f} s noise out of the arc's plane is {noise:.2g} of the arc's sagitta, more than "
                f"{SAGITTA_LIMIT:g}: take longer"
            )
            return refused(Heading.ARC_TOO_SHORT, reason)
        # The slope's part out of the cone's plane turns the axis to the east.
        by_noise = hypot(speed_sd / speed**2, walk_sd / speed)
        axis = axis_of_cone(self.cone)
        matrix = earth_frame(axis, up)
        latitude = asin(float(matrix[2] @ axis / np.linalg.norm(axis)))
        heading, by_bias, figures = judged(errors.gyro_bias_rad_s, latitude_rad=acos(min(1.0, speed)), tilt_rad=tilt)
        heading_rad = hypot(by_bias, by_noise)
        if heading is not Heading.OBSERVED:
            return refused(heading, figures, heading_rad)
        reason = (
            f"{good_to(heading_rad)}, {DEG_PER_RAD * by_noise:.3g} deg of it by noise over "
            f"{self.end_s:.0f} s, at latitude {DEG_PER_RAD * latitude:.1f} deg as estimated"
        )
        if heading_rad > HEADING_LIMIT_RAD:
            return refused(Heading.ARC_TOO_SHORT, reason + ": take longer", heading_rad)
        return Alignment(
            from_matrix(matrix @ to_start),
            np.array([tilt, tilt, heading_rad]),
            heading,
            reason,
            heading_rad,
            latitude_rad=latitude,
            latitude_sigma_rad=hypot(noise, tilt, errors.gyro_bias_rad_s / EARTH_RATE_RAD_S),
        )

    def _sd(self, weights: FloatArray) -> float:
        """One sigma along an axis of this combination (3,) of the coefficients."""
        return self.force_sd_m_s2 * sqrt(float(weights @ self.gram_inverse @ weights))
