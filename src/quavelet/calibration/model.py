"""What turns counts into SI: offset, scale and misalignment of one chip, and how sure each is."""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import inf

import numpy as np

from quavelet.core.blocks import FloatArray
from quavelet.core.units import RAD_PER_DEG, STANDARD_GRAVITY_M_S2

Vector = tuple[float, float, float]
Matrix = tuple[Vector, Vector, Vector]

IDENTITY: Matrix = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
NO_MATRIX: Matrix = ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0))

KNOWN_SPAN_DEGC = 5.0
"""Over less the curve is known where the board happened to be, and nowhere a chip that warms up goes."""


@dataclass(frozen=True, slots=True, kw_only=True)
class BiasCurve:
    """The gyroscope's bias over the chip's temperature: a polynomial in (temperature - reference_degc).

    coefficients_rad_s         of powers 0, 1, ..., x y z each, rad/s/degC^k
    lowest_degc, highest_degc  where it was measured; beyond them the value at the end is held, never more
    sigma_rad_s                one sigma of the curve within them, the chip having been off in between
    slope_sigma_rad_s_degc     one sigma of how the bias goes on from wherever it was measured at rest
    """

    reference_degc: float
    coefficients_rad_s: tuple[Vector, ...]
    lowest_degc: float
    highest_degc: float
    sigma_rad_s: float
    slope_sigma_rad_s_degc: float

    @property
    def is_known(self) -> bool:
        """Whether the bias may be taken from it before the board has been still."""
        return self.highest_degc - self.lowest_degc >= KNOWN_SPAN_DEGC

    def at(self, temp_degc: FloatArray) -> FloatArray:
        """The bias (N, 3) in rad/s at temperatures (N,)."""
        within = np.minimum(np.maximum(temp_degc, self.lowest_degc), self.highest_degc) - self.reference_degc
        axes = []
        for axis in range(3):
            bias = np.zeros_like(within)
            for coefficient in reversed(self.coefficients_rad_s):
                bias = bias * within + coefficient[axis]
            axes.append(bias)
        return np.stack(axes, axis=1)


@dataclass(frozen=True, slots=True, kw_only=True)
class MagnetometerCalibration:
    """true = soft_iron (measured - hard_iron), body frame, uT.

    hard_iron_sigma_ut   one sigma of it, uT
    field_ut             strength of the Earth's field where it was calibrated
    field_sigma          one sigma of the corrected field's strength, as a part of it
    """

    hard_iron_ut: Vector
    hard_iron_sigma_ut: Vector
    soft_iron: Matrix
    field_ut: float
    field_sigma: float

    @property
    def left_ut(self) -> float:
        """One sigma of what an axis of the corrected field may be off, uT; the noise of a measurement is in it."""
        return float(np.hypot(max(self.hard_iron_sigma_ut), self.field_sigma * self.field_ut))

    def corrected_ut(self, field_ut: FloatArray) -> FloatArray:
        """The field (N, 3) in uT without the board's own iron."""
        corrected: FloatArray = (field_ut - self.hard_iron_ut) @ np.array(self.soft_iron).T
        return corrected


@dataclass(frozen=True, slots=True, kw_only=True)
class ImuCalibration:
    """true = matrix (measured - offset), for gyroscope and accelerometer, body frame.

    gyro_bias_rad_s          what the gyroscope reads at rest; None: measure it at the still start
    gyro_bias_curve          the same over temperature; what remains is measured at the still start
    gyro_per_force           rad/s shown for 1 m/s^2 of specific force along each axis
    accel_sigma_m_s2         one sigma of an accelerometer axis' remaining offset
    gyro_scale_sigma         one sigma of the remaining relative error of a turned angle
    gyro_bias_sigma_rad_s    one sigma of the rate's bias once it is known
    gyro_bias_sigma_rad_s_degc   one sigma of how it goes with the chip's temperature
    lowest_degc, highest_degc    where all this holds; samples beyond are flagged UNCALIBRATED_TEMPERATURE
    magnetometer             of the magnetometer beside the chip, None where it was not calibrated

    The defaults are an uncalibrated chip, the limits of the data sheet (PS 6.1, 6.2) taken as the ends of uniform
    distributions: zero-g 50, 50, 80 mg, 3 % of sensitivity and 2 % across the axes make 40 mg, and 20 deg/s over the
    60 degC to each end of the temperature range make 0.19 deg/s/degC. A bias measured at rest is good to about
    0.01 deg/s for the minutes after, at the same temperature.
    """

    gyro_bias_rad_s: Vector | None = None
    gyro_bias_curve: BiasCurve | None = None
    gyro_matrix: Matrix = IDENTITY
    gyro_per_force: Matrix = NO_MATRIX
    accel_offset_m_s2: Vector = (0.0, 0.0, 0.0)
    accel_matrix: Matrix = IDENTITY
    accel_sigma_m_s2: float = 0.040 * STANDARD_GRAVITY_M_S2
    gyro_scale_sigma: float = 0.03 / 3**0.5
    gyro_bias_sigma_rad_s: float = 0.01 * RAD_PER_DEG
    gyro_bias_sigma_rad_s_degc: float = 20.0 / 60.0 / 3**0.5 * RAD_PER_DEG
    lowest_degc: float = -inf
    highest_degc: float = inf
    magnetometer: MagnetometerCalibration | None = None

    @property
    def knows_bias(self) -> bool:
        """Whether the bias is known, from the temperature, before the board has been still."""
        return self.gyro_bias_curve is not None and self.gyro_bias_curve.is_known

    def turned(self, rotation: Matrix) -> ImuCalibration:
        """The calibration that gives rates, forces and fields in the axes of a body in which the chip lies so."""
        to_body, magnetometer = np.array(rotation), self.magnetometer
        if magnetometer is not None:
            magnetometer = replace(magnetometer, soft_iron=_rows(to_body @ np.array(magnetometer.soft_iron)))
        return replace(
            self,
            gyro_matrix=_rows(to_body @ np.array(self.gyro_matrix)),
            gyro_per_force=_rows(np.array(self.gyro_per_force) @ to_body.T),
            accel_matrix=_rows(to_body @ np.array(self.accel_matrix)),
            magnetometer=magnetometer,
        )


def _rows(matrix: FloatArray) -> Matrix:
    (a, b, c), (d, e, f), (g, h, i) = matrix.tolist()
    return (a, b, c), (d, e, f), (g, h, i)


UNCALIBRATED = ImuCalibration()
