"""Gravity seen from a frame that does not turn with the earth: the body's own at the start, held by the gyroscope."""

from __future__ import annotations

from math import ceil, sqrt

import numpy as np

from quavelet.core.blocks import FloatArray
from quavelet.core.quaternion import from_rotation_vector, multiply, rotate


def integrate(gyro_rad_s: FloatArray, *, period_s: float) -> FloatArray:
    """Attitude against the start at the end of each sample, (..., N, 4), of rates (..., N, 3) held over their samples.

    q <- q (x) exp(w T), as products of stretches of about sqrt(N) samples: of N steps only 2 sqrt(N) are one by one.
    """
    n = gyro_rad_s.shape[-2]
    stretch = max(1, ceil(sqrt(n)))
    stretches = ceil(n / stretch)
    steps = np.zeros((*gyro_rad_s.shape[:-2], stretches * stretch, 4))
    steps[..., 0] = 1.0
    steps[..., :n, :] = from_rotation_vector(gyro_rad_s * period_s)
    q = steps.reshape(*gyro_rad_s.shape[:-2], stretches, stretch, 4)
    for k in range(1, stretch):
        q[..., k, :] = multiply(q[..., k - 1, :], q[..., k, :])
    start = np.empty_like(q[..., :, 0, :])
    start[..., 0, :] = [1.0, 0.0, 0.0, 0.0]
    for k in range(1, stretches):
        start[..., k, :] = multiply(start[..., k - 1, :], q[..., k - 1, -1, :])
    attitude: FloatArray = multiply(start[..., :, None, :], q).reshape(steps.shape)[..., :n, :]
    return attitude


def apparent_gravity(q: FloatArray, accel_m_s2: FloatArray) -> FloatArray:
    """Specific force in the frame of the start, (..., N, 3), of attitudes as `integrate` gives them.

    In a day its tip goes once round a cone about the earth's axis, half angle 90 deg - L.
    """
    return rotate(q, accel_m_s2)
