"""What the sensors of an alignment get wrong, and what that makes of a mean."""

from __future__ import annotations

from dataclasses import dataclass
from math import sqrt

import numpy as np

from quavelet.core.blocks import FloatArray
from quavelet.core.units import RAD_PER_DEG, STANDARD_GRAVITY_M_S2

BATCHES = 16
"""The scatter of so many means of equal length tells what the noise makes of the mean of all."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SensorErrors:
    """Noise, and what remains of the bias after calibration: one sigma of each axis.

    Densities are one-sided, as data sheets give them: the standard deviation of a sample is density * sqrt(rate / 2).
    field_noise_ut is that of a sample; field_bias_ut is hard iron that the calibration left.
    """

    accel_noise_m_s2_rthz: float
    accel_bias_m_s2: float
    gyro_noise_rad_s_rthz: float
    gyro_bias_rad_s: float
    field_noise_ut: float = 0.0
    field_bias_ut: float = 0.0

    def accel_sd_m_s2(self, period_s: float) -> float:
        """Standard deviation of a sample."""
        return self.accel_noise_m_s2_rthz / sqrt(2.0 * period_s)

    def gyro_sd_rad_s(self, period_s: float) -> float:
        """Standard deviation of a sample."""
        return self.gyro_noise_rad_s_rthz / sqrt(2.0 * period_s)


MPU6050 = SensorErrors(
    accel_noise_m_s2_rthz=400e-6 * STANDARD_GRAVITY_M_S2,
    accel_bias_m_s2=0.005 * STANDARD_GRAVITY_M_S2,
    gyro_noise_rad_s_rthz=0.005 * RAD_PER_DEG,
    gyro_bias_rad_s=0.01 * RAD_PER_DEG,
    field_noise_ut=0.2,
    field_bias_ut=2.0,
)
"""Noise of the data sheet (PS 6.1, 6.2) and what a calibration leaves of the biases. Such a chip has no magnetometer;
that of an HMC5883L beside it is assumed, its hard iron calibrated to 2 uT."""


def mean_and_sigma(samples: FloatArray, *, noise_sd: float, bias_sigma: float) -> tuple[FloatArray, FloatArray]:
    """The mean (3,) of samples (N, 3) and one sigma of each axis of it.

    The noise is that of the sensor or that which the data shows, whichever is more: an engine that runs is in no data
    sheet. It shows in the scatter of the means of BATCHES parts, so it may be coloured; but a filter's memory must be
    shorter than a part.
    """
    n = len(samples)
    white = np.full(3, noise_sd / sqrt(n))
    if n >= 2 * BATCHES:
        parts = samples[: n - n % BATCHES].reshape(BATCHES, -1, 3).mean(axis=1)
        white = np.maximum(white, parts.std(axis=0, ddof=1) / sqrt(BATCHES))
    sigma: FloatArray = np.hypot(white, bias_sigma)
    return samples.mean(axis=0), sigma


def world_sigma(matrix: FloatArray, sigma: FloatArray) -> FloatArray:
    """One sigma (3,) along the world's axes of independent errors along the body's, through its matrix (3, 3)."""
    turned: FloatArray = np.sqrt(matrix**2 @ sigma**2)
    return turned


def checked(samples: FloatArray, *, name: str, at_least: int = 1) -> FloatArray:
    """The samples as (N, 3) floats. Raises ValueError where they are of another shape, too few, or not finite."""
    array = np.asarray(samples, dtype=np.float64)
    if array.ndim != 2 or array.shape[1] != 3:
        raise ValueError(f"{name} has the shape {array.shape}: give one row x, y, z a sample")
    if len(array) < at_least:
        raise ValueError(f"{name} has {len(array)} samples: give at least {at_least}")
    if not np.isfinite(array).all():
        raise ValueError(f"{name} has values that are not finite: leave those samples out")
    return array


def checked_force(samples: FloatArray, *, at_least: int = 1) -> FloatArray:
    """Specific force as `checked`. Raises ValueError also where its mean is not near one g."""
    array = checked(samples, name="accel_m_s2", at_least=at_least)
    check_gravity(array.mean(axis=0))
    return array


def check_gravity(force_m_s2: FloatArray) -> None:
    """Raises ValueError where a mean specific force (3,) is not within half a g of one g."""
    g = float(np.linalg.norm(force_m_s2)) / STANDARD_GRAVITY_M_S2
    if not 0.5 < g < 1.5:
        raise ValueError(f"the mean of accel_m_s2 is {g:.3g} g, which is not gravity: give m/s^2 of a board at rest")


def checked_period(period_s: float) -> float:
    """Raises ValueError where it is no sample period."""
    if not 0.0 < period_s < 3600.0:
        raise ValueError(f"period_s = {period_s:g} is no sample period: give seconds")
    return period_s
