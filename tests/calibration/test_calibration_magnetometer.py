"""Hard and soft iron are found from a turned board, and refused where it was hardly turned."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from quavelet.calibration.accelerometer import sphere_points
from quavelet.calibration.magnetometer import coverage_of, fit_magnetometer
from quavelet.calibration.model import ImuCalibration, MagnetometerCalibration
from quavelet.core.errors import CalibrationError

FIELD_UT = 49.0


def shown(directions, *, hard_ut, soft, noise_ut=0.3, seed=0):
    """What a magnetometer shows of a field from these directions: true = soft (measured - hard)."""
    rng = np.random.default_rng(seed)
    return FIELD_UT * directions @ np.linalg.inv(soft).T + hard_ut + rng.normal(0.0, noise_ut, directions.shape)


@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 10**6))
def test_the_iron_of_any_board_is_found(seed):
    rng = np.random.default_rng(seed)
    hard = rng.uniform(-150.0, 150.0, 3)
    bend = rng.uniform(-0.1, 0.1, (3, 3))
    soft = np.eye(3) + bend + bend.T
    soft /= np.linalg.det(soft) ** (1 / 3)
    fit = fit_magnetometer(shown(sphere_points(400), hard_ut=hard, soft=soft, seed=seed))
    assert np.abs(np.array(fit.calibration.hard_iron_ut) - hard).max() < 0.3
    assert np.abs(np.array(fit.calibration.soft_iron) - soft).max() < 0.006
    assert abs(fit.field_ut - FIELD_UT) < 0.2
    assert fit.coverage == 1.0
    assert fit.rms_after < 0.01 < fit.rms_before


def test_a_drill_that_comes_near_for_a_moment_changes_nothing():
    samples = shown(sphere_points(500), hard_ut=np.array([20.0, -30.0, 5.0]), soft=np.eye(3))
    disturbed = samples.copy()
    disturbed[200:230] += [40.0, 10.0, -25.0]
    clean, found = fit_magnetometer(samples), fit_magnetometer(disturbed)
    assert (~found.used[200:230]).sum() >= 25
    assert np.abs(np.subtract(clean.calibration.hard_iron_ut, found.calibration.hard_iron_ut)).max() < 0.2


@pytest.mark.parametrize("part", ["flat on the table", "half the sphere"])
def test_a_board_that_was_hardly_turned_is_refused(part):
    directions = sphere_points(600)
    directions = directions[np.abs(directions[:, 2]) < 0.2 if part == "flat on the table" else directions[:, 2] > 0.0]
    with pytest.raises(CalibrationError, match="turn it on"):
        fit_magnetometer(shown(directions, hard_ut=np.zeros(3), soft=np.eye(3)))


def test_coverage_grows_with_what_was_seen():
    points = sphere_points(1000)
    parts = [coverage_of(points[points[:, 2] > z]) for z in (0.9, 0.5, 0.0, -0.5, -1.0)]
    assert parts == sorted(parts)
    assert parts[-1] == 1.0
    assert coverage_of(np.empty((0, 3))) == 0.0


def test_the_calibration_makes_the_field_one_size():
    samples = shown(sphere_points(300), hard_ut=np.array([60.0, 0.0, -40.0]), soft=np.diag([1.1, 0.95, 0.9569378]))
    corrected = fit_magnetometer(samples).calibration.corrected_ut(samples)
    assert np.linalg.norm(corrected, axis=1).std() / FIELD_UT < 0.01


def test_a_chip_mounted_another_way_shows_the_same_field_in_the_bodys_axes():
    magnetometer = MagnetometerCalibration(
        hard_iron_ut=(1.0, -2.0, 0.5),
        hard_iron_sigma_ut=(0.3, 0.4, 0.3),
        soft_iron=((1.02, 0.01, -0.02), (0.01, 0.97, 0.03), (-0.02, 0.03, 1.01)),
        field_ut=48.0,
        field_sigma=0.01,
    )
    to_body = ((0.0, 1.0, 0.0), (0.0, 0.0, 1.0), (1.0, 0.0, 0.0))
    turned = ImuCalibration(magnetometer=magnetometer).turned(to_body).magnetometer
    field = np.array([[20.0, -5.0, 40.0]])
    assert turned.corrected_ut(field) == pytest.approx(magnetometer.corrected_ut(field) @ np.array(to_body).T)
    assert turned.left_ut == pytest.approx(np.hypot(0.4, 0.48))


def test_a_vector_without_length_covers_nothing_and_spoils_nothing():
    points = sphere_points(50)
    assert coverage_of(np.zeros((3, 3))) == 0.0
    assert coverage_of(np.vstack([np.zeros((1, 3)), points])) == coverage_of(points)
