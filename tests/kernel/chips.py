"""The chips that the guest's kernel meets, and their truth."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from hw_fakes import PERFECT, FakeMpu6050
from hw_fakes.chip.counts import RecordedCounts
from hw_fakes.chip.personalities import MPU6050
from hw_fakes.scenarios import counts_chip
from hw_fakes.world.imperfections import Imperfections
from hw_fakes.world.motion_base import EarthField, FloatArray
from quavelet.core.clock import Clock
from quavelet.core.units import RAD_PER_DEG, STANDARD_GRAVITY_M_S2

ADDRESS = 0x68
FORCE_G = (0.25, -0.5, 0.8)
RATE_DEG_S = (10.0, -20.0, 30.0)
TEMP_DEGC = 31.5
STREAM_HZ = 500


class Steady:
    """Every axis has a value of its own, and it stays; no real board could do that."""

    def rate_rad_s(self, t_s: FloatArray) -> FloatArray:
        return np.tile(np.array(RATE_DEG_S) * RAD_PER_DEG, (len(t_s), 1))

    def specific_force_m_s2(self, t_s: FloatArray) -> FloatArray:
        return np.tile(np.array(FORCE_G) * STANDARD_GRAVITY_M_S2, (len(t_s), 1))

    def attitude(self, t_s: FloatArray) -> FloatArray:
        return np.tile([1.0, 0.0, 0.0, 0.0], (len(t_s), 1))

    def magnetic_field_ut(self, t_s: FloatArray) -> FloatArray:
        return np.tile(EarthField().world_ut, (len(t_s), 1))


def steady_chip(clock: Clock, *, gyro_scale: float = 1.0, who_am_i: int = 0x68) -> FakeMpu6050:
    """A chip without errors on the steady board, but for what is asked for."""
    imperfections: Imperfections = replace(
        PERFECT, gyro_scale=(gyro_scale,) * 3, temp_degc=TEMP_DEGC, warm_temp_degc=TEMP_DEGC
    )
    return FakeMpu6050(
        clock,
        motion=Steady(),
        imperfections=imperfections,
        pll_error=0.0,
        internal_error=0.0,
        personality=replace(MPU6050, who_am_i=who_am_i),
    )


def ramps(n: int) -> NDArray[np.int16]:
    """(n, 7) register counts, accelerometer, temperature, gyroscope: a ramp of its own in every word."""
    k = np.arange(n)
    words = np.column_stack([k, -k, 1000 + 2 * k, 5000 - k, 3 * k - 900, -2 * k, 7000 - 5 * k])
    return words.astype(np.int16)


def ramp_chip(clock: Clock, n: int) -> FakeMpu6050:
    """A chip whose FIFO gives `ramps(n)`, at +-2 g, +-2000 deg/s and `STREAM_HZ`: what the kernel sets at first."""
    words = ramps(n)
    return counts_chip(
        RecordedCounts(
            acc=words[:, :3],
            gyr=words[:, 4:],
            temp=words[:, 3],
            acc_lsb_per_g=16384.0,
            gyr_lsb_per_dps=16.4,
            rate_hz=float(STREAM_HZ),
        ),
        clock=clock,
    )
