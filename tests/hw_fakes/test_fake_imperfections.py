"""Sensors as they are bought."""

from __future__ import annotations

import numpy as np
import pytest

from hw_fakes.drift import Drift
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


def test_drift_has_the_size_and_the_memory_asked_for():
    t_s = np.arange(0, 100_000, 10.0)
    wander = np.concatenate(
        [Drift(np.random.default_rng(k), sd=2.0, correlation_s=100.0)._exact(t_s) for k in range(8)], 1
    )
    assert wander.std() == pytest.approx(2.0, rel=0.05)
    for lag_s in (30, 100, 200):
        lag = lag_s // 10
        kept = np.mean(wander[lag:] * wander[:-lag]) / wander.var()
        assert kept == pytest.approx(np.exp(-lag_s / 100), abs=0.05)


def test_drift_of_a_chunk_is_straight_enough():
    drift = Drift(np.random.default_rng(1), sd=1.0, correlation_s=100.0)
    t_s = np.linspace(50, 54, 4000)
    assert np.allclose(drift.at(t_s), drift._exact(t_s), atol=1e-3)
