"""Gravity and the magnetic field: the attitude, its sigma, and the headings that are refused."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from quavelet.alignment.result import UNIFORM_RAD, Heading
from quavelet.alignment.sensors import MPU6050, SensorErrors, mean_and_sigma
from quavelet.alignment.two_vectors import align_field, align_level, triad
from quavelet.core.euler import from_euler, to_euler
from quavelet.core.quaternion import conjugate, multiply, normalise, rotate, to_matrix

G = 9.80665
DIP_RAD = np.radians(56.0)
FIELD = 48.0 * np.array([0.0, np.cos(DIP_RAD), -np.sin(DIP_RAD)])
UP = np.array([0.0, 0.0, G])
SHARP = SensorErrors(
    accel_noise_m_s2_rthz=1e-4,
    accel_bias_m_s2=0.01,
    gyro_noise_rad_s_rthz=0.0,
    gyro_bias_rad_s=0.0,
    field_noise_ut=0.2,
    field_bias_ut=0.5,
)

components = st.floats(-1.0, 1.0)
quaternions = (
    st.tuples(components, components, components, components)
    .map(np.array)
    .filter(lambda q: np.linalg.norm(q) > 0.1)
    .map(normalise)
)


def seen(q, world, n: int = 1):
    """A world vector as the body at q sees it, n times."""
    return np.tile(rotate(conjugate(q), np.asarray(world)), (n, 1))


def error_rad(q, truth):
    """The small rotation (3,) about world axes from truth to q."""
    d = multiply(q, conjugate(truth))
    return 2.0 * d[1:] * np.sign(d[0])


@given(quaternions, st.floats(1e-3, 1e3), st.floats(1e-3, 1e3))
def test_scales_of_the_sensors_leave_the_matrix_orthogonal(q, a, b):
    """Acceptance 1d: columns that are not of unit length give 0.16 for a 3 % and a 10 % error of scale."""
    matrix = triad(UP, FIELD, a * seen(q, UP)[0], b * seen(q, FIELD)[0])
    assert np.abs(matrix @ matrix.T - np.eye(3)).max() < 1e-12
    assert np.abs(matrix - to_matrix(q)).max() < 1e-12


@given(quaternions)
def test_any_attitude_is_found_again(q):
    found = align_field(seen(q, UP), seen(q, FIELD), period_s=0.01, errors=SHARP)
    assert found.heading is Heading.OBSERVED
    assert np.abs(error_rad(found.q, q)).max() < 1e-9


def test_triad_is_wahbas_answer_where_the_first_vector_is_believed_wholly():
    rng = np.random.default_rng(1)
    for _ in range(50):
        q = normalise(rng.standard_normal(4))
        force = rotate(conjugate(q), UP) + 0.05 * rng.standard_normal(3)
        field = rotate(conjugate(q), FIELD) + 0.5 * rng.standard_normal(3)
        unit = [v / np.linalg.norm(v) for v in (UP, FIELD, force, field)]
        wahba, _ = Rotation.align_vectors(unit[:2], unit[2:], weights=[1e8, 1.0])
        assert np.abs(triad(UP, FIELD, force, field) - wahba.as_matrix()).max() < 1e-6


def test_heading_is_magnetic_plus_declination_and_the_dip_drops_out():
    q = from_euler(np.radians([-3.0, 2.0, 35.0]), order="zxy")
    for dip_deg in (-70.0, 0.0, 56.0, 80.0):
        field = 48.0 * np.array([0.0, np.cos(np.radians(dip_deg)), -np.sin(np.radians(dip_deg))])
        found = align_field(seen(q, UP), seen(q, field), period_s=0.01, errors=SHARP, declination_rad=np.radians(4.0))
        assert np.degrees(to_euler(found.q, order="zxy")) == pytest.approx([-3.0, 2.0, 39.0], abs=1e-9)


@pytest.mark.parametrize("heading_deg", [0.0, 35.0, 90.0, 200.0])
def test_two_thirds_of_all_errors_are_within_one_sigma(heading_deg):
    """The sigmas are one of each axis: of 400 boards with their own biases, 68 % are within."""
    rng = np.random.default_rng(20190115)
    truth = from_euler(np.radians([-3.0, 2.0, heading_deg]), order="zxy")
    noise = SHARP.accel_sd_m_s2(0.01)
    inside = np.zeros(3)
    for _ in range(400):
        accel = seen(truth, UP) + 0.01 * rng.standard_normal(3) + noise * rng.standard_normal((100, 3))
        field = seen(truth, FIELD) + 0.5 * rng.standard_normal(3) + 0.2 * rng.standard_normal((100, 3))
        found = align_field(accel, field, period_s=0.01, errors=SHARP)
        inside += np.abs(error_rad(found.q, truth)) < found.sigma_rad
    assert (inside / 400 > 0.60).all(), inside
    assert (inside / 400 < 0.76).all(), inside


def test_noise_that_no_data_sheet_knows_widens_the_sigma():
    rng = np.random.default_rng(3)
    shaken = seen(normalise(np.array([1.0, 0.0, 0.0, 0.0])), UP) + rng.standard_normal((1600, 3)) * [0.0, 0.0, 4.0]
    _, sigma = mean_and_sigma(shaken, noise_sd=0.001, bias_sigma=0.01)
    assert sigma[:2] == pytest.approx(0.01, rel=0.01)
    assert sigma[2] == pytest.approx(0.1, rel=0.5)


def shaken_along_x(heading_deg: float):
    """Level, with slow shaking along the body's own x of 0.05 g a sample."""
    q = from_euler(np.radians([0.0, 0.0, heading_deg]), order="zxy")
    rng = np.random.default_rng(11)
    accel = seen(q, UP) + np.repeat(rng.standard_normal((16, 1)), 100, axis=0) * [0.5, 0.0, 0.0]
    return accel, seen(q, FIELD)


