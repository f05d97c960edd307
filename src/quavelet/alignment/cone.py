"""The cone of gravity's apparent motion: its fit, and the earth's axis in it.

f(t) = c0 + c1 sin(w t) + c2 (1 - cos(w t)), w the earth's rate, which is known: linear in c. The earth's axis is
c1 x c2. As 1 - cos, not cos: over minutes a constant and a cosine are the same to five digits.
"""

from __future__ import annotations

from math import cos, tan

import numpy as np

from quavelet.alignment.result import EARTH_RATE_RAD_S
from quavelet.core.blocks import FloatArray


def basis(t_s: FloatArray) -> FloatArray:
    """The cone's three functions of time, (N, 3)."""
    angle = EARTH_RATE_RAD_S * np.asarray(t_s, dtype=np.float64)
    return np.stack([np.ones_like(angle), np.sin(angle), 2.0 * np.sin(angle / 2) ** 2], axis=-1)


def gram_inverse(t_s: FloatArray) -> FloatArray:
    """Covariance (3, 3) of the coefficients along an axis, over the variance of a force, of forces at times (N,)."""
    x = basis(t_s)
    return np.asarray(np.linalg.inv(x.T @ x), dtype=np.float64)


def fit_cone(t_s: FloatArray, force_m_s2: FloatArray) -> FloatArray:
    """c0, c1, c2 as rows, (..., 3, 3), by least squares of apparent forces (..., N, 3) at times (N,), N >= 3."""
    x = basis(t_s)
    first = force_m_s2[..., :1, :]
    q, r = np.linalg.qr(x)
    rows: FloatArray = np.linalg.solve(r, np.swapaxes(q, -1, -2) @ (force_m_s2 - first))
    rows[..., 0, :] += first[..., 0, :]
    return rows


def force_at(cone: FloatArray, t_s: float) -> FloatArray:
    """The cone's force (..., 3) at a time."""
    force: FloatArray = basis(np.array([t_s]))[0] @ cone
    return force


def axis_of_cone(cone: FloatArray) -> FloatArray:
    """The earth's axis, to the north, (..., 3)."""
    return np.cross(cone[..., 1, :], cone[..., 2, :])


def axis_of_three(a: FloatArray, b: FloatArray, c: FloatArray) -> FloatArray:
    """The earth's axis, to the north, (..., 3), from apparent forces at three instants in order.

    The normal of their plane. The line to the centre of their circle, as Liu et al. (2016, eq. 5 to 14) have it, is the
    same axis times g sin L: nothing at the equator, and the other way round in the south.
    """
    return np.cross(b - a, c - b)


def earth_frame(axis: FloatArray, up: FloatArray) -> FloatArray:
    """Rotation matrices (..., 3, 3), start frame to ENU, of axis and up (..., 3) of any length."""
    east = np.cross(axis, up)
    with np.errstate(invalid="ignore", divide="ignore"):
        e = east / np.linalg.norm(east, axis=-1, keepdims=True)
        u = up / np.linalg.norm(up, axis=-1, keepdims=True)
    return np.stack([e, np.cross(u, e), u], axis=-2)


def limit(*, gyro_bias_rad_s: float, accel_bias_m_s2: float, latitude_rad: float, g_m_s2: float) -> FloatArray:
    """Errors of pitch, roll, heading (counter-clockwise) in rad that biases alone leave in a level board facing north.

    The biases are the same on each axis; to first order, the limit of every method that finds north so.
    """
    tilt = accel_bias_m_s2 / g_m_s2
    heading = gyro_bias_rad_s / (EARTH_RATE_RAD_S * cos(latitude_rad)) - tilt * tan(latitude_rad)
    return np.array([tilt, -tilt, heading])
