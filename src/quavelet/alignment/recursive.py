"""Least squares of gravity's apparent motion as the samples come: nothing is kept but sums."""

from __future__ import annotations

from dataclasses import dataclass
from math import cos, sin, sqrt

import numpy as np

from quavelet.alignment.apparent_motion import COEFFICIENTS
from quavelet.alignment.arc import Arc, walk_in_fit
from quavelet.alignment.result import EARTH_RATE_RAD_S, Alignment
from quavelet.alignment.sensors import SensorErrors, checked, checked_period
from quavelet.core.blocks import FloatArray

Vector = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]


@dataclass(frozen=True, slots=True)
class MotionState:
    """All memory.

    n          samples
    attitude   of the body against the start
    first      the first apparent force; the sums are of what differs from it
    gram       sums of the products of the basis: 1 s, 1 v, s s, s v, v v, with s = sin(w t) and v = 1 - cos(w t)
    products   sums of force times 1, s and v, an axis each
    squares    sum of the forces' squares
    """

    n: int = 0
    attitude: Quaternion = (1.0, 0.0, 0.0, 0.0)
    first: Vector = (0.0, 0.0, 0.0)
    gram: tuple[float, float, float, float, float] = (0.0,) * 5
    products: tuple[Vector, Vector, Vector] = ((0.0,) * 3,) * 3
    squares: float = 0.0


class ApparentMotion:
    """`align_motion` for samples that come in pieces: `update` with each, `alignment` when asked.

    However they are split, the result is the same to the bit. Gaps are not bridged: start anew after one.
    """

    def __init__(self, *, period_s: float, errors: SensorErrors) -> None:
        self._period_s = checked_period(period_s)
        self._errors = errors
        self._s = MotionState()

    def state(self) -> MotionState:
        return self._s

    def restore(self, state: MotionState) -> None:
        self._s = state

    def update(self, gyro_rad_s: FloatArray, accel_m_s2: FloatArray) -> None:
        """Take rates and specific forces (N, 3). Raises ValueError, taking none, where they are not finite."""
        gyro = checked(gyro_rad_s, name="gyro_rad_s", at_least=0)
        accel = checked(accel_m_s2, name="accel_m_s2", at_least=0)
        if len(gyro) != len(accel):
            raise ValueError(f"{len(gyro)} rates and {len(accel)} forces: give as many of each")
        s = self._s
        for rate, force in zip(gyro.tolist(), accel.tolist(), strict=True):
            s = _next(s, rate, force, self._period_s)
        self._s = s

    def alignment(self) -> Alignment:
        """The attitude at the last sample. Raises ValueError before the fourth."""
        s = self._s
        if s.n <= COEFFICIENTS:
            raise ValueError(f"{s.n} samples so far: give at least {COEFFICIENTS + 1}")
        sum_s, sum_v, ss, sv, vv = s.gram
        gram = np.array([[s.n, sum_s, sum_v], [sum_s, ss, sv], [sum_v, sv, vv]])
        products = np.array(s.products).T
        # The columns differ by orders of magnitude; each is measured by its own length.
        scale = 1.0 / np.sqrt(np.diag(gram))
        inverse = np.linalg.inv(gram * np.outer(scale, scale)) * np.outer(scale, scale)
        cone = inverse @ products
        left = max(0.0, s.squares - float((cone * products).sum()))
        cone[0] += s.first
        end_s = s.n * self._period_s
        sd = max(sqrt(left / (3 * (s.n - COEFFICIENTS))), self._errors.accel_sd_m_s2(self._period_s))
        arc = Arc(cone, inverse, sd, end_s, np.array(s.attitude), *walk_in_fit(end_s))
        return arc.align(self._errors)


def _next(s: MotionState, rate: list[float], force: list[float], period_s: float) -> MotionState:
    q = _turned(s.attitude, rate, period_s)
    x, y, z = _rotated(q, force)
    first = s.first if s.n else (x, y, z)
    f = (x - first[0], y - first[1], z - first[2])
    n = s.n + 1
    angle = EARTH_RATE_RAD_S * (n * period_s)
    a, v = sin(angle), 2.0 * sin(angle / 2) ** 2
    g = s.gram
    p, q_, r = (
        (old[0] + value, old[1] + a * value, old[2] + v * value) for old, value in zip(s.products, f, strict=True)
    )
    return MotionState(
        n=n,
        attitude=q,
        first=first,
        gram=(g[0] + a, g[1] + v, g[2] + a * a, g[3] + a * v, g[4] + v * v),
        products=(p, q_, r),
        squares=s.squares + f[0] * f[0] + f[1] * f[1] + f[2] * f[2],
    )


def _turned(q: Quaternion, rate: list[float], period_s: float) -> Quaternion:
    """q (x) exp(w T)."""
    rx, ry, rz = (period_s * w for w in rate)
    angle = sqrt(rx * rx + ry * ry + rz * rz)
    c, k = cos(angle / 2), (sin(angle / 2) / angle if angle > 0.0 else 0.5)
    x, y, z = k * rx, k * ry, k * rz
    qw, qx, qy, qz = q
    return (
        qw * c - qx * x - qy * y - qz * z,
        qw * x + qx * c + qy * z - qz * y,
        qw * y - qx * z + qy * c + qz * x,
        qw * z + qx * y - qy * x + qz * c,
    )


def _rotated(q: Quaternion, v: list[float]) -> Vector:
    """q (x) v (x) q*, of a unit quaternion: v + 2 w (u x v) + 2 u x (u x v)."""
    w, ux, uy, uz = q
    x, y, z = v
    tx, ty, tz = 2 * (uy * z - uz * y), 2 * (uz * x - ux * z), 2 * (ux * y - uy * x)
    return (
        x + w * tx + uy * tz - uz * ty,
        y + w * ty + uz * tx - ux * tz,
        z + w * tz + ux * ty - uy * tx,
    )
