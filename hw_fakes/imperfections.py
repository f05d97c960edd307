"""What is wrong with one particular sensor, apart from the chip's logic and from the motion."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from quavelet.core.units import RAD_PER_DEG, STANDARD_GRAVITY_M_S2

FloatArray = NDArray[np.float64]
Triple = tuple[float, float, float]

# Data sheet PS-MPU-6000A-00 6.1 and 6.2: noise densities (one-sided) and the limits of zero offsets and sensitivity.
GYRO_NOISE_RAD_S_RTHZ = 0.005 * RAD_PER_DEG
ACCEL_NOISE_M_S2_RTHZ = 400e-6 * STANDARD_GRAVITY_M_S2
GYRO_BIAS_LIMIT_DPS = 20.0
ACCEL_BIAS_LIMIT_MG = (50.0, 50.0, 80.0)
SCALE_LIMIT = 0.03

# Not in the data sheet: what Allan deviations of single parts show.
GYRO_DRIFT_RAD_S = 0.003 * RAD_PER_DEG
ACCEL_DRIFT_M_S2 = 50e-6 * STANDARD_GRAVITY_M_S2


@dataclass(frozen=True, slots=True)
class Imperfections:
    """Errors of a sensor: what it shows is scale * truth + bias + noise.

    gyro_bias_rad_s         at `bias_temp_degc`
    gyro_bias_rad_s_degc    how the bias goes with the die's temperature
    gyro_noise_rad_s_rthz   white, one-sided density, before the low-pass filter
    gyro_settling_rad_s     error of all gyroscope axes at the moment of waking; it falls by e each 10 ms, so that
                            20 deg/s is 1 deg/s after the data sheet's 30 ms (PS 6.1)
    gyro_drift_rad_s        sd of the slow wander of its zero, which forgets itself within `drift_correlation_s`
    accel_drift_m_s2        likewise
    temp_degc               of the die when the world begins; it goes to `warm_temp_degc` with `warm_up_s`
    temp_noise_degc         white, sd of a sample
    """

    gyro_bias_rad_s: Triple = (0.0, 0.0, 0.0)
    gyro_bias_rad_s_degc: Triple = (0.0, 0.0, 0.0)
    gyro_scale: Triple = (1.0, 1.0, 1.0)
    gyro_noise_rad_s_rthz: float = 0.0
    gyro_settling_rad_s: float = 0.0
    accel_bias_m_s2: Triple = (0.0, 0.0, 0.0)
    accel_scale: Triple = (1.0, 1.0, 1.0)
    accel_noise_m_s2_rthz: float = 0.0
    gyro_drift_rad_s: float = 0.0
    accel_drift_m_s2: float = 0.0
    drift_correlation_s: float = 100.0
    bias_temp_degc: float = 25.0
    temp_degc: float = 25.0
    warm_temp_degc: float = 25.0
    warm_up_s: float = 300.0
    temp_noise_degc: float = 0.0

    def temperature_degc(self, t_s: FloatArray) -> FloatArray:
        """Die temperature (N,) at times (N,) in s since the world began."""
        cold = self.temp_degc - self.warm_temp_degc
        course: FloatArray = self.warm_temp_degc + cold * np.exp(-np.maximum(t_s, 0.0) / self.warm_up_s)
        return course

    def gyro_error_rad_s(self, t_s: FloatArray) -> FloatArray:
        """Gyroscope bias (N, 3) at times (N,) in s, without drift."""
        warmer = self.temperature_degc(t_s) - self.bias_temp_degc
        bias: FloatArray = np.array(self.gyro_bias_rad_s) + warmer[:, None] * np.array(self.gyro_bias_rad_s_degc)
        return bias


def draw(seed: int) -> Imperfections:
    """A sensor drawn evenly from within the data sheet's limits; the same seed gives the same sensor."""
    rng = np.random.default_rng(seed)

    def triple(limit: float | Triple, middle: float = 0.0) -> Triple:
        x, y, z = middle + np.broadcast_to(limit, 3) * rng.uniform(-1.0, 1.0, 3)
        return float(x), float(y), float(z)

    g = STANDARD_GRAVITY_M_S2
    x_mg, y_mg, z_mg = ACCEL_BIAS_LIMIT_MG
    return Imperfections(
        gyro_bias_rad_s=triple(GYRO_BIAS_LIMIT_DPS * RAD_PER_DEG),
        # PS 6.1: +-20 deg/s over -40 to 85 degC, that is over 60 degC each way from 25 degC.
        gyro_bias_rad_s_degc=triple(GYRO_BIAS_LIMIT_DPS * RAD_PER_DEG / 60.0),
        gyro_scale=triple(SCALE_LIMIT, 1.0),
        gyro_noise_rad_s_rthz=GYRO_NOISE_RAD_S_RTHZ,
        gyro_settling_rad_s=20.0 * RAD_PER_DEG,
        accel_bias_m_s2=triple((x_mg * 1e-3 * g, y_mg * 1e-3 * g, z_mg * 1e-3 * g)),
        accel_scale=triple(SCALE_LIMIT, 1.0),
        accel_noise_m_s2_rthz=ACCEL_NOISE_M_S2_RTHZ,
        gyro_drift_rad_s=GYRO_DRIFT_RAD_S,
        accel_drift_m_s2=ACCEL_DRIFT_M_S2,
        temp_degc=float(rng.uniform(15.0, 30.0)),
        warm_temp_degc=float(rng.uniform(30.0, 40.0)),
        temp_noise_degc=0.05,
    )


PERFECT = Imperfections()
"""No error but the resolution of the counts."""

TYPICAL = Imperfections(
    gyro_bias_rad_s=(4.5 * RAD_PER_DEG, 0.1 * RAD_PER_DEG, 1.1 * RAD_PER_DEG),
    gyro_bias_rad_s_degc=(0.02 * RAD_PER_DEG, -0.015 * RAD_PER_DEG, 0.01 * RAD_PER_DEG),
    gyro_scale=(1.008, 0.995, 1.004),
    gyro_noise_rad_s_rthz=GYRO_NOISE_RAD_S_RTHZ,
    gyro_settling_rad_s=20.0 * RAD_PER_DEG,
    accel_bias_m_s2=(0.02 * STANDARD_GRAVITY_M_S2, -0.012 * STANDARD_GRAVITY_M_S2, 0.035 * STANDARD_GRAVITY_M_S2),
    accel_scale=(1.004, 0.997, 1.011),
    accel_noise_m_s2_rthz=ACCEL_NOISE_M_S2_RTHZ,
    gyro_drift_rad_s=GYRO_DRIFT_RAD_S,
    accel_drift_m_s2=ACCEL_DRIFT_M_S2,
    temp_degc=26.0,
    warm_temp_degc=31.0,
    temp_noise_degc=0.05,
)
"""A sensor as one is bought: the gyroscope's bias is that of a part whose recordings are published."""
