"""Signs and frames of what ships and aircraft are told: a sign that is wrong steers them the wrong way."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from sink_messages import message, quaternions, rates

from quavelet.core.euler import from_euler, to_euler
from quavelet.core.quaternion import from_rotation_vector, multiply, rotate, to_matrix
from quavelet.sinks.encodings.ship_axes import ShipAttitude, ship_attitude, ship_quaternion
from quavelet.sinks.message import Message

RAD = np.pi / 180
ENU_TO_NED = np.array([[0, 1, 0], [1, 0, 0], [0, 0, -1.0]])
FRD_TO_FLU = np.diag([1.0, -1.0, -1.0])


def ship(of: Message) -> ShipAttitude:
    found = ship_attitude(of)
    assert found is not None
    return found


def board(*, roll_deg: float = 0.0, pitch_deg: float = 0.0, yaw_deg: float = 0.0) -> list[float]:
    q: list[float] = from_euler(np.array([roll_deg, pitch_deg, yaw_deg]) * RAD).tolist()
    return q


@given(quaternions)
def test_the_angles_are_those_of_the_bow_and_the_starboard_side_as_they_lie_in_the_world(q):
    told = message(q, yaw="true", sigma_deg=(0, 0, 0))
    bow, port, up = to_matrix(np.array(told.q)).T
    found = ship(told)
    assert np.sin(found.pitch_deg * RAD) == pytest.approx(bow[2], abs=1e-9)  # up
    level = np.hypot(bow[0], bow[1])
    # Near the vertical only the sum of roll and heading is known; the angles' sines carry the rounding.
    if level > 1e-4:
        assert found.heading_deg is not None
        assert np.sin(found.heading_deg * RAD) == pytest.approx(bow[0] / level, abs=1e-6)  # east
        assert np.cos(found.heading_deg * RAD) == pytest.approx(bow[1] / level, abs=1e-6)  # north
        assert np.sin(found.roll_deg * RAD) == pytest.approx(port[2] / level, abs=1e-6)  # port up: starboard down
        assert np.cos(found.roll_deg * RAD) == pytest.approx(up[2] / level, abs=1e-6)


@given(quaternions)
def test_the_quaternion_turns_forward_starboard_down_into_north_east_down(q):
    told = message(q, yaw="magnetic")
    expected = ENU_TO_NED @ to_matrix(np.array(told.q)) @ FRD_TO_FLU
    assert np.allclose(to_matrix(np.array(ship_quaternion(told))), expected, atol=1e-9)
    assert ship_quaternion(told)[0] >= 0.0


@given(quaternions)
def test_quaternion_and_angles_of_a_relative_yaw_are_of_the_same_level_frame(q):
    told = message(q)
    found = ship(told)
    angles = np.array([found.roll_deg, found.pitch_deg, found.yaw_deg]) * RAD
    of_angles, given_q = from_euler(angles), np.array(ship_quaternion(told))
    assert abs(float(of_angles @ given_q)) == pytest.approx(1.0, abs=1e-9)


@given(quaternions, rates)
def test_the_rate_of_turn_is_about_the_vertical_and_to_starboard(q, rate):
    told = message(q, gyro_rad_s=rate)
    in_world = rotate(np.array(told.q), np.array(rate))
    assert ship(told).turn_rad_s == pytest.approx(-in_world[2], abs=1e-9)


def test_a_bow_that_swings_to_starboard_has_a_growing_heading_and_a_positive_rate():
    before, swing = np.array(board(yaw_deg=20.0)), np.array([0.0, 0.0, -0.1])
    after = multiply(before, from_rotation_vector(0.1 * swing))
    first, second = ship(message(before, yaw="true", gyro_rad_s=swing)), ship(message(after, yaw="true"))
    assert first.heading_deg == pytest.approx(70.0)
    assert second.heading_deg is not None and second.heading_deg > 70.0
    assert first.turn_rad_s == pytest.approx((second.heading_deg - 70.0) * RAD / 0.1, rel=1e-6)
    assert first.rate_rad_s == pytest.approx((0.0, 0.0, 0.1))


@given(quaternions)
def test_sigma_is_what_small_turns_about_the_worlds_axes_do_to_the_angles(q):
    sigma = np.array([0.3, 0.2, 0.5])
    told = message(q, yaw="true", sigma_deg=sigma)
    if abs(told.pitch_deg) > 80.0:
        return
    h = 1e-5
    effect = np.zeros((3, 3))
    for axis in range(3):
        for sign in (1, -1):
            turn = from_rotation_vector(sign * h * np.eye(3)[axis])
            effect[:, axis] += sign * to_euler(multiply(turn, np.array(told.q)))
    # An angle may cross +-180 degrees between the two.
    effect = np.where(np.abs(effect) > np.pi, effect - 2 * np.pi * np.sign(effect), effect) / (2 * h)
    assert ship(told).sigma_deg == pytest.approx(np.linalg.norm(effect * sigma, axis=1), rel=1e-3)


def test_a_heading_that_nothing_gives_is_none():
    assert ship(message()).heading_deg is None
    assert ship(message(yaw="true")).heading_deg == pytest.approx(90.0)
    for flag in ("settling", "stuck", "field_lost", "field_disturbed", "heading_suspect"):
        assert ship(message(yaw="true", flags=[flag])).heading_deg is None


def test_a_board_on_its_stern_has_no_heading():
    assert ship(message(board(pitch_deg=-89.9), yaw="true")).heading_deg is None
    assert ship(message(yaw="true", sigma_deg=(0.5, 0.5, 40.0))).heading_deg is None
    assert ship(message(board(pitch_deg=-90.0), yaw="true")).sigma_deg == pytest.approx((180.0, 0.5, 180.0))
