"""Paper 002's rows are in their bands, and the simulated earth turns as the earth does."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from paper_rows import assert_sound

from quavelet.core.quaternion import conjugate, from_rotation_vector, multiply, rotate
from quavelet.study.experiment import Effort, Result, silent
from quavelet.study.paper002 import EXPERIMENT, circle_centre
from quavelet.study.paper002_simulation import BOARD, SWINGING


@pytest.fixture(scope="module")
def quick() -> Result:
    return EXPERIMENT.run(Effort.QUICK, silent)


def test_the_quick_form_is_within_its_bands(quick):
    assert_sound(quick, ids={"2a", "2b", "2c", "2f", "6"})


@pytest.mark.slow
def test_the_full_form_is_within_its_bands():
    result = EXPERIMENT.run(Effort.FULL, silent)
    assert_sound(result, ids={"2a", "2b", "2c", "2d", "2e", "2f", "6"})
    exact = {row.what: row.got for row in result.rows if "swinging 900 s, constant errors" in row.what}
    assert list(exact.values()) == pytest.approx([0.0026, -0.0025, 0.2924], abs=1e-4)


def test_the_line_to_the_circles_centre_is_no_axis_in_the_south(quick):
    printed = {row.what.split(", ")[3]: row.got for row in quick.rows if "as printed" in row.what}
    assert printed["latitude 60 deg"] < 0.001
    assert printed["latitude -32 deg"] == pytest.approx(180.0, abs=0.001)


def test_the_centre_is_as_far_from_all_three_points():
    points = np.random.default_rng(4).standard_normal((3, 5, 3))
    centre = circle_centre(*points)
    radii = np.linalg.norm(points - centre, axis=-1)
    assert radii == pytest.approx(np.broadcast_to(radii[0], radii.shape), rel=1e-9)
    normal = np.cross(points[1] - points[0], points[2] - points[0])
    assert ((centre - points[0]) * normal).sum(axis=-1) == pytest.approx(0.0, abs=1e-9)


def test_the_board_turns_with_the_earth_and_swings_on_it():
    """The rates, integrated one by one, end at the earth's turn times the attitude."""
    board = replace(SWINGING, rate_hz=50.0)
    gyro, accel = board.truth(3.0)
    q = board.attitude(np.array([0.0]))[0]
    for rate in gyro:
        q = multiply(q, from_rotation_vector(rate / board.rate_hz))
    at_end = board.attitude(np.array([3.0]))[0]
    true = multiply(from_rotation_vector(3.0 * board.earth_rate()), at_end)
    assert np.abs(multiply(conjugate(true), q)[1:]).max() < 1e-12
    assert rotate(at_end, accel[-1]) == pytest.approx([0.0, 0.0, 9.80665], abs=1e-12)


def test_a_board_at_rest_sees_the_earths_rate_alone():
    gyro, _ = BOARD.truth(0.1)
    assert gyro == pytest.approx(np.tile(BOARD.earth_rate(), (20, 1)), abs=1e-15)
