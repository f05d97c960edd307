"""What a short chunk of motion adds up to, in the world."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from quavelet.attitude.kernel import Quaternion, Vector
from quavelet.core.blocks import FloatArray

Row = tuple[float, ...]


@dataclass(frozen=True, slots=True, eq=False)
class Swing:
    """Sums over one chunk; "horizontal" are the two upper rows of the attitude's matrix, body to world.

    duration_s   its length
    velocity     (2,) change of the horizontal velocity, m/s
    across       (2, 3) the integral of the horizontal rows, s
    spin         (2, 9) the same times each component of the rate, rad
    pull         (2, 9) the same times each component of the force, m/s
    swept        (2,) the integral of rate x force, m/s^2: what a delay of the force takes off per second of it
    force        mean size of the force, m/s^2
    turning      integral of the squared rate, rad^2/s
    blind_s      time for which a rate stood at the end of its range
    """

    duration_s: float
    velocity: FloatArray
    across: FloatArray
    spin: FloatArray
    pull: FloatArray
    swept: FloatArray
    force: float
    turning: float
    blind_s: float = 0.0


def row_of(q: Quaternion, rate: Vector, force: Vector, dt: float) -> Row:
    """A sample of a swing: the horizontal rows at its beginning, rate, force as seen from there, rate x force, period.

    Rate and force are means over the period, so that the force is turned back by half a step.
    """
    wx, wy, wz = rate
    fx, fy, fz = force
    sx, sy, sz = wy * fz - wz * fy, wz * fx - wx * fz, wx * fy - wy * fx
    h = 0.5 * dt
    w, x, y, z = q
    a, b, c = w * w + x * x - y * y - z * z, 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)
    d, e, f = 2.0 * (x * y + w * z), w * w - x * x + y * y - z * z, 2.0 * (y * z - w * x)
    return a, b, c, d, e, f, wx, wy, wz, fx + h * sx, fy + h * sy, fz + h * sz, sx, sy, sz, dt


def swing_of(rows: tuple[Row, ...], *, blind_s: float) -> Swing:
    """The sums over `row_of` each sample of the chunk."""
    table = np.array(rows)
    rate, force, period = table[:, 6:9], table[:, 9:12], table[:, 15]
    weighted = period[:, None] * table
    sums = weighted[:, :6].T @ table[:, 6:15]
    pull = sums[:, 3:6].reshape(2, 9)
    duration_s = float(period.sum())
    return Swing(
        duration_s=duration_s,
        velocity=pull[:, ::4].sum(axis=1),
        across=weighted[:, :6].sum(axis=0).reshape(2, 3),
        spin=sums[:, :3].reshape(2, 9),
        pull=pull,
        swept=sums[:, 6:9].reshape(2, 9)[:, ::4].sum(axis=1),
        force=float((period * np.sqrt((force * force).sum(axis=1))).sum()) / duration_s,
        turning=float((weighted[:, 6:9] * rate).sum()),
        blind_s=blind_s,
    )
