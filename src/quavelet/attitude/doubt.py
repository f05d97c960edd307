"""How sure the attitude is: one sigma of tilt and of yaw, sample by sample."""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import hypot, pi, sqrt

from quavelet.attitude.kernel import ZERO, Vector
from quavelet.core.units import RAD_PER_DEG

TILT_FLOOR_RAD = 0.02 * RAD_PER_DEG
"""Accelerometer noise through a loop of kp = 1 (0.012 deg by the data sheet's density, more on real chips)."""
GYRO_DENSITY_RAD = 0.02 * RAD_PER_DEG
"""Rate noise in rad/s/rtHz as real chips show it; the data sheet's 0.005 deg/s/rtHz is at its best."""
YAW_MAX_RAD = pi / sqrt(3.0)
"""A uniform distribution over the circle: nothing is known."""
BIAS_LIMIT_SIGMA_RAD_S = 20.0 * RAD_PER_DEG / sqrt(3.0)
"""A bias not yet measured: the data sheet's +-20 deg/s (PS 6.1), uniform."""
ERROR_TAU_S = 1.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Residual:
    """What the calibration leaves open, one sigma each: tilt, the bias once known and how it goes with the chip's
    temperature since then, the relative scale."""

    tilt_rad: float
    gyro_bias_rad_s: float
    gyro_bias_rad_s_degc: float
    gyro_scale: float


@dataclass(frozen=True, slots=True)
class Doubt:
    """Running measures of the disagreement between gyroscope and gravity, and of what yaw has gone through.

    error_ms      mean square of the tilt error over ERROR_TAU_S, rad^2
    pull_rad      the tilt error through the loop's own low-pass: what acceleration does to the attitude
    pull_ms       its mean square, rad^2
    gap_ms        mean square of what a bridged gap may have cost in tilt, fading with the loop, rad^2
    yaw_s         time since yaw counts from zero
    turned_rad    turned about the vertical since then
    drift_rad     what the bias may have made of it, each step's sigma added up: the error keeps its sign
    yaw_ms        mean square of what gaps may have cost in yaw, rad^2
    """

    error_ms: float = (5.0 * RAD_PER_DEG) ** 2
    pull_rad: Vector = ZERO
    pull_ms: float = (5.0 * RAD_PER_DEG) ** 2
    gap_ms: float = 0.0
    yaw_s: float = 0.0
    turned_rad: float = 0.0
    drift_rad: float = 0.0
    yaw_ms: float = 0.0


def bias_sigma(residual: Residual, *, known: bool, warmer_degc: float) -> float:
    """One sigma of the bias in rad/s, when the chip is `warmer_degc` than when its bias was measured."""
    if not known:
        return BIAS_LIMIT_SIGMA_RAD_S
    return hypot(residual.gyro_bias_rad_s, residual.gyro_bias_rad_s_degc * warmer_degc)


def after_step(doubt: Doubt, error: Vector, turn_rad_s: float, drift_rad_s: float, dt: float, kp: float) -> Doubt:
    """One more step of `dt` with this tilt error, this rate about the vertical and this sigma of the bias, in a loop
    of gain `kp`."""
    ex, ey, ez = error
    px, py, pz = doubt.pull_rad
    share = kp * dt / (1.0 + kp * dt)
    px, py, pz = px + share * (ex - px), py + share * (ey - py), pz + share * (ez - pz)
    fade = dt / (ERROR_TAU_S + dt)
    return Doubt(
        error_ms=doubt.error_ms + fade * (ex * ex + ey * ey + ez * ez - doubt.error_ms),
        pull_rad=(px, py, pz),
        pull_ms=doubt.pull_ms + fade * (px * px + py * py + pz * pz - doubt.pull_ms),
        gap_ms=doubt.gap_ms * (1.0 - share) * (1.0 - share),
        yaw_s=doubt.yaw_s + dt,
        turned_rad=doubt.turned_rad + turn_rad_s * dt,
        drift_rad=doubt.drift_rad + drift_rad_s * dt,
        yaw_ms=doubt.yaw_ms,
    )


def yaw_anew(doubt: Doubt) -> Doubt:
    """Yaw counts from zero here."""
    return replace(doubt, yaw_s=0.0, turned_rad=0.0, drift_rad=0.0, yaw_ms=0.0)


def after_gap(doubt: Doubt, change: Vector, gap_s: float, *, unheld: float) -> Doubt:
    """A gap was bridged by the mean of two rates that differ by `change`: wrong by half of it at worst, and by the
    angle `unheld` in rad where the mean was not held to its end."""
    x, y, z = change
    ms = 0.25 * (x * x + y * y + z * z) * gap_s * gap_s + unheld * unheld
    return replace(doubt, gap_ms=doubt.gap_ms + ms, yaw_ms=doubt.yaw_ms + ms)


def sigmas(doubt: Doubt, residual: Residual) -> tuple[float, float]:
    """One sigma in rad of tilt (about each horizontal axis) and of yaw since it counts from zero."""
    tilt = sqrt(residual.tilt_rad**2 + TILT_FLOOR_RAD**2 + doubt.pull_ms + doubt.gap_ms)
    scale = residual.gyro_scale * doubt.turned_rad
    yaw = sqrt(GYRO_DENSITY_RAD**2 * doubt.yaw_s + doubt.drift_rad**2 + scale * scale + doubt.yaw_ms)
    return tilt, min(yaw, YAW_MAX_RAD)
