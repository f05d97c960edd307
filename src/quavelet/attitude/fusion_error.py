"""The error-state filter of paper 003 in the form that is stable: tilt and bias, with the root of their covariance.

States, in the order that keeps the root triangular through a step: the bias's three axes in the body, the two
horizontal components of the small rotation from the estimated to the true world, the two of the velocity where it
is modelled, and the heading. Nothing here measures heading: it is a consider state (Schmidt), never corrected, which
carries its own variance and its correlation with the bias. Equation numbers are section 5.3's of the paper's
correction: predict, then measure, then fold the error into the attitude.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import hypot, sqrt

from quavelet.attitude.fusion_root import Frozen, Rows, add_noise, diagonal_root, frozen, measure, sigma
from quavelet.attitude.kernel import ZERO, Quaternion, Vector, normalised, product, step
from quavelet.core.units import STANDARD_GRAVITY_M_S2 as G

TILT_X, TILT_Y = 3, 4
VELOCITY_X, VELOCITY_Y = 5, 6
HEADING = -1


@dataclass(frozen=True, slots=True, kw_only=True)
class Noise:
    """Densities, one-sided as data sheets give them (a sample's variance is density^2 / (2 period)).

    gyro_rad_s_rthz    of the rate
    gyro_share_rthz    the same as a share of the rate, for errors of scale and alignment
    accel_m_s2_rthz    of the specific force: what the board's own acceleration adds belongs to it, unless velocity
                       is modelled
    velocity_m_s_rthz  of the velocity about zero; None: velocity is not modelled
    bias_rad_s_rts     growth of the bias' sigma per root of time
    """

    gyro_rad_s_rthz: float
    gyro_share_rthz: float
    accel_m_s2_rthz: float
    velocity_m_s_rthz: float | None
    bias_rad_s_rts: float


@dataclass(frozen=True, slots=True)
class Estimate:
    """What is known: attitude, bias, the velocity's horizontal part, and the root of the error's covariance."""

    q: Quaternion
    root: Frozen
    bias_rad_s: Vector = ZERO
    velocity_m_s: tuple[float, float] = (0.0, 0.0)

    def tilt_sigma_rad(self) -> tuple[float, float]:
        """One sigma about world x and y."""
        return sigma(self.root[TILT_X]), sigma(self.root[TILT_Y])

    def heading_sigma_rad(self) -> float:
        return sigma(self.root[HEADING])


def first_root(bias_rad_s: float, tilt_rad: float, heading_rad: float, velocity_m_s: float | None) -> Frozen:
    """The root of a covariance without correlations, one sigma each; no velocity where it is None."""
    velocity = () if velocity_m_s is None else (velocity_m_s,) * 2
    return diagonal_root((bias_rad_s,) * 3 + (tilt_rad,) * 2 + velocity + (heading_rad,))


def forget(rows: Rows, sqrt_lambda: float, caps: Sequence[float]) -> None:
    """P / lambda, but not for a state whose sigma has reached its cap: what nothing observes is not forgotten
    without end. Each state's row is scaled by itself, which leaves a covariance. Heading is never forgotten."""
    grown = 1.0 / sqrt_lambda
    for i, cap in enumerate(caps):
        if sigma(rows[i]) < cap:
            rows[i] = [grown * x for x in rows[i]]


def predicted(e: Estimate, rate: Vector, force: Vector, dt: float, noise: Noise, rows: Rows) -> tuple[Estimate, Vector]:
    """The estimate one period on, its root still in `rows`, and the specific force seen in the world.

    q <- q (x) exp((w - b) T); F = [[I, 0], [-C T, I]] leaves a triangular root triangular; a tilt error turns
    gravity into an acceleration that is not there.
    """
    bx, by, bz = e.bias_rad_s
    w, x, y, z = q = step(e.q, (rate[0] - bx, rate[1] - by, rate[2] - bz), dt, "exp")
    fx, fy, fz = force
    c = (
        (w * w + x * x - y * y - z * z, 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)),
        (2.0 * (x * y + w * z), w * w - x * x + y * y - z * z, 2.0 * (y * z - w * x)),
        (2.0 * (x * z - w * y), 2.0 * (y * z + w * x), w * w - x * x - y * y + z * z),
    )
    ux, uy, uz = ((c0 * fx + c1 * fy + c2 * fz) for c0, c1, c2 in c)
    vx, vy = e.velocity_m_s
    gyro_density = hypot(noise.gyro_rad_s_rthz, noise.gyro_share_rthz * hypot(rate[0], rate[1], rate[2]))
    gyro_sd, bias_sd = gyro_density * sqrt(0.5 * dt), noise.bias_rad_s_rts * sqrt(dt)
    if noise.velocity_m_s_rthz is not None:
        vx, vy = vx + dt * ux, vy + dt * uy
        for tilt, row, fall in ((rows[TILT_Y], rows[VELOCITY_X], dt * G), (rows[TILT_X], rows[VELOCITY_Y], -dt * G)):
            for j, a in enumerate(tilt):
                row[j] += fall * a
    (b00,), (b10, b11), (b20, b21, b22) = rows[:3]
    for i, (c0, c1, c2) in zip((TILT_X, TILT_Y, HEADING), c, strict=True):
        row = rows[i]
        row[0] -= dt * (c0 * b00 + c1 * b10 + c2 * b20)
        row[1] -= dt * (c1 * b11 + c2 * b21)
        row[2] -= dt * c2 * b22
    for i in range(3):
        add_noise(rows, i, bias_sd)
    add_noise(rows, TILT_X, gyro_sd)
    add_noise(rows, TILT_Y, gyro_sd)
    if noise.velocity_m_s_rthz is not None:
        accel_sd = noise.accel_m_s2_rthz * sqrt(0.5 * dt)
        add_noise(rows, VELOCITY_X, accel_sd)
        add_noise(rows, VELOCITY_Y, accel_sd)
    add_noise(rows, len(rows) - 1, gyro_sd)
    return Estimate(q, e.root, e.bias_rad_s, (vx, vy)), (ux, uy, uz)


def corrected(
    e: Estimate, rows: Rows, states: tuple[int, int], residual: tuple[float, float], variance: float
) -> Estimate:
    """The estimate after both `states` were measured by themselves with this variance.

    The correction of heading is left out, and what the measurement would have taken from its variance is given back.
    """
    first, second = states
    x = _measured(rows, first, residual[0], variance)
    left = residual[1] - x[second]
    x = [a + b for a, b in zip(x, _measured(rows, second, left, variance), strict=True)]
    bx, by, bz = e.bias_rad_s
    vx, vy = e.velocity_m_s
    if len(x) > VELOCITY_Y:
        vx, vy = vx + x[VELOCITY_X], vy + x[VELOCITY_Y]
    return Estimate(
        q=turned(e.q, (x[TILT_X], x[TILT_Y], 0.0)),
        root=frozen(rows),
        bias_rad_s=(bx + x[0], by + x[1], bz + x[2]),
        velocity_m_s=(vx, vy),
    )


def _measured(rows: Rows, m: int, residual: float, variance: float) -> list[float]:
    total = sigma(rows[m]) ** 2 + variance
    gain = measure(rows, m, variance)
    rows[HEADING][-1] = hypot(rows[HEADING][-1], gain[-1] * sqrt(total))
    return [k * residual for k in gain]


def turned(q: Quaternion, angle: Vector) -> Quaternion:
    """exp(angle) (x) q: `q` turned by a rotation vector of the world, in rad."""
    turn = step((1.0, 0.0, 0.0, 0.0), angle, 1.0, "exp")
    return normalised(product(turn, q))
