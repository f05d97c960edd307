"""Sensors as they are bought."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest
from scipy.optimize import linprog

from hw_fakes.world.drift import Drift
from hw_fakes.world.imperfections import PERFECT, TYPICAL, Imperfections, draw
from quavelet.core.units import DEG_PER_RAD, RAD_PER_DEG, STANDARD_GRAVITY_M_S2

MG = STANDARD_GRAVITY_M_S2 * 1e-3


@dataclass(frozen=True)
class Held:
    """A board held at one rate in deg/s and one specific force in g, whatever attitude that would lead to."""

    rate_dps: object = (0.0, 0.0, 0.0)
    force_g: object = (0.0, 0.0, 0.0)
    force_hz: float = 0.0

    def rate_rad_s(self, t_s):
        return np.tile(np.array(self.rate_dps) * RAD_PER_DEG, (len(t_s), 1))

    def specific_force_m_s2(self, t_s):
        course = np.cos(2 * np.pi * self.force_hz * t_s)
        return np.outer(course, np.array(self.force_g) * STANDARD_GRAVITY_M_S2)


def shown(make_board, parts, motion, *, dlpf=1, bits=0):
    """What the chip's counts say: specific force in g and rate in deg/s; `bits` is the range of both, 0 to 3."""
    board = make_board(motion=motion, imperfections=parts)
    board.wake(dlpf=dlpf, gyro=bits << 3, accel=bits << 3)
    board.wait_ms(5)
    words = board.sensors()
    return words[:3] * 2.0**bits / 16384, words[4:] / (131, 65.5, 32.8, 16.4)[bits]


def slopes(show, size):
    """The matrix of `show`, found from both senses of each axis at `size`."""
    return np.stack([(show(size * axis) - show(-size * axis)) / (2 * size) for axis in np.eye(3)], 1)


def distance_from_best_line(x, y):
    """The least that the largest distance of points from a straight line can be."""
    line, one = np.column_stack([x, np.ones_like(x)]), np.ones((len(x), 1))
    best = linprog([0, 0, 1], np.block([[line, -one], [-line, -one]]), np.concatenate([y, -y]), bounds=(None, None))
    return best.x[2]


def a_matrix(seed, size):
    values = np.random.default_rng(seed).uniform(-size, size, (3, 3))
    return tuple(map(tuple, values)), values


def without_diagonal(seed, size):
    values = a_matrix(seed, size)[1] * (1 - np.eye(3))
    return tuple(map(tuple, values)), values


def test_perfect_has_no_error():
    assert not any(PERFECT.gyro_bias_rad_s + PERFECT.accel_bias_m_s2 + PERFECT.gyro_bias_rad_s_degc)
    assert set(PERFECT.gyro_scale + PERFECT.accel_scale) == {1.0}
    rate, force = np.random.default_rng(2).normal(size=(2, 100, 3))
    assert np.array_equal(PERFECT.gyro_shown_rad_s(rate, force), rate)
    assert np.array_equal(PERFECT.accel_shown_m_s2(force), force)


def test_sensors_are_within_the_data_sheets_limits():
    for parts in (TYPICAL, *map(draw, range(200))):
        assert np.all(np.abs(parts.gyro_bias_rad_s) <= 20 / DEG_PER_RAD)
        assert np.all(np.abs(parts.accel_bias_m_s2) <= np.array([50, 50, 80]) * MG)
        assert np.all(np.abs(np.array(parts.gyro_scale + parts.accel_scale) - 1) <= 0.03)
        assert parts.gyro_noise_rad_s_rthz * DEG_PER_RAD == pytest.approx(0.005)
        assert parts.accel_noise_m_s2_rthz == pytest.approx(0.4 * MG)


def test_sensors_are_within_the_limits_of_cross_axis_linearity_and_force():
    for parts in (TYPICAL, *map(draw, range(200))):
        assert np.all(np.abs([parts.gyro_cross_axis, parts.accel_cross_axis]) <= 0.02)
        assert np.all(np.linalg.norm(parts.gyro_per_g_rad_s, axis=1) * DEG_PER_RAD <= 0.1)
        assert np.all(np.abs(parts.gyro_nonlinearity) <= 0.002)
        assert np.all(np.abs(parts.accel_nonlinearity) <= 0.005)


@pytest.mark.parametrize("seed", range(3))
def test_turn_about_one_axis_shows_in_the_others_by_the_cross_axis_matrix(make_board, seed):
    cross, values = without_diagonal(seed, 0.02)
    parts = Imperfections(gyro_cross_axis=cross, gyro_scale=(1.03, 0.97, 1.01))
    found = slopes(lambda rate_dps: shown(make_board, parts, Held(rate_dps=rate_dps))[1], 200.0)
    assert found == pytest.approx(values + np.diag([1.03, 0.97, 1.01]), abs=3e-5)


