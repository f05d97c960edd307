"""What is wrong with one particular sensor, apart from the chip's logic and from the motion."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from quavelet.core.units import RAD_PER_DEG, STANDARD_GRAVITY_M_S2

FloatArray = NDArray[np.float64]
Triple = tuple[float, float, float]
Matrix = tuple[Triple, Triple, Triple]

# Data sheet PS-MPU-6000A-00 6.1 and 6.2: noise densities (one-sided) and the limits of zero offsets and sensitivity.
GYRO_NOISE_RAD_S_RTHZ = 0.005 * RAD_PER_DEG
ACCEL_NOISE_M_S2_RTHZ = 400e-6 * STANDARD_GRAVITY_M_S2
GYRO_BIAS_LIMIT_DPS = 20.0
ACCEL_BIAS_LIMIT_MG = (50.0, 50.0, 80.0)
SCALE_LIMIT = 0.03
CROSS_AXIS_LIMIT = 0.02
GYRO_NONLINEARITY_LIMIT = 0.002
ACCEL_NONLINEARITY_LIMIT = 0.005
GYRO_PER_G_LIMIT_RAD_S = 0.1 * RAD_PER_DEG

# The ends of the widest ranges: an error small there is smaller still in every other range.
GYRO_FULL_SCALE_RAD_S = 2000.0 * RAD_PER_DEG
ACCEL_FULL_SCALE_M_S2 = 16.0 * STANDARD_GRAVITY_M_S2

NO_MATRIX: Matrix = ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0))

# Not in the data sheet: what Allan deviations of single parts show.
GYRO_DRIFT_RAD_S = 0.003 * RAD_PER_DEG
ACCEL_DRIFT_M_S2 = 50e-6 * STANDARD_GRAVITY_M_S2


@dataclass(frozen=True, slots=True)
class Imperfections:
    """Errors of a sensor: what it shows is bend((scale + cross axis) truth) + bias + noise.

    In the matrices row i is what axis i shows; raises ValueError where a cross-axis matrix has a diagonal.

    gyro_bias_rad_s         at `bias_temp_degc`
    gyro_bias_rad_s_degc    how the bias goes with the die's temperature
    gyro_noise_rad_s_rthz   white, one-sided density, before the low-pass filter
    gyro_cross_axis         rad/s shown for 1 rad/s about each axis: misalignment and cross-axis sensitivity
    accel_cross_axis        likewise
    gyro_per_g_rad_s        shown for 1 g of specific force along each axis
    gyro_nonlinearity       largest distance of each axis from its best straight line, over the widest range and as a
                            part of its end; the curve is cubic, and scale is its slope at zero
    accel_nonlinearity      likewise; the curve is a parabola, so that vibration is seen as a steady force too
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
    gyro_cross_axis: Matrix = NO_MATRIX
    accel_cross_axis: Matrix = NO_MATRIX
    gyro_per_g_rad_s: Matrix = NO_MATRIX
    gyro_nonlinearity: Triple = (0.0, 0.0, 0.0)
    accel_nonlinearity: Triple = (0.0, 0.0, 0.0)
    gyro_drift_rad_s: float = 0.0
    accel_drift_m_s2: float = 0.0
    drift_correlation_s: float = 100.0
    bias_temp_degc: float = 25.0
    temp_degc: float = 25.0
    warm_temp_degc: float = 25.0
    warm_up_s: float = 300.0
    temp_noise_degc: float = 0.0

    def __post_init__(self) -> None:
        if np.diag(self.gyro_cross_axis).any() or np.diag(self.accel_cross_axis).any():
            raise ValueError("the diagonal of a cross-axis matrix must be 0: give gyro_scale or accel_scale")

    def gyro_shown_rad_s(self, rate_rad_s: FloatArray, force_m_s2: FloatArray | None) -> FloatArray:
        """What the gyroscope makes of a rate (N, 3), without bias and noise.

        `force_m_s2` is the specific force (N, 3); None where it is not `feels_force`.
        """
        matrix = np.diag(self.gyro_scale) + np.array(self.gyro_cross_axis)
        shown = bent(rate_rad_s @ matrix.T, self.gyro_nonlinearity, end=GYRO_FULL_SCALE_RAD_S, power=3)
        if force_m_s2 is not None:
            shown = shown + force_m_s2 / STANDARD_GRAVITY_M_S2 @ np.array(self.gyro_per_g_rad_s).T
        return shown

    def accel_shown_m_s2(self, force_m_s2: FloatArray) -> FloatArray:
        """What the accelerometer makes of a specific force (N, 3), without bias and noise."""
        matrix = np.diag(self.accel_scale) + np.array(self.accel_cross_axis)
        return bent(force_m_s2 @ matrix.T, self.accel_nonlinearity, end=ACCEL_FULL_SCALE_M_S2, power=2)

    @property
    def feels_force(self) -> bool:
        """The gyroscope shows something for a specific force."""
        return bool(np.any(self.gyro_per_g_rad_s))

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


def bent(straight: FloatArray, nonlinearity: Triple, *, end: float, power: int) -> FloatArray:
    """Values (N, 3) on a curve that goes from its best straight line over +-`end` by `nonlinearity` * `end` at most."""
    if not any(nonlinearity):
        return straight
    # Of all curves u^p + ... of degree p, Chebyshev's is nearest to 0 on -1 to 1, by 2^(1 - p); for a square or a cube
    # what it has beside u^p is a straight line.
    size = 2.0 ** (power - 1) * end * np.array(nonlinearity)
    curve: FloatArray = straight + size * (straight / end) ** power
    return curve


def draw(seed: int) -> Imperfections:
    """A sensor drawn evenly from within the data sheet's limits; the same seed gives the same sensor."""
    rng = np.random.default_rng(seed)

    def triple(limit: float | Triple, middle: float = 0.0) -> Triple:
        x, y, z = middle + np.broadcast_to(limit, 3) * rng.uniform(-1.0, 1.0, 3)
        return float(x), float(y), float(z)

    def matrix(limit: float, *, diagonal: float) -> Matrix:
        rows = limit * rng.uniform(-1.0, 1.0, (3, 3)) * np.where(np.eye(3), diagonal, 1.0)
        x, y, z = ((float(a), float(b), float(c)) for a, b, c in rows)
        return x, y, z

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
        gyro_cross_axis=matrix(CROSS_AXIS_LIMIT, diagonal=0.0),
        accel_cross_axis=matrix(CROSS_AXIS_LIMIT, diagonal=0.0),
        # So that 1 g in any direction is within the limit.
        gyro_per_g_rad_s=matrix(GYRO_PER_G_LIMIT_RAD_S / np.sqrt(3.0), diagonal=1.0),
        gyro_nonlinearity=triple(GYRO_NONLINEARITY_LIMIT),
        accel_nonlinearity=triple(ACCEL_NONLINEARITY_LIMIT),
    )


PERFECT = Imperfections()
"""No error but the resolution of the counts. At rest all samples are alike: software may call that a stuck chip."""

NOISE_ONLY = Imperfections(
    gyro_noise_rad_s_rthz=GYRO_NOISE_RAD_S_RTHZ, accel_noise_m_s2_rthz=ACCEL_NOISE_M_S2_RTHZ, temp_noise_degc=0.05
)
"""No error but the data sheet's noise."""

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
