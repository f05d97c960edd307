"""A board that rolls, pitches and turns, as a data sheet's sensors see it; and the filters paper 003 is judged by."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from quavelet.attitude.doubt import Residual
from quavelet.attitude.fusion import FusionFilter
from quavelet.attitude.fusion_literal import LiteralParams, begun, literal_step
from quavelet.attitude.fusion_params import FusionParams
from quavelet.attitude.kernel import standing
from quavelet.attitude.pid import PidFilter, PidParams
from quavelet.core.blocks import FloatArray, ImuBlock
from quavelet.core.quaternion import from_rotation_vector, multiply
from quavelet.core.units import DEG_PER_RAD, NS_PER_S, RAD_PER_DEG
from quavelet.core.units import STANDARD_GRAVITY_M_S2 as G
from quavelet.denoise.hampel import GYRO_FLOOR_RAD_S, hampel_filter

SEED = 20190910
RATE_HZ = 100.0
DURATION_S = 120.0
STILL_S = 5.0
SCORED_FROM_S = 30.0
BIAS_RAD_S = RAD_PER_DEG * np.array([0.6, -0.4, 0.3])
SWAY_G, SWAY_HZ = 0.05, (0.5, 0.37)
ACCEL_SIGMA_G = 2.83e-3
GYRO_SIGMA_RAD_S = 0.0354 * RAD_PER_DEG
RESIDUAL = Residual(tilt_rad=0.0, gyro_bias_rad_s=0.0, gyro_bias_rad_s_degc=0.0, gyro_scale=0.0)


@dataclass(frozen=True, slots=True, eq=False)
class Recording:
    """What the sensors gave, and the truth: gyro_rad_s and accel_m_s2 (N, 3), q (N, 4)."""

    gyro_rad_s: FloatArray
    accel_m_s2: FloatArray
    q: FloatArray

    def without_spikes(self) -> Recording:
        """The paper's first step: the obvious outliers of the rate removed."""
        gyro = hampel_filter(self.gyro_rad_s, 5, sigmas=4.0, floor=GYRO_FLOOR_RAD_S)
        return Recording(gyro, self.accel_m_s2, self.q)

    def calibrated(self) -> Recording:
        """The mean rate of the first still seconds taken off."""
        still = self.gyro_rad_s[: round(STILL_S * RATE_HZ)].mean(axis=0)
        return Recording(self.gyro_rad_s - still, self.accel_m_s2, self.q)


def recording(run: int, *, biased: bool, sway: bool) -> Recording:
    """120 s: 5 s at rest, then roll 20 deg at 0.1 Hz, pitch 12 deg at 0.07 Hz, yaw 30 deg at 0.03 Hz.

    Noise, in-run bias and steps of an MPU-6050 at its best (PS 6.1, 6.2); one rate in 500 has a spike of
    8 deg/s. With `sway` the board is pushed along both horizontals by 0.05 g.
    """
    rng = np.random.default_rng([SEED, run])
    n, dt = round(DURATION_S * RATE_HZ), 1.0 / RATE_HZ
    q = _attitude(dt * np.arange(n + 1, dtype=np.float64))
    turn = multiply(q[:-1] * [1.0, -1.0, -1.0, -1.0], q[1:])
    rate = 2.0 / dt * np.arctan2(np.linalg.norm(turn[:, 1:], axis=1), turn[:, 0])[:, None] * _unit(turn[:, 1:])
    q = q[1:]
    t = np.arange(1, n + 1) * dt
    push = SWAY_G * np.column_stack([*(np.sin(2.0 * np.pi * hz * t) for hz in SWAY_HZ), np.zeros(n)])
    force = (push if sway else 0.0) + np.array([0.0, 0.0, 1.0])
    back = q * [1.0, -1.0, -1.0, -1.0]
    seen = multiply(multiply(back, np.column_stack([np.zeros(n), np.broadcast_to(force, (n, 3))])), q)[:, 1:]
    gyro = rate + (BIAS_RAD_S if biased else 0.0) + _in_run(rng, n, 0.003 * RAD_PER_DEG)
    gyro += rng.normal(0.0, GYRO_SIGMA_RAD_S, (n, 3))
    spikes = rng.random((n, 3)) < 0.002
    gyro += spikes * rng.normal(0.0, 8.0 * RAD_PER_DEG, (n, 3))
    accel = seen + _in_run(rng, n, 50e-6) + rng.normal(0.0, ACCEL_SIGMA_G, (n, 3))
    return Recording(_stepped(gyro, RAD_PER_DEG / 131.0), G * _stepped(accel, 1.0 / 16384.0), q)


