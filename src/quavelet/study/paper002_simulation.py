"""A board on the turning earth, at rest or swinging, seen by a gyroscope and an accelerometer."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from quavelet.alignment.cone import earth_frame
from quavelet.alignment.inertial import apparent_gravity, integrate
from quavelet.alignment.result import EARTH_RATE_RAD_S
from quavelet.core.blocks import FloatArray
from quavelet.core.euler import from_euler, to_euler
from quavelet.core.quaternion import conjugate, from_matrix, from_rotation_vector, multiply, to_matrix
from quavelet.core.units import DEG_PER_RAD, RAD_PER_DEG, STANDARD_GRAVITY_M_S2

G = STANDARD_GRAVITY_M_S2
DEG_H = RAD_PER_DEG / 3600.0
"""rad/s of a degree an hour."""
MICRO_G = 1e-6 * G


@dataclass(frozen=True, slots=True, kw_only=True)
class EarthBoard:
    """Where the board is, how it swings, and what its sensors add.

    attitude_rad   roll, pitch, heading in the middle (order "zxy")
    swing_rad      amplitude of each, as A sin(2 pi t / period + phase); 0 is rest
    gyro_noise_rad_s, accel_noise_m_s2   of a sample
    """

    latitude_rad: float = 32.0 * RAD_PER_DEG
    rate_hz: float = 200.0
    attitude_rad: tuple[float, float, float] = (0.0, 0.0, 0.0)
    swing_rad: tuple[float, float, float] = (0.0, 0.0, 0.0)
    period_s: tuple[float, float, float] = (7.0, 5.0, 6.0)
    phase_rad: tuple[float, float, float] = (np.pi / 7, np.pi / 4, np.pi / 3)
    gyro_bias_rad_s: float = 0.05 * DEG_H
    accel_bias_m_s2: float = 50.0 * MICRO_G
    gyro_noise_rad_s: float = 0.05 * DEG_H
    accel_noise_m_s2: float = 50.0 * MICRO_G

    def earth_rate(self) -> FloatArray:
        """The earth's rate in ENU, rad/s."""
        return EARTH_RATE_RAD_S * np.array([0.0, np.cos(self.latitude_rad), np.sin(self.latitude_rad)])

    def attitude(self, t_s: FloatArray) -> FloatArray:
        """The true attitude (N, 4), body to ENU."""
        swing = np.array(self.swing_rad) * np.sin(
            2 * np.pi * t_s[:, None] / np.array(self.period_s) + np.array(self.phase_rad)
        )
        return from_euler(np.array(self.attitude_rad) + swing, order="zxy")

    def times(self, duration_s: float) -> FloatArray:
        """The ends of the samples, s."""
        return np.arange(1, round(duration_s * self.rate_hz) + 1) / self.rate_hz

    def truth(self, duration_s: float) -> tuple[FloatArray, FloatArray]:
        """Rates and forces (N, 3) of perfect sensors: a rate is the turn over its sample, a force that at its end."""
        t = np.concatenate([[0.0], self.times(duration_s)])
        level = self.attitude(t)
        inertial = multiply(from_rotation_vector(t[:, None] * self.earth_rate()), level)
        step = multiply(conjugate(inertial[:-1]), inertial[1:])
        sine = np.linalg.norm(step[:, 1:], axis=1, keepdims=True)
        gyro = self.rate_hz * 2.0 * np.arctan2(sine, step[:, :1]) * step[:, 1:] / np.maximum(sine, 1e-300)
        return gyro, G * to_matrix(level[1:])[:, 2, :]

    def measured(self, duration_s: float, rng: np.random.Generator, runs: int) -> tuple[FloatArray, FloatArray]:
        """Rates and forces (runs, N, 3): the truth, a bias that is the same on all axes, and white noise."""
        gyro, accel = self.truth(duration_s)
        shape = (runs, *gyro.shape)
        return (
            gyro + self.gyro_bias_rad_s + self.gyro_noise_rad_s * rng.standard_normal(shape),
            accel + self.accel_bias_m_s2 + self.accel_noise_m_s2 * rng.standard_normal(shape),
        )


BOARD = EarthBoard()
SWINGING = replace(
    BOARD, attitude_rad=(0.0, 0.0, np.radians(30.0)), swing_rad=(np.radians(10.0), np.radians(7.0), np.radians(5.0))
)
"""30 deg clockwise. The other way round the biases, the same on each axis, leave 0.08 deg of heading, not 0.29."""
AXES = ("pitch", "roll", "heading (counter-clockwise)")


def apparent(
    board: EarthBoard, duration_s: float, rng: np.random.Generator, runs: int
) -> tuple[FloatArray, FloatArray]:
    """Apparent forces (runs, N, 3) and attitudes against the start (runs, N, 4)."""
    gyro, accel = board.measured(duration_s, rng, runs)
    q = integrate(gyro, period_s=1 / board.rate_hz)
    return apparent_gravity(q, accel), q


def row_at(t_s: float) -> int:
    """The sample that ends at `t_s`, at 200 Hz."""
    return max(0, round(t_s * 200.0) - 1)


def forces_at(force: FloatArray, picks: tuple[float, float, float]) -> FloatArray:
    """The forces (3, runs, 3) at three instants of forces (runs, N, 3)."""
    return np.stack([force[:, row_at(t)] for t in picks])


def errors_deg(board: EarthBoard, end_s: float, axis: FloatArray, up: FloatArray, q: FloatArray) -> FloatArray:
    """Pitch, roll, heading (counter-clockwise) found minus true, (runs, 3), deg."""
    q_end = q if q.ndim == 2 else q[:, -1]
    found = to_euler(from_matrix(earth_frame(axis, up) @ to_matrix(q_end)), order="zxy")
    off = DEG_PER_RAD * (found - to_euler(board.attitude(np.array([end_s])), order="zxy"))
    off = (off + 180.0) % 360.0 - 180.0
    return np.stack([off[:, 1], off[:, 0], -off[:, 2]], axis=1)
