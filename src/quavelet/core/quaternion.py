"""Quaternions on arrays: Hamilton, scalar first, body to world (algorithms: v_n = q (x) v_b (x) q*).

All functions take and give arrays of shape (..., 4) or (..., 3) and broadcast over the leading axes.
The scalar kernel of the filter is a file of its own, attitude/kernel.py.
"""

from __future__ import annotations

import numpy as np

from quavelet.core.blocks import FloatArray


def multiply(p: FloatArray, q: FloatArray) -> FloatArray:
    """The product p (x) q, shape (..., 4)."""
    pw, px, py, pz = np.moveaxis(p, -1, 0)
    qw, qx, qy, qz = np.moveaxis(q, -1, 0)
    return np.stack(
        [
            pw * qw - px * qx - py * qy - pz * qz,
            pw * qx + px * qw + py * qz - pz * qy,
            pw * qy - px * qz + py * qw + pz * qx,
            pw * qz + px * qy - py * qx + pz * qw,
        ],
        axis=-1,
    )


def conjugate(q: FloatArray) -> FloatArray:
    """q*, which for a unit quaternion is the inverse rotation, shape (..., 4)."""
    inverse: FloatArray = q * np.array([1.0, -1.0, -1.0, -1.0])
    return inverse


def normalise(q: FloatArray) -> FloatArray:
    """The unit quaternion of q with q[0] >= 0, shape (..., 4)."""
    sign = np.where(q[..., :1] < 0.0, -1.0, 1.0)
    unit: FloatArray = sign * q / np.linalg.norm(q, axis=-1, keepdims=True)
    return unit


def to_matrix(q: FloatArray) -> FloatArray:
    """The rotation matrix C with v_world = C v_body, shape (..., 3, 3)."""
    w, x, y, z = np.moveaxis(q, -1, 0)
    rows = [
        [w * w + x * x - y * y - z * z, 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), w * w - x * x + y * y - z * z, 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), w * w - x * x - y * y + z * z],
    ]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def from_matrix(c: FloatArray) -> FloatArray:
    """The unit quaternion, q[0] >= 0, of a rotation matrix (..., 3, 3); the largest component divides."""
    c00, c11, c22 = c[..., 0, 0], c[..., 1, 1], c[..., 2, 2]
    squares = np.stack([1 + c00 + c11 + c22, 1 + c00 - c11 - c22, 1 - c00 + c11 - c22, 1 - c00 - c11 + c22], -1)
    a, b, d = c[..., 2, 1] - c[..., 1, 2], c[..., 0, 2] - c[..., 2, 0], c[..., 1, 0] - c[..., 0, 1]
    e, f, g = c[..., 0, 1] + c[..., 1, 0], c[..., 0, 2] + c[..., 2, 0], c[..., 1, 2] + c[..., 2, 1]
    # Row k is 4 q_k q; the one with the largest q_k is the best conditioned.
    rows = np.stack(
        [
            np.stack([squares[..., 0], a, b, d], -1),
            np.stack([a, squares[..., 1], e, f], -1),
            np.stack([b, e, squares[..., 2], g], -1),
            np.stack([d, f, g, squares[..., 3]], -1),
        ],
        axis=-2,
    )
    best = np.argmax(squares, axis=-1)[..., None, None]
    return normalise(np.take_along_axis(rows, best, axis=-2)[..., 0, :])


def rotate(q: FloatArray, v: FloatArray) -> FloatArray:
    """The body vector v seen in the world, shape (..., 3)."""
    product: FloatArray = np.einsum("...ij,...j->...i", to_matrix(q), v)
    return product


def from_rotation_vector(r_rad: FloatArray) -> FloatArray:
    """The quaternion of a rotation by |r| about r, shape (..., 3) to (..., 4)."""
    angle = np.linalg.norm(r_rad, axis=-1, keepdims=True)
    # sinc(x) = sin(pi x)/(pi x) is exact at zero.
    return np.concatenate([np.cos(angle / 2), 0.5 * np.sinc(angle / (2 * np.pi)) * r_rad], axis=-1)


def angle_between(p: FloatArray, q: FloatArray) -> FloatArray:
    """The angle in rad of the rotation from p to q, shape (...)."""
    d = multiply(conjugate(p), q)
    angle: FloatArray = 2 * np.arctan2(np.linalg.norm(d[..., 1:], axis=-1), np.abs(d[..., 0]))
    return angle


def inclination_between(p: FloatArray, q: FloatArray) -> FloatArray:
    """The part in rad of the rotation from p to q that is not about the world's vertical, shape (...)."""
    d = multiply(p, conjugate(q))
    tilt: FloatArray = 2 * np.arctan2(np.hypot(d[..., 1], d[..., 2]), np.hypot(d[..., 0], d[..., 3]))
    return tilt