def _attitude(t: FloatArray) -> FloatArray:
    moving = np.maximum(t - STILL_S, 0.0)
    roll, pitch, yaw = (
        RAD_PER_DEG * a * np.sin(2.0 * np.pi * hz * moving) for a, hz in ((20.0, 0.1), (12.0, 0.07), (30.0, 0.03))
    )
    zero = np.zeros_like(t)
    about_z = from_rotation_vector(np.column_stack([zero, zero, yaw]))
    about_y = from_rotation_vector(np.column_stack([zero, pitch, zero]))
    about_x = from_rotation_vector(np.column_stack([roll, zero, zero]))
    return multiply(multiply(about_z, about_y), about_x)


def _unit(x: FloatArray) -> FloatArray:
    unit: FloatArray = x / np.maximum(np.linalg.norm(x, axis=1, keepdims=True), 1e-15)
    return unit


def _in_run(rng: np.random.Generator, n: int, sigma: float) -> FloatArray:
    """A first-order Gauss-Markov bias of this sigma, time constant 100 s, zero at first."""
    keep = np.exp(-1.0 / RATE_HZ / 100.0)
    steps = sigma * np.sqrt(1.0 - keep * keep) * rng.normal(size=(n, 3))
    out = np.zeros((n, 3))
    for k in range(1, n):
        out[k] = keep * out[k - 1] + steps[k]
    return out


def _stepped(x: FloatArray, step: float) -> FloatArray:
    stepped: FloatArray = np.round(x / step) * step
    return stepped


def block_of(data: Recording) -> ImuBlock:
    """The recording as the stages take it, at the exact period."""
    n = len(data.q)
    return ImuBlock(
        t_ns=np.round(np.arange(1, n + 1) / RATE_HZ * NS_PER_S).astype(np.int64),
        period_s=np.full(n, 1.0 / RATE_HZ),
        gap_ns=np.zeros(n, dtype=np.int64),
        flags=np.zeros(n, dtype=np.uint32),
        gyro_rad_s=data.gyro_rad_s,
        accel_m_s2=data.accel_m_s2,
        temp_degc=np.full(n, 25.0),
        gyro_bias_rad_s=np.zeros((n, 3)),
        still=np.zeros(n, dtype=np.bool_),
    )


Attitudes = Callable[[Recording], FloatArray]


def complementary(kp: float, ki: float = 0.0) -> Attitudes:
    """The complementary filter with these gains: the shipped PID filter without its derivative."""
    params = PidParams(kp=kp, ki=ki, kd=0.0)
    return lambda data: PidFilter(params, residual=RESIDUAL).process(block_of(data)).q


def six_states(sigma_mg: float) -> Attitudes:
    """The stable form with the accelerometer's white sigma a sample in mg, all else as the data sheet has it."""
    sway = sigma_mg * 1e-3 * G / np.sqrt(RATE_HZ / 2.0)
    params = FusionParams(
        model="gravity", gyro_rad_s_rthz=0.005 * RAD_PER_DEG, sway_m_s2_rthz=sway, norm_gate=0.03,
        bias_rad_s=0.02, bias_walk_rad_s_rts=0.003 * RAD_PER_DEG * 0.02**0.5, memory_s=100.0,
    )  # fmt: skip
    return lambda data: FusionFilter(params, residual=RESIDUAL).process(block_of(data)).q


def as_shipped(data: Recording) -> FloatArray:
    """The fusion filter with its own defaults."""
    return FusionFilter(FusionParams(bias_rad_s=0.02), residual=RESIDUAL).process(block_of(data)).q


def literal(forgetting: float) -> Attitudes:
    """The paper's recursive least squares, never started anew."""
    params = LiteralParams(forgetting=forgetting)

    def run(data: Recording) -> FloatArray:
        forces = data.accel_m_s2.tolist()
        at = begun(standing(tuple(forces[0])), params)
        out = np.empty((len(forces), 4))
        for k, (rate, force) in enumerate(zip(data.gyro_rad_s.tolist(), forces, strict=True)):
            if k:
                at = literal_step(at, tuple(rate), tuple(force), 1.0 / RATE_HZ, params)
            out[k] = at.q
        return out

    return run


def errors_deg(data: Recording, found: FloatArray) -> FloatArray:
    """The rotation vector from estimate to truth in the world, deg, from 30 s on: tilt x, tilt y, heading."""
    first = round(SCORED_FROM_S * RATE_HZ)
    d = multiply(data.q[first:], found[first:] * [1.0, -1.0, -1.0, -1.0])
    d = d * np.where(d[:, :1] < 0.0, -1.0, 1.0)
    size = np.linalg.norm(d[:, 1:], axis=1)
    angle = 2.0 * np.arctan2(size, d[:, 0])
    errors: FloatArray = DEG_PER_RAD * angle[:, None] * _unit(d[:, 1:])
    return errors


def tilt_deg(errors: FloatArray) -> float:
    """Root mean square of one axis of tilt."""
    return float(np.sqrt((errors[:, :2] ** 2).mean()))


def heading_deg(errors: FloatArray) -> float:
    """Root mean square of heading about its value at 30 s: where it counts from is not the filter's doing."""
    return float(np.sqrt(((errors[:, 2] - errors[0, 2]) ** 2).mean()))
