"""A truth of which every axis shows something of its own, far enough from zero that a wrong scale is seen."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hw_fakes import Imperfections
from hw_fakes.world.motion import Still
from hw_fakes.world.motion_base import FloatArray
from quavelet.core.units import RAD_PER_DEG, STANDARD_GRAVITY_M_S2

TEMP_DEGC = 31.5
RATE_DEG_S = (61.3, -119.7, 238.9)
ROLL_DEG, PITCH_DEG = 30.0, -20.0
FORCE_M_S2: list[float] = [
    -STANDARD_GRAVITY_M_S2 * float(np.sin(PITCH_DEG * RAD_PER_DEG)),
    STANDARD_GRAVITY_M_S2 * float(np.sin(ROLL_DEG * RAD_PER_DEG) * np.cos(PITCH_DEG * RAD_PER_DEG)),
    STANDARD_GRAVITY_M_S2 * float(np.cos(ROLL_DEG * RAD_PER_DEG) * np.cos(PITCH_DEG * RAD_PER_DEG)),
]

# PS-MPU-6000A-00 6.1 to 6.3.
ACCEL_LSB_M_S2 = {
    g: STANDARD_GRAVITY_M_S2 / lsb_per_g for g, lsb_per_g in {2: 16384, 4: 8192, 8: 4096, 16: 2048}.items()
}
GYRO_LSB_PER_DEG_S = {250: 131.0, 500: 65.5, 1000: 32.8, 2000: 16.4}
TEMP_LSB_DEGC = 1 / 340


@dataclass(frozen=True, slots=True)
class Oblique(Still):
    """A board that is not level and does not move, whose gyroscope is told to turn."""

    roll_deg: float = ROLL_DEG
    pitch_deg: float = PITCH_DEG

    def rate_rad_s(self, t_s: FloatArray) -> FloatArray:
        return np.tile(np.array(RATE_DEG_S) * RAD_PER_DEG, (len(t_s), 1))


def at_temperature(temp_degc: float = TEMP_DEGC) -> Imperfections:
    """No error, and a die that is and stays at `temp_degc`."""
    return Imperfections(temp_degc=temp_degc, warm_temp_degc=temp_degc, bias_temp_degc=temp_degc)
