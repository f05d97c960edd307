"""Gyrocompassing: what it finds, and what it refuses to have found."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from quavelet.alignment.earth_rate import align_earth_rate, earth_rate_matrix, gyrocompass
from quavelet.alignment.result import EARTH_RATE_RAD_S, UNIFORM_RAD, Heading
from quavelet.alignment.sensors import MPU6050, SensorErrors
from quavelet.core.euler import from_euler, to_euler
from quavelet.core.quaternion import conjugate, from_matrix, multiply, rotate

G = 9.80665
DEG_H = np.radians(1.0) / 3600.0
NAVIGATION = SensorErrors(
    accel_noise_m_s2_rthz=50e-6,
    accel_bias_m_s2=500e-6,
    gyro_noise_rad_s_rthz=0.2 * DEG_H,
    gyro_bias_rad_s=0.05 * DEG_H,
)


def board(latitude_deg: float, q, n: int = 1):
    """Perfect rates and forces of a board at rest."""
    latitude = np.radians(latitude_deg)
    rate = rotate(conjugate(q), EARTH_RATE_RAD_S * np.array([0.0, np.cos(latitude), np.sin(latitude)]))
    return np.tile(rate, (n, 1)), np.tile(rotate(conjugate(q), np.array([0.0, 0.0, G])), (n, 1))


@pytest.mark.parametrize("latitude_deg", [-70.0, -32.0, 0.0, 30.58, 80.0])
def test_heading_is_found_on_both_hemispheres_and_the_equator(latitude_deg):
    q = from_euler(np.radians([5.0, -8.0, 123.0]), order="zxy")
    gyro, accel = board(latitude_deg, q, 40)
    found = align_earth_rate(gyro, accel, period_s=1.0, latitude_rad=np.radians(latitude_deg), errors=NAVIGATION)
    assert found.heading is Heading.OBSERVED, found.reason
    assert np.degrees(to_euler(found.q, order="zxy")) == pytest.approx([5.0, -8.0, 123.0], abs=1e-9)


def test_a_tilt_about_north_is_doubt_of_heading_at_high_latitudes():
    """Shaken along x: that is east, and so a tilt about north, where the board faces north; not where it faces east."""
    sigma = []
    for heading_deg in (0.0, 90.0):
        q = from_euler(np.radians([0.0, 0.0, heading_deg]), order="zxy")
        gyro, accel = board(70.0, q, 1600)
        accel = accel + np.repeat(np.random.default_rng(11).standard_normal((16, 1)), 100, axis=0) * [0.1, 0.0, 0.0]
        found = align_earth_rate(gyro, accel, period_s=0.1, latitude_rad=np.radians(70.0), errors=NAVIGATION)
        assert found.heading is Heading.OBSERVED, found.reason
        sigma.append(found.sigma_rad)
    assert sigma[0][1] == pytest.approx(sigma[1][0], rel=0.01)
    assert sigma[0][2] ** 2 - sigma[1][2] ** 2 == pytest.approx((np.tan(np.radians(70.0)) * sigma[0][1]) ** 2, rel=0.05)


def test_two_thirds_of_all_errors_are_within_one_sigma():
    rng = np.random.default_rng(2020)
    truth = from_euler(np.radians([-0.5, -0.1, 70.0]), order="zxy")
    gyro, accel = board(45.0, truth, 64)
    errors = replace(NAVIGATION, accel_bias_m_s2=0.05)
    inside = np.zeros(3)
    for _ in range(400):
        found = align_earth_rate(
            gyro
            + errors.gyro_bias_rad_s * rng.standard_normal(3)
            + errors.gyro_sd_rad_s(1.0) * rng.standard_normal((64, 3)),
            accel + errors.accel_bias_m_s2 * rng.standard_normal(3),
            period_s=1.0,
            latitude_rad=np.radians(45.0),
            errors=errors,
        )
        assert found.heading is Heading.OBSERVED, found.reason
        d = multiply(found.q, conjugate(truth))
        inside += np.abs(2.0 * d[1:]) < found.sigma_rad
    assert (inside / 400 > 0.60).all(), inside
    assert (inside / 400 < 0.76).all(), inside


def test_an_mpu6050_is_refused_with_the_numbers():
    gyro, accel = board(30.58, np.array([1.0, 0.0, 0.0, 0.0]), 2000)
    found = align_earth_rate(gyro, accel, period_s=0.01, latitude_rad=np.radians(30.58), errors=MPU6050)
    assert found.heading is Heading.EARTH_RATE_HIDDEN
    assert "0.01 deg/s of gyroscope error in 0.0036 deg/s of horizontal earth rate" in found.reason
    assert "heading would be anywhere" in found.reason
    assert found.sigma_rad[2] == UNIFORM_RAD
    assert found.heading_sigma_rad > UNIFORM_RAD


@pytest.mark.parametrize(("bias_deg_h", "error_deg"), [(0.1, 0.44), (1.0, 4.4)])
def test_the_sigma_of_a_gyroscope_is_that_of_the_papers_limit(bias_deg_h, error_deg):
    """At 30.58 deg, an error of 0.1 and 1 deg/h along east turns heading by 0.44 and 4.4 deg."""
    errors = replace(NAVIGATION, gyro_bias_rad_s=bias_deg_h * DEG_H)
    heading, sigma_rad, _ = gyrocompass(errors, latitude_rad=np.radians(30.58))
    assert heading is Heading.OBSERVED
    assert np.degrees(sigma_rad) == pytest.approx(error_deg, rel=0.02)


def test_the_worst_gyroscope_that_is_let_through_is_a_fifth_of_the_earths_rate():
    for share, heading in ((0.19, Heading.OBSERVED), (0.21, Heading.EARTH_RATE_HIDDEN)):
        errors = replace(NAVIGATION, gyro_bias_rad_s=share * EARTH_RATE_RAD_S * np.cos(np.radians(32.0)))
        assert gyrocompass(errors, latitude_rad=np.radians(32.0))[0] is heading


@pytest.mark.parametrize("latitude_deg", [90.0, -90.0, 89.5])
def test_at_a_pole_there_is_no_heading_but_a_tilt(latitude_deg):
    q = from_euler(np.radians([5.0, -8.0, 123.0]), order="zxy")
    gyro, accel = board(latitude_deg, q, 40)
    found = align_earth_rate(gyro, accel, period_s=1.0, latitude_rad=np.radians(latitude_deg), errors=NAVIGATION)
    assert found.heading is Heading.NEAR_POLE
    assert rotate(found.q, accel[0]) == pytest.approx([0.0, 0.0, G], abs=1e-9)


def test_a_bias_taken_from_the_same_rest_leaves_no_earth_rate():
    """Rates of exactly zero would be north by rounding errors."""
    _, accel = board(45.0, np.array([1.0, 0.0, 0.0, 0.0]), 100)
    found = align_earth_rate(np.zeros((100, 3)), accel, period_s=1.0, latitude_rad=0.785, errors=NAVIGATION)
    assert found.heading is Heading.NOT_EARTH_RATE
    assert "bias" in found.reason


def test_the_wrong_hemisphere_is_noticed():
    gyro, accel = board(45.0, np.array([1.0, 0.0, 0.0, 0.0]), 100)
    found = align_earth_rate(gyro, accel, period_s=1.0, latitude_rad=-0.785, errors=NAVIGATION)
    assert found.heading is Heading.NOT_EARTH_RATE


def test_one_bad_sample_of_a_hundred_turns_heading_by_less_than_a_degree():
    """Acceptance 4d: the paper's example prints 168.27 deg; that is a mean, not a sample, off by 0.01 deg/s."""
    gyro, accel = board(30.58, from_euler(np.radians([0.0, 0.0, -30.0]), order="zxy"), 100)
    gyro[50, 1] -= np.radians(0.01)
    matrix = earth_rate_matrix(gyro.mean(axis=0), accel[0], latitude_rad=np.radians(30.58))
    heading_ccw = -np.degrees(to_euler(from_matrix(matrix), order="zxy")[2])
    assert 30.7 < heading_ccw < 30.9


@pytest.mark.parametrize("latitude", [np.nan, 2.0, -2.0])
def test_no_latitude_is_refused(latitude):
    gyro, accel = board(45.0, np.array([1.0, 0.0, 0.0, 0.0]))
    with pytest.raises(ValueError, match="is no latitude"):
        align_earth_rate(gyro, accel, period_s=1.0, latitude_rad=latitude, errors=NAVIGATION)


def test_nan_and_no_samples_are_refused():
    gyro, accel = board(45.0, np.array([1.0, 0.0, 0.0, 0.0]), 3)
    with pytest.raises(ValueError, match="gyro_rad_s has values that are not finite"):
        align_earth_rate(gyro * np.nan, accel, period_s=1.0, latitude_rad=0.7, errors=NAVIGATION)
    with pytest.raises(ValueError, match="gyro_rad_s has 0 samples"):
        align_earth_rate(gyro[:0], accel, period_s=1.0, latitude_rad=0.7, errors=NAVIGATION)
    with pytest.raises(ValueError, match="is no sample period"):
        align_earth_rate(gyro, accel, period_s=0.0, latitude_rad=0.7, errors=NAVIGATION)