@pytest.mark.parametrize("seed", range(3))
def test_force_along_one_axis_shows_in_the_others_by_the_cross_axis_matrix(make_board, seed):
    cross, values = without_diagonal(seed, 0.02)
    parts = Imperfections(accel_cross_axis=cross, accel_scale=(1.03, 0.97, 1.01))
    found = slopes(lambda force_g: shown(make_board, parts, Held(force_g=force_g))[0], 1.9)
    assert found == pytest.approx(values + np.diag([1.03, 0.97, 1.01]), abs=3e-5)


@pytest.mark.parametrize("name", ["gyro_cross_axis", "accel_cross_axis"])
def test_scale_in_the_place_of_cross_axis_is_refused(name):
    with pytest.raises(ValueError, match="diagonal"):
        Imperfections(**{name: ((0, 0, 0), (0, 0.01, 0), (0, 0, 0))})


@pytest.mark.parametrize("dlpf", [0, 1])
def test_gyroscope_shows_a_force_by_its_sensitivity_and_no_more(make_board, dlpf):
    per_g, values = a_matrix(5, 3 * RAD_PER_DEG)
    parts = Imperfections(gyro_per_g_rad_s=per_g)
    found = slopes(lambda force_g: shown(make_board, parts, Held(force_g=force_g), dlpf=dlpf)[1], 1.9)
    assert found == pytest.approx(values * DEG_PER_RAD, abs=0.5 / 131)
    assert list(shown(make_board, parts, Held(rate_dps=(10, -20, 30)))[1]) == [10, -20, 30]


def test_force_does_not_see_the_accelerometers_own_errors_on_its_way_to_the_gyroscope(make_board):
    per_g = ((RAD_PER_DEG, 0, 0), (0, RAD_PER_DEG, 0), (0, 0, RAD_PER_DEG))
    parts = Imperfections(gyro_per_g_rad_s=per_g, accel_scale=(1.03, 1.03, 1.03), accel_bias_m_s2=(1, 1, 1))
    assert list(shown(make_board, parts, Held(force_g=(1, 1, -1)))[1]) == [1, 1, -1]


@pytest.mark.parametrize(("bits", "end_dps"), [(3, 2000), (2, 1000), (0, 250)])
def test_gyroscope_goes_from_its_best_line_by_its_nonlinearity(make_board, bits, end_dps):
    parts = Imperfections(gyro_nonlinearity=(0.002, -0.002, 0.0), gyro_scale=(0.98, 0.98, 0.98))
    rates_dps = np.linspace(-end_dps, end_dps, 41)
    seen = np.array([shown(make_board, parts, Held(rate_dps=(rate,) * 3), bits=bits)[1] for rate in rates_dps])
    # Over a part of the widest range the cube of that part is left.
    expected_dps = 0.002 * 2000 * (0.98 * end_dps / 2000) ** 3
    half_lsb_dps = end_dps / 32768 / 2
    assert distance_from_best_line(rates_dps, seen[:, 0]) == pytest.approx(expected_dps, rel=0.01, abs=half_lsb_dps)
    assert distance_from_best_line(rates_dps, seen[:, 1]) == pytest.approx(expected_dps, rel=0.01, abs=half_lsb_dps)
    assert distance_from_best_line(rates_dps, seen[:, 2]) <= half_lsb_dps * 1.1


@pytest.mark.parametrize(("bits", "end_g"), [(3, 16), (2, 8), (0, 2)])
def test_accelerometer_goes_from_its_best_line_by_its_nonlinearity(make_board, bits, end_g):
    parts = Imperfections(accel_nonlinearity=(0.005, -0.005, 0.0), accel_scale=(0.98, 0.98, 0.98))
    forces_g = np.linspace(-end_g, end_g, 41)
    seen = np.array([shown(make_board, parts, Held(force_g=(force,) * 3), bits=bits)[0] for force in forces_g])
    expected_g = 0.005 * 16 * (0.98 * end_g / 16) ** 2
    half_lsb_g = end_g / 32768 / 2
    assert distance_from_best_line(forces_g, seen[:, 0]) == pytest.approx(expected_g, rel=0.01, abs=half_lsb_g)
    assert distance_from_best_line(forces_g, seen[:, 1]) == pytest.approx(expected_g, rel=0.01, abs=half_lsb_g)
    assert distance_from_best_line(forces_g, seen[:, 2]) <= half_lsb_g * 1.1


def test_vibration_that_the_filter_takes_away_leaves_a_steady_force(make_board):
    parts = Imperfections(accel_nonlinearity=(0.005, 0.0, 0.0))
    board = make_board(motion=Held(force_g=(10, 10, 10), force_hz=183.0), imperfections=parts)
    board.wake(dlpf=6, accel=0x18)
    board.wait_ms(5)
    board.start_fifo(0x08)
    mean_g = board.collect(2, words=3).mean(0) / 2048
    # Half the amplitude's square, by the parabola 2 * 0.005 * 16 g * u^2.
    assert mean_g == pytest.approx([0.005 * 10**2 / 16, 0, 0], abs=1e-3)


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
