"""Paper 000's simulations: a board that lies still, one that is turned, and the methods on them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from quavelet.attitude.doubt import Residual
from quavelet.attitude.kernel import Vector, standing
from quavelet.attitude.params import FilterParams
from quavelet.attitude.pid import PidState
from quavelet.attitude.settling import settled
from quavelet.core.blocks import AttitudeBlock, FloatArray
from quavelet.core.euler import from_euler, to_euler
from quavelet.core.quaternion import conjugate, multiply, normalise, rotate
from quavelet.core.units import DEG_PER_RAD, RAD_PER_DEG
from quavelet.denoise.offline import Reading, paper_000
from quavelet.study.sensor_model import G, SensorModel, block

RATE_HZ, MEAN_S, STILL_S = 100.0, 5.0, 60.0
RESIDUAL = Residual(tilt_rad=0.0, gyro_bias_rad_s=0.003 * RAD_PER_DEG, gyro_bias_rad_s_degc=0.0, gyro_scale=0.0)
P = FilterParams(kind="p", kp=1.0)
PER_SAMPLE = FilterParams(kind="pid", kp=1.0, ki=0.02, kd=0.5 / RATE_HZ, kd_tau_s=0.001)
"""As printed, the derivative as a difference per sample, as the usual code has it."""
RAW_DERIVATIVE = FilterParams(kind="pid", kp=1.0, ki=0.02, kd=0.5, kd_tau_s=0.001)
"""As printed, the derivative as a derivative."""
GYRO, ACCELEROMETER = FilterParams(kind="gyro"), FilterParams(kind="accelerometer")
GATED = FilterParams(kind="gated")


@dataclass(frozen=True, slots=True, eq=False)
class Recorded:
    """What the chip gave, its bias by the mean of the first still seconds, and the true attitude's angles in deg.

    gyro_rad_s, accel_m_s2 (N, 3) begin after those seconds; `q` is the attitude their mean accelerometer gives.
    """

    gyro_rad_s: FloatArray
    accel_m_s2: FloatArray
    bias_rad_s: FloatArray
    start: Vector
    angles_deg: FloatArray


def recorded(
    angles_rad: FloatArray, rng: np.random.Generator, *, ramp_deg_s_min: float = 0.0, mean_s: float = MEAN_S
) -> Recorded:
    """A board led through roll, pitch, yaw (N, 3), after `mean_s` of stillness; its bias may grow steadily."""
    first = round(mean_s * RATE_HZ)
    angles = np.concatenate([np.tile(angles_rad[:1], (first, 1)), angles_rad])
    q = from_euler(angles)
    turn = normalise(multiply(conjugate(np.concatenate([q[:1], q[:-1]])), q))
    size = np.linalg.norm(turn[:, 1:], axis=1, keepdims=True)
    rate = turn[:, 1:] * 2.0 * np.arctan2(size, turn[:, :1]) / np.where(size > 0.0, size, 1.0) * RATE_HZ
    gyro, force = SensorModel(rate_hz=RATE_HZ).measured(rate, rotate(conjugate(q), np.array([0.0, 0.0, G])), rng)
    grown = np.maximum(np.arange(len(gyro)) - first, 0.0) / RATE_HZ / 60.0 * ramp_deg_s_min * RAD_PER_DEG
    gyro = gyro + grown[:, None]
    x, y, z = force[:first].mean(axis=0).tolist()
    return Recorded(
        gyro[first:], force[first:], gyro[:first].mean(axis=0), (x, y, z), DEG_PER_RAD * np.unwrap(angles_rad, axis=0)
    )


def still() -> FloatArray:
    """The angles of a board that lies level for a minute."""
    return np.zeros((round(STILL_S * RATE_HZ), 3))


def led() -> FloatArray:
    """20 s still; roll to 30 deg and back, pitch 10 deg at 0.2 Hz, a turn of 90 deg in yaw, 30 deg more at 1.2 deg/s,
    and 5 s still."""
    t = np.arange(round(92.0 * RATE_HZ)) / RATE_HZ
    roll = 30.0 * (_eased(t, 20.0, 26.0) - _eased(t, 28.0, 34.0))
    pitch = np.where((t >= 36.0) & (t < 51.0), 10.0 * np.sin(2.0 * np.pi * 0.2 * (t - 36.0)), 0.0)
    yaw = 90.0 * _eased(t, 53.0, 58.0) + np.clip(1.2 * (t - 61.0), 0.0, 30.0)
    return RAD_PER_DEG * np.column_stack([roll, pitch, yaw])


def turned(rate_deg_s: float, turn_deg: float) -> FloatArray:
    """30 s still, a turn in yaw at this rate, 10 s still."""
    t = np.arange(round((40.0 + turn_deg / rate_deg_s) * RATE_HZ)) / RATE_HZ
    yaw = np.clip(rate_deg_s * (t - 30.0), 0.0, turn_deg)
    return RAD_PER_DEG * np.column_stack([0.0 * t, 0.0 * t, yaw])


def _eased(t: FloatArray, start: float, end: float) -> FloatArray:
    eased: FloatArray = 0.5 - 0.5 * np.cos(np.pi * np.clip((t - start) / (end - start), 0.0, 1.0))
    return eased


def attitude(r: Recorded, params: FilterParams, *, reading: Reading | None = None) -> AttitudeBlock:
    """The attitude by one method. `reading`: what is done to the rate first, A, C or D; A and D take its mean away
    themselves. The filter starts from the mean accelerometer, its bias by the mean rate."""
    zeroed = reading in ("A", "D")
    rate = r.gyro_rad_s if zeroed else r.gyro_rad_s - r.bias_rad_s
    if reading is not None:
        rate = paper_000(rate, reading=reading)
    samples = block(rate, r.accel_m_s2, rate_hz=RATE_HZ, bias_rad_s=np.zeros(3) if zeroed else r.bias_rad_s)
    built = params.build(residual=RESIDUAL)
    if params.kind in ("gyro", "p", "pid"):
        x, y, z = rate[0].tolist()
        bx, by, bz = samples.gyro_bias_rad_s[0].tolist()
        built.restore(
            PidState(q=standing(r.start), rate_rad_s=(x, y, z), settling=settled(), bias=(bx, by, bz), bias_degc=25.0)
        )
    return built.process(samples)


def errors_deg(r: Recorded, found: AttitudeBlock) -> FloatArray:
    """Roll, pitch, heading (N, 3), found less true, heading from where it began."""
    angles = DEG_PER_RAD * np.unwrap(to_euler(found.q), axis=0)
    off: FloatArray = angles - r.angles_deg
    off[:, 2] -= off[0, 2]
    off[:, :2] -= 360.0 * np.round(off[:, :2] / 360.0)
    return off
