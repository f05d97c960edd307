"""An MPU-6050 by its data sheet, for the papers' simulations: true motion in, counts' worth of samples out."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from quavelet.core.blocks import Flag, FloatArray, ImuBlock
from quavelet.core.units import NS_PER_S, RAD_PER_DEG, STANDARD_GRAVITY_M_S2

G = STANDARD_GRAVITY_M_S2


@dataclass(frozen=True, slots=True, kw_only=True)
class SensorModel:
    """One-sided densities as data sheets give them; a sample's standard deviation is density * sqrt(rate / 2).

    The noises are PS 6.1 and 6.2 (0.005 deg/s/rtHz, 400 ug/rtHz), the bias at the start uniform within 20 deg/s. How
    it wanders is not in the data sheet: a first order Gauss-Markov process of 100 s, 0.003 deg/s and 50 ug.
    """

    rate_hz: float = 100.0
    gyro_rad_s_rthz: float = 0.005 * RAD_PER_DEG
    accel_m_s2_rthz: float = 400e-6 * G
    bias_limit_rad_s: float = 20.0 * RAD_PER_DEG
    gyro_wander_rad_s: float = 0.003 * RAD_PER_DEG
    accel_wander_m_s2: float = 50e-6 * G
    wander_tau_s: float = 100.0
    gyro_lsb_rad_s: float = RAD_PER_DEG / 131.0
    accel_lsb_m_s2: float = G / 16384.0

    def measured(
        self, rate_rad_s: FloatArray, force_m_s2: FloatArray, rng: np.random.Generator
    ) -> tuple[FloatArray, FloatArray]:
        """Rate and force (N, 3) as the chip would give them, bias and all."""
        n = len(rate_rad_s)
        white = np.sqrt(self.rate_hz / 2.0)
        bias = rng.uniform(-self.bias_limit_rad_s, self.bias_limit_rad_s, 3)
        gyro = rate_rad_s + bias + self._wander(n, self.gyro_wander_rad_s, rng)
        force = force_m_s2 + self._wander(n, self.accel_wander_m_s2, rng)
        gyro = gyro + self.gyro_rad_s_rthz * white * rng.standard_normal((n, 3))
        force = force + self.accel_m_s2_rthz * white * rng.standard_normal((n, 3))
        return (
            self.gyro_lsb_rad_s * np.round(gyro / self.gyro_lsb_rad_s),
            self.accel_lsb_m_s2 * np.round(force / self.accel_lsb_m_s2),
        )

    def _wander(self, n: int, sigma: float, rng: np.random.Generator) -> FloatArray:
        keep = float(np.exp(-1.0 / (self.rate_hz * self.wander_tau_s)))
        kicks = sigma * np.sqrt(1.0 - keep * keep) * rng.standard_normal((n, 3))
        out, value = np.empty((n, 3)), sigma * rng.standard_normal(3)
        for k in range(n):
            out[k] = value
            value = keep * value + kicks[k]
        wander: FloatArray = out - out[0]
        return wander


def block(gyro_rad_s: FloatArray, accel_m_s2: FloatArray, *, rate_hz: float, bias_rad_s: FloatArray | None) -> ImuBlock:
    """The samples as the filters take them; a bias of None is not known, else it has been taken off already."""
    n = len(gyro_rad_s)
    return ImuBlock(
        t_ns=np.round(np.arange(1, n + 1) / rate_hz * NS_PER_S).astype(np.int64),
        period_s=np.full(n, 1.0 / rate_hz),
        gap_ns=np.zeros(n, dtype=np.int64),
        flags=np.full(n, int(Flag.BIAS_UNKNOWN) if bias_rad_s is None else 0, dtype=np.uint32),
        gyro_rad_s=gyro_rad_s,
        accel_m_s2=accel_m_s2,
        temp_degc=np.full(n, 25.0),
        gyro_bias_rad_s=np.tile(np.zeros(3) if bias_rad_s is None else bias_rad_s, (n, 1)),
        still=np.zeros(n, dtype=np.bool_),
    )
