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
from quavelet.core.quaternion import multiply, normalise, to_matrix

Order = Literal["zyx", "zxy"]


def to_euler(q: FloatArray, *, order: Order = "zyx") -> FloatArray:
    """Roll, pitch, yaw in rad, shape (..., 3), of unit quaternions (..., 4)."""
    c = to_matrix(q)
    if order == "zyx":
        roll = np.arctan2(c[..., 2, 1], c[..., 2, 2])
        pitch = np.arcsin(np.clip(-c[..., 2, 0], -1.0, 1.0))
        yaw = np.arctan2(c[..., 1, 0], c[..., 0, 0])
    else:
        roll = np.arctan2(-c[..., 2, 0], c[..., 2, 2])
        pitch = np.arcsin(np.clip(c[..., 2, 1], -1.0, 1.0))
        yaw = np.arctan2(c[..., 0, 1], c[..., 1, 1])
    return np.stack([roll, pitch, yaw], axis=-1)


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
