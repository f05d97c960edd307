"""Euler angles of both orders against scipy's, and against what the words pitch, roll and heading say."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from quavelet.core.euler import from_euler, to_euler
from quavelet.core.quaternion import angle_between, normalise, rotate

PI = np.pi
X, Y, Z = np.eye(3)
ORDERS = pytest.mark.parametrize("order", ["zyx", "zxy"])
TURNS = st.floats(-PI, PI)
PITCHES = st.floats(-PI / 2, PI / 2)
# As near to straight up or down as floats go, and there.
STEEP = st.tuples(st.sampled_from([-1, 1]), st.sampled_from([0.0, 1e-16, 1e-14, 1e-12, 1e-8, 1e-5, 1e-3, 0.1])).map(
    lambda sign_and_rest: sign_and_rest[0] * (PI / 2 - sign_and_rest[1])
)


def scipy_of(angles, order):
    """The rotation, by scipy: C = Rz(yaw) Ry(pitch) Rx(roll), or Rz(-heading) Rx(pitch) Ry(roll)."""
    roll, pitch, yaw = np.moveaxis(np.asarray(angles), -1, 0)
    if order == "zyx":
        return Rotation.from_euler("ZYX", np.stack([yaw, pitch, roll], axis=-1))
    return Rotation.from_euler("ZXY", np.stack([-yaw, pitch, roll], axis=-1))


def ours_of(rotation):
    return np.roll(rotation.as_quat(), 1, axis=-1)


def wrapped(angle):
    return np.remainder(angle + PI, 2 * PI) - PI


@ORDERS
@given(roll=st.floats(-7, 7), pitch=st.floats(-7, 7), yaw=st.floats(-7, 7))
def test_angles_make_the_attitude_that_scipy_makes(order, roll, pitch, yaw):
    q = from_euler(np.array([roll, pitch, yaw]), order=order)
    assert q[0] >= 0.0
    assert abs(np.linalg.norm(q) - 1.0) < 1e-12
    assert angle_between(q, ours_of(scipy_of([roll, pitch, yaw], order))) < 1e-12


@ORDERS
@given(roll=TURNS, pitch=st.floats(-1.5, 1.5), yaw=TURNS, sign=st.sampled_from([-1.0, 1.0]))
def test_angles_come_back_as_they_went_in(order, roll, pitch, yaw, sign):
    back = to_euler(sign * ours_of(scipy_of([roll, pitch, yaw], order)), order=order)
    # So near to straight up roll and yaw are told apart by 0.07 of the lever they have when level.
    assert np.abs(wrapped(back - [roll, pitch, yaw])).max() < 1e-12


@ORDERS
@given(roll=TURNS, pitch=PITCHES | STEEP, yaw=TURNS, sign=st.sampled_from([-1.0, 1.0]))
def test_the_attitude_survives_a_board_that_points_straight_up_or_down(order, roll, pitch, yaw, sign):
    q = sign * ours_of(scipy_of([roll, pitch, yaw], order))
    angles = to_euler(q, order=order)
    assert abs(angles[1] - pitch) < 1e-12
    assert np.abs(angles[[0, 2]]).max() <= PI + 1e-12
    assert abs(angles[1]) <= PI / 2 + 1e-12
    assert angle_between(from_euler(angles, order=order), q) < 1e-12
    assert (scipy_of(angles, order).inv() * Rotation.from_quat(np.roll(q, -1))).magnitude() < 1e-12


@ORDERS
def test_g1_random_attitudes_survive_the_angles(order):
    q = normalise(np.random.default_rng(1).normal(size=(10_000, 4)))
    angles = to_euler(q, order=order)
    assert angles.shape == (10_000, 3)
    assert np.abs(from_euler(angles, order=order) - q).max() < 1e-12
    np.testing.assert_allclose(to_euler(q[7], order=order), angles[7], rtol=0, atol=1e-15)


def test_g3_the_printed_equation_4_is_not_the_one_in_use():
    psi, theta, phi = 0.5, 0.2, 0.3
    q0, q1, q2, q3 = ours_of(Rotation.from_euler("ZYX", [psi, theta, phi]))
    printed_psi = np.arctan(2 * (q1 * q2 + q0 * q3) / (1 - (q2**2 + q3**2)))
    printed_phi = np.arctan(2 * (q0 * q1 + q2 * q3) / (1 - (q1**2 + q2**2)))
    assert (round(printed_psi, 3), round(printed_phi, 3)) == (0.468, 0.291)  # the factor 2 is missing in the paper
    assert np.abs(to_euler(np.array([q0, q1, q2, q3]), order="zyx") - [phi, theta, psi]).max() < 1e-12


def test_zyx_pitch_is_nose_down_roll_lifts_the_left_and_yaw_turns_left():
    """x forward, y left, z up."""
    small = 0.1
    assert rotate(from_euler(np.array([0, small, 0]), order="zyx"), X) @ Z == pytest.approx(-np.sin(small))
    assert rotate(from_euler(np.array([small, 0, 0]), order="zyx"), Y) @ Z == pytest.approx(np.sin(small))
    assert rotate(from_euler(np.array([0, 0, small]), order="zyx"), X) @ Y == pytest.approx(np.sin(small))


def test_zxy_pitch_is_nose_up_roll_lowers_the_right_and_heading_is_clockwise_from_north():
    """x right, y forward, z up; the world's x is east, y north."""
    small = 0.1
    assert rotate(from_euler(np.array([0, small, 0]), order="zxy"), Y) @ Z == pytest.approx(np.sin(small))
    assert rotate(from_euler(np.array([small, 0, 0]), order="zxy"), X) @ Z == pytest.approx(-np.sin(small))
    east = from_euler(np.array([0, 0, PI / 2]), order="zxy")
    np.testing.assert_allclose(rotate(east, Y), X, rtol=0, atol=1e-12)


@ORDERS
def test_a_level_board_reads_zero(order):
    np.testing.assert_array_equal(to_euler(np.array([1.0, 0.0, 0.0, 0.0]), order=order), [0.0, 0.0, 0.0])
    np.testing.assert_array_equal(from_euler(np.zeros(3), order=order), [1.0, 0.0, 0.0, 0.0])
