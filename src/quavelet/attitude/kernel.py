"""The scalar kernel: quaternion integration and the gravity correction in plain floats.

Nothing but float arithmetic on tuples, so that one compiled twin of this file can replace it. Hamilton,
scalar first, body to world; rates in rad/s, times in s. Equation numbers are those of paper 000 (Liu et
al. 2020) as corrected in this project's notes.
"""

from __future__ import annotations

from math import atan2, cos, sin, sqrt
from typing import Literal

Vector = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]
Method = Literal["rk1", "rk2", "rk4", "exp"]

ZERO: Vector = (0.0, 0.0, 0.0)
IDENTITY: Quaternion = (1.0, 0.0, 0.0, 0.0)


def step(q: Quaternion, rate: Vector, dt: float, method: Method) -> Quaternion:
    """`q` turned by the body rate held over `dt`, of unit length (eq. 5).

    With the rate held, q' = A q has a constant A with A^2 = -x^2 I, x = |rate| dt / 2, so a Runge-Kutta
    step is the first terms of exp(A): q (x) [c, s dt/2 rate] with c and s cut from the series of cos x
    and sin x / x after the power of the method's order.
    """
    wx, wy, wz = rate
    x2 = 0.25 * dt * dt * (wx * wx + wy * wy + wz * wz)
    if method == "rk4":
        c, s = 1.0 - x2 * (0.5 - x2 / 24.0), 1.0 - x2 / 6.0
    elif method == "exp":
        x = sqrt(x2)
        c, s = cos(x), (sin(x) / x if x > 1e-8 else 1.0)
    elif method == "rk2":
        c, s = 1.0 - 0.5 * x2, 1.0
    else:
        c, s = 1.0, 1.0
    s *= 0.5 * dt
    return normalised(product(q, (c, s * wx, s * wy, s * wz)))


def product(p: Quaternion, q: Quaternion) -> Quaternion:
    """The Hamilton product p (x) q."""
    pw, px, py, pz = p
    qw, qx, qy, qz = q
    return (
        pw * qw - px * qx - py * qy - pz * qz,
        pw * qx + px * qw + py * qz - pz * qy,
        pw * qy - px * qz + py * qw + pz * qx,
        pw * qz + px * qy - py * qx + pz * qw,
    )


def normalised(q: Quaternion) -> Quaternion:
    """`q` of unit length."""
    w, x, y, z = q
    r = 1.0 / sqrt(w * w + x * x + y * y + z * z)
    return w * r, x * r, y * r, z * r


def up_in_body(q: Quaternion) -> Vector:
    """The world's up as the body sees it, v = C^T [0, 0, 1] (eq. 9)."""
    w, x, y, z = q
    return 2.0 * (x * z - w * y), 2.0 * (y * z + w * x), w * w - x * x - y * y + z * z


def cross(a: Vector, b: Vector) -> Vector:
    """The vector product a x b."""
    ax, ay, az = a
    bx, by, bz = b
    return ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx


def across(a: Vector, v: Vector) -> Vector:
    """The part of `a` across the unit vector `v`: it cannot turn anything about v."""
    along = a[0] * v[0] + a[1] * v[1] + a[2] * v[2]
    return a[0] - along * v[0], a[1] - along * v[1], a[2] - along * v[2]


def tilt_error(q: Quaternion, force: Vector) -> Vector:
    """The body rotation in rad (to first order) that brings q's up to the measured one, e = a x v (eq. 10).

    `force` is normalised first, else its unit would multiply every gain; a force too small to have a
    direction (free fall) gives no error. e has no part along v, so gravity never steers heading.
    """
    fx, fy, fz = force
    n2 = fx * fx + fy * fy + fz * fz
    if n2 < 1e-12:
        return ZERO
    r = 1.0 / sqrt(n2)
    return cross((fx * r, fy * r, fz * r), up_in_body(q))


def levelled(q: Quaternion, force: Vector) -> Quaternion:
    """`q` turned by the smallest rotation that brings its up to the measured one: as it would be at rest."""
    x, y, z = force
    up, (ex, ey, ez) = up_in_body(q), tilt_error(q, force)
    sine, cosine = sqrt(ex * ex + ey * ey + ez * ez), (up[0] * x + up[1] * y + up[2] * z)
    if sine == 0.0:  # already there, without a direction, or upside down, where every direction is the smallest
        return q
    angle = atan2(sine * sqrt(x * x + y * y + z * z), cosine) / sine
    return step(q, (ex * angle, ey * angle, ez * angle), 1.0, "exp")


def standing(force: Vector) -> Quaternion:
    """The attitude of a board at rest on which `force` is measured: roll and pitch from it, yaw zero.

    Not the smallest rotation, for that one has a yaw of its own when both angles are large.
    """
    fx, fy, fz = force
    pitch, roll = 0.5 * atan2(-fx, sqrt(fy * fy + fz * fz)), 0.5 * atan2(fy, fz)
    return product((cos(pitch), 0.0, sin(pitch), 0.0), (cos(roll), sin(roll), 0.0, 0.0))


def clamped(a: Vector, limit: float) -> Vector:
    """Each component held within +-limit."""
    x, y, z = a
    return (
        limit if x > limit else -limit if x < -limit else x,
        limit if y > limit else -limit if y < -limit else y,
        limit if z > limit else -limit if z < -limit else z,
    )
