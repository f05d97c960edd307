"""Euler angles, two sets that are never mixed: the caller names the order.

"zyx"  roll about x, pitch about y, yaw about z, all right-handed, yaw counter-clockwise from above:
       C = Rz(yaw) Ry(pitch) Rx(roll). With x forward and z up, positive pitch is nose down.
"zxy"  pitch about x (right), roll about y (forward), heading clockwise from north:
       C = Rz(-heading) Rx(pitch) Ry(roll).

Angles come and go in the order roll, pitch, yaw (or heading), in rad.
"""

from __future__ import annotations

from typing import Literal

import numpy as np

from quavelet.core.blocks import FloatArray
from quavelet.core.quaternion import multiply, normalise

Order = Literal["zyx", "zxy"]


def to_euler(q: FloatArray, *, order: Order = "zyx") -> FloatArray:
    """Roll, pitch, yaw in rad, shape (..., 3), of unit quaternions (..., 4).

    Within rounding also near pitch +-90 degrees, where roll and yaw turn about the same axis and any pair
    of the right sum (or difference) is an answer. From the rotation matrix, roll and yaw would each be
    the angle of a vector of rounding errors there.
    """
    w, x, y, z = np.moveaxis(q, -1, 0)
    # As complex numbers: (cos + sin)(pitch/2) and (cos - sin)(pitch/2), one with the phase (yaw - roll)/2, one with
    # (yaw + roll)/2; only one of the two phases is lost where its modulus is.
    if order == "zyx":
        rising, falling = (w + y) + 1j * (z - x), (w - y) + 1j * (z + x)
        roll, yaw = np.angle(falling) - np.angle(rising), np.angle(falling) + np.angle(rising)
    else:
        rising, falling = (w + x) + 1j * (z + y), (w - x) + 1j * (z - y)
        roll, yaw = np.angle(rising) - np.angle(falling), -np.angle(rising) - np.angle(falling)
    pitch = 2 * np.arctan2(np.abs(rising), np.abs(falling)) - np.pi / 2
    return np.stack([_wrapped(roll), pitch, _wrapped(yaw)], axis=-1)


def from_euler(angles_rad: FloatArray, *, order: Order = "zyx") -> FloatArray:
    """Unit quaternions (..., 4), q[0] >= 0, of roll, pitch, yaw in rad, shape (..., 3)."""
    roll, pitch, yaw = np.moveaxis(np.asarray(angles_rad, dtype=np.float64), -1, 0)
    if order == "zyx":
        return normalise(multiply(multiply(_about(2, yaw), _about(1, pitch)), _about(0, roll)))
    return normalise(multiply(multiply(_about(2, -yaw), _about(0, pitch)), _about(1, roll)))


def _about(axis: int, angle: FloatArray) -> FloatArray:
    q = np.zeros((*np.shape(angle), 4))
    q[..., 0] = np.cos(angle / 2)
    q[..., 1 + axis] = np.sin(angle / 2)
    return q


def _wrapped(angle: FloatArray) -> FloatArray:
    wrapped: FloatArray = angle - 2 * np.pi * np.round(angle / (2 * np.pi))
    return wrapped
