"""The unit of paper 001, at rest, shaken and turned, and what its sensors make of it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from quavelet.alignment.sensors import MPU6050
from quavelet.alignment.two_vectors import UP, triad
from quavelet.core.blocks import FloatArray
from quavelet.core.euler import from_euler, to_euler
from quavelet.core.quaternion import from_matrix, to_matrix
from quavelet.core.units import DEG_PER_RAD, STANDARD_GRAVITY_M_S2

RATE_HZ, DURATION_S = 100.0, 30.0
G = STANDARD_GRAVITY_M_S2
ATTITUDE_DEG = (-3.0, 2.0, 35.0)
"""Roll, pitch, heading, order "zxy"."""
DIP_RAD = np.radians(56.0)
FIELD_UT = 30.0 * np.array([0.0, 1.0, -np.tan(DIP_RAD)])
"""0.3 G of horizontal field as the paper has it; the dip is ours and drops out."""
ACCEL_LSB, FIELD_LSB_UT = G / 16384.0, 100.0 / 1090.0
AXES = ("pitch", "roll", "heading")


@dataclass(frozen=True, slots=True)
class Scenario:
    """A way to move: the true angles (N, 3) in deg, a force (N, 3) on top of gravity, and the samples looked at."""

    name: str
    angles_deg: FloatArray
    shaking_m_s2: FloatArray
    looked_at: slice


def scenarios() -> tuple[Scenario, ...]:
    """Still, shaken, jumping and swinging."""
    n = round(DURATION_S * RATE_HZ)
    t = np.arange(n) / RATE_HZ
    still = np.tile(np.array(ATTITUDE_DEG), (n, 1))
    none = np.zeros((n, 3))
    shaking = G * (0.010 * np.sin(2 * np.pi * 13.0 * t) + 0.006 * np.sin(2 * np.pi * 27.3 * t))[:, None] * np.ones(3)
    middle = n // 2
    jump = still + np.where(t[:, None] >= t[middle], np.array([6.0, 10.0, 15.0]), 0.0)
    swing = still + np.sin(2 * np.pi * 5.0 * t)[:, None] * np.array([1.5, 2.0, 3.0])
    half_s, all_of_it = round(0.5 * RATE_HZ), slice(None)
    return (
        Scenario("still", still, none, all_of_it),
        Scenario("shaken at 13 and 27.3 Hz", still, shaking, all_of_it),
        Scenario("half a second about a jump", jump, none, slice(middle - half_s, middle + half_s)),
        Scenario("swinging at 5 Hz", swing, none, all_of_it),
    )


def measured(scenario: Scenario, rng: np.random.Generator, runs: int) -> tuple[FloatArray, FloatArray]:
    """Specific force in m/s^2 and field in uT, (runs, N, 3), as whole counts."""
    to_world = to_matrix(from_euler(np.radians(scenario.angles_deg), order="zxy"))
    shape = (runs, *scenario.angles_deg.shape)
    force = G * to_world[:, 2, :] + scenario.shaking_m_s2
    field = np.einsum("nij,i->nj", to_world, FIELD_UT)
    force = force + MPU6050.accel_sd_m_s2(1 / RATE_HZ) * rng.standard_normal(shape)
    field = field + MPU6050.field_noise_ut * rng.standard_normal(shape)
    return ACCEL_LSB * np.round(force / ACCEL_LSB), FIELD_LSB_UT * np.round(field / FIELD_LSB_UT)


def angles_deg(force: FloatArray, field: FloatArray) -> FloatArray:
    """Roll, pitch, heading (runs, N, 3) of each pair of vectors."""
    return DEG_PER_RAD * to_euler(from_matrix(triad(UP, FIELD_UT, force, field)), order="zxy")


def off_deg(found: FloatArray, true: FloatArray) -> FloatArray:
    """Pitch, roll, heading, found minus true, of roll, pitch, heading."""
    off: FloatArray = ((found - true + 180.0) % 360.0 - 180.0)[..., [1, 0, 2]]
    return off


def rms_of(off: FloatArray) -> FloatArray:
    """Over runs and samples."""
    rms: FloatArray = np.sqrt(np.mean(np.square(off), axis=(0, 1)))
    return rms
