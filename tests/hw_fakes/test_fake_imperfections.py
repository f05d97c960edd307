"""Sensors as they are bought."""

from __future__ import annotations

import numpy as np
import pytest

from hw_fakes.imperfections import PERFECT, TYPICAL, draw
from quavelet.core.units import DEG_PER_RAD, STANDARD_GRAVITY_M_S2

MG = STANDARD_GRAVITY_M_S2 * 1e-3


def test_perfect_has_no_error():
    assert not any(PERFECT.gyro_bias_rad_s + PERFECT.accel_bias_m_s2 + PERFECT.gyro_bias_rad_s_degc)
    assert set(PERFECT.gyro_scale + PERFECT.accel_scale) == {1.0}


def test_sensors_are_within_the_data_sheets_limits():
    for parts in (TYPICAL, *map(draw, range(200))):
        assert np.all(np.abs(parts.gyro_bias_rad_s) <= 20 / DEG_PER_RAD)
        assert np.all(np.abs(parts.accel_bias_m_s2) <= np.array([50, 50, 80]) * MG)
        assert np.all(np.abs(np.array(parts.gyro_scale + parts.accel_scale) - 1) <= 0.03)
        assert parts.gyro_noise_rad_s_rthz * DEG_PER_RAD == pytest.approx(0.005)
        assert parts.accel_noise_m_s2_rthz == pytest.approx(0.4 * MG)


def test_the_seed_names_the_sensor():
    assert draw(7) == draw(7)
    assert draw(7) != draw(8)


def test_drawn_sensors_use_the_whole_range():
    biases = np.array([draw(seed).gyro_bias_rad_s for seed in range(300)]) * DEG_PER_RAD
    assert biases.min() < -19 and biases.max() > 19 and abs(biases.mean()) < 1.5
