"""What turns counts into SI: offset, scale and misalignment of one chip, and how sure each is."""

from __future__ import annotations

from dataclasses import dataclass

from quavelet.core.units import RAD_PER_DEG, STANDARD_GRAVITY_M_S2

Vector = tuple[float, float, float]
Matrix = tuple[Vector, Vector, Vector]

IDENTITY: Matrix = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))


@dataclass(frozen=True, slots=True, kw_only=True)
class ImuCalibration:
    """true = matrix (measured - offset), for gyroscope and accelerometer, body frame.

    gyro_bias_rad_s          what the gyroscope reads at rest; None: measure it at the still start
    accel_sigma_m_s2         one sigma of an accelerometer axis' remaining offset
    gyro_scale_sigma         one sigma of the remaining relative error of a turned angle
    gyro_bias_sigma_rad_s    one sigma of the rate's bias once it is known
    gyro_bias_sigma_rad_s_degc   one sigma of how it goes with the chip's temperature

    The defaults are an uncalibrated chip, the limits of the data sheet (PS 6.1, 6.2) taken as the ends of uniform
    distributions: zero-g 50, 50, 80 mg, 3 % of sensitivity and 2 % across the axes make 40 mg, and 20 deg/s over the
    60 degC to each end of the temperature range make 0.19 deg/s/degC. A bias measured at rest is good to about
    0.01 deg/s for the minutes after, at the same temperature.
    """

    gyro_bias_rad_s: Vector | None = None
    gyro_matrix: Matrix = IDENTITY
    accel_offset_m_s2: Vector = (0.0, 0.0, 0.0)
    accel_matrix: Matrix = IDENTITY
    accel_sigma_m_s2: float = 0.040 * STANDARD_GRAVITY_M_S2
    gyro_scale_sigma: float = 0.03 / 3**0.5
    gyro_bias_sigma_rad_s: float = 0.01 * RAD_PER_DEG
    gyro_bias_sigma_rad_s_degc: float = 20.0 / 60.0 / 3**0.5 * RAD_PER_DEG


UNCALIBRATED = ImuCalibration()