def test_shaking_along_an_axis_is_doubt_about_the_other():
    """And through the dip in heading, where it is a tilt about north."""
    north, east = (
        align_field(*shaken_along_x(heading), period_s=0.01, errors=replace(SHARP, accel_bias_m_s2=1e-4))
        for heading in (0.0, 90.0)
    )
    assert north.sigma_rad[1] > 50 * north.sigma_rad[0]
    assert east.sigma_rad[0] > 50 * east.sigma_rad[1]
    assert north.sigma_rad[2] > 1.2 * east.sigma_rad[2]
    assert north.sigma_rad[2] ** 2 - east.sigma_rad[2] ** 2 == pytest.approx(
        (np.tan(DIP_RAD) * north.sigma_rad[1]) ** 2, rel=0.05
    )


def test_doubt_without_heading_is_about_the_axes_of_yaw_zero():
    """Where x is forward and yaw counts from it, shaking along x is doubt about y."""
    for heading_deg in (0.0, 50.0, 90.0):
        level = align_level(shaken_along_x(heading_deg)[0], period_s=0.01, errors=replace(SHARP, accel_bias_m_s2=1e-4))
        assert level.sigma_rad[1] > 50 * level.sigma_rad[0]


def test_doubt_of_the_declination_is_doubt_of_heading():
    level = np.array([1.0, 0.0, 0.0, 0.0])
    found = align_field(
        seen(level, UP), seen(level, FIELD), period_s=0.01, errors=SHARP, declination_sigma_rad=np.radians(6.0)
    )
    assert 6.0 < np.degrees(found.sigma_rad[2]) < 6.3


def test_a_field_along_gravity_tells_no_heading():
    q = from_euler(np.radians([10.0, 20.0, 70.0]), order="zxy")
    field = 60.0 * np.array([0.0, np.sin(np.radians(5.0)), -np.cos(np.radians(5.0))])
    found = align_field(seen(q, UP, 50), seen(q, field, 50), period_s=0.01, errors=MPU6050)
    assert found.heading is Heading.FIELD_ALONG_GRAVITY
    assert "60.0 uT has 5.2 uT across gravity" in found.reason
    assert found.sigma_rad[2] == UNIFORM_RAD
    assert to_euler(found.q)[2] == pytest.approx(0.0, abs=1e-12)
    assert rotate(found.q, seen(q, UP)[0]) == pytest.approx(UP, abs=1e-9)
    exactly = align_field(seen(q, UP), seen(q, -UP), period_s=0.01, errors=MPU6050)
    assert exactly.heading is Heading.FIELD_ALONG_GRAVITY
    assert np.isfinite(exactly.q).all()


def test_hard_iron_hides_north():
    """20 mG of it in 0.27 G is 4 deg, 100 mG is 21 deg and refused."""
    level = np.array([1.0, 0.0, 0.0, 0.0])
    for iron_ut, heading in ((2.0, Heading.OBSERVED), (10.0, Heading.FIELD_UNSURE)):
        found = align_field(
            seen(level, UP), seen(level, FIELD), period_s=0.01, errors=replace(SHARP, field_bias_ut=iron_ut)
        )
        assert found.heading is heading
        assert found.heading_sigma_rad == pytest.approx(iron_ut / 26.84, rel=0.05)
        assert "uT of horizontal field, dip 56 deg" in found.reason


def test_gravity_alone_gives_tilt_and_says_why_no_heading():
    q = from_euler(np.radians([150.0, -40.0, 0.0]))
    found = align_level(seen(q, UP, 100), period_s=0.01, errors=MPU6050)
    assert found.heading is Heading.NO_REFERENCE
    assert np.isinf(found.heading_sigma_rad)
    assert np.degrees(to_euler(found.q)) == pytest.approx([150.0, -40.0, 0.0], abs=1e-9)
    # 5 mg of offset is 0.29 deg.
    assert np.degrees(found.sigma_rad[:2]) == pytest.approx([0.287, 0.287], abs=0.01)


def test_gravity_along_each_axis_is_level_enough_to_say_so():
    for axis in (*np.eye(3), *-np.eye(3)):
        found = align_level(G * axis[None, :], period_s=0.01, errors=MPU6050)
        assert rotate(found.q, axis) == pytest.approx([0.0, 0.0, 1.0], abs=1e-12)


@pytest.mark.parametrize(
    ("accel", "field", "complaint"),
    [
        ([[0.0, np.nan, G]], [FIELD], "not finite"),
        ([[0.0, 0.0, G]], [[np.inf, 0.0, 0.0]], "not finite"),
        ([[0.0, 0.0, 0.0]], [FIELD], "not gravity"),
        ([[0.0, 0.0, 1.0]], [FIELD], "1?0.102 g"),
        ([[0.0, 0.0, 16.0]], [FIELD], "1.63 g, which is not gravity"),
        ([[0.0, 0.0, G]], [[0.0, 0.0, 0.0]], "magnetometer gives nothing"),
        (np.zeros((0, 3)), [FIELD], "0 samples"),
        ([0.0, 0.0, G], [FIELD], "one row x, y, z"),
    ],
)
def test_what_is_no_measurement_is_refused(accel, field, complaint):
    with pytest.raises(ValueError, match=complaint):
        align_field(np.asarray(accel), np.asarray(field), period_s=0.01, errors=MPU6050)
