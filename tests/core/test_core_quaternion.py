"""Quaternions against scipy's rotations (scalar last there), and against what a hand can check."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from quavelet.core.quaternion import (
    angle_between,
    conjugate,
    from_matrix,
    from_rotation_vector,
    inclination_between,
    multiply,
    normalise,
    rotate,
    to_matrix,
)

ONE, I, J, K = np.eye(4)  # noqa: E741
UP = np.array([0.0, 0.0, 1.0])
EXACT = {"rtol": 0, "atol": 1e-12}


def vectors(size, most=1.0):
    return st.lists(st.floats(-most, most), min_size=size, max_size=size).map(np.array)


@st.composite
def units(draw):
    """Unit quaternions of both signs, half turns and tiny rotations among them."""
    q = draw(vectors(4))
    for k in draw(st.sets(st.integers(0, 3), max_size=2)):
        q[k] *= draw(st.sampled_from([0.0, 1e-9, 1e-5]))
    assume(np.linalg.norm(q) > 1e-2)
    return q / np.linalg.norm(q)


def scipy_of(q):
    return Rotation.from_quat(np.roll(q, -1, axis=-1))


def ours_of(rotation):
    return np.roll(rotation.as_quat(), 1, axis=-1)


def assert_same_rotation(p, q, atol=1e-12):
    """p and q, or p and -q."""
    assert min(np.abs(p - q).max(), np.abs(p + q).max()) < atol


def test_the_product_is_hamiltons():
    np.testing.assert_array_equal(multiply(I, J), K)
    np.testing.assert_array_equal(multiply(J, K), I)
    np.testing.assert_array_equal(multiply(K, I), J)
    for unit in (I, J, K):
        np.testing.assert_array_equal(multiply(unit, unit), -ONE)


def test_a_quarter_turn_about_up_takes_forward_to_the_left():
    q = from_rotation_vector(np.array([0.0, 0.0, np.pi / 2]))
    np.testing.assert_allclose(rotate(q, np.array([1.0, 0.0, 0.0])), [0.0, 1.0, 0.0], **EXACT)


@given(units(), units())
def test_a_product_is_one_rotation_after_the_other(p, q):
    assert_same_rotation(multiply(p, q), ours_of(scipy_of(p) * scipy_of(q)))


@given(units(), vectors(3, most=100.0))
def test_rotating_goes_from_body_to_world(q, v):
    np.testing.assert_allclose(rotate(q, v), scipy_of(q).apply(v), rtol=0, atol=1e-12 * (1 + np.abs(v).max()))
    np.testing.assert_allclose(rotate(conjugate(q), rotate(q, v)), v, rtol=0, atol=1e-12 * (1 + np.abs(v).max()))


@given(units())
def test_the_matrix_is_that_of_the_rotation(q):
    np.testing.assert_allclose(to_matrix(q), scipy_of(q).as_matrix(), **EXACT)


@given(units())
def test_a_matrix_gives_its_quaternion_back_at_half_turns_too(q):
    back = from_matrix(scipy_of(q).as_matrix())
    assert back[0] >= 0.0
    assert abs(np.linalg.norm(back) - 1.0) < 1e-12
    assert_same_rotation(back, q)


@given(vectors(3, most=7.0), st.sampled_from([1.0, 1e-3, 1e-8, 1e-12, 1e-200, 0.0]))
def test_a_rotation_vector_of_any_length_down_to_none_is_exact(r, factor):
    r = factor * r
    q = from_rotation_vector(r)
    assert abs(np.linalg.norm(q) - 1.0) < 1e-12
    assert_same_rotation(q, ours_of(Rotation.from_rotvec(r)))


@given(vectors(3), st.floats(1e-12, 1e-3))
def test_a_tiny_rotation_keeps_all_its_digits(direction, angle):
    assume(np.linalg.norm(direction) > 0.1)
    r = angle * direction / np.linalg.norm(direction)
    np.testing.assert_allclose(2 * from_rotation_vector(r)[1:], r, rtol=1e-6, atol=1e-15 * angle)
    assert angle_between(ONE, from_rotation_vector(r)) == pytest.approx(angle, rel=1e-12)


@given(units(), units())
def test_the_angle_between_two_attitudes_is_that_of_the_rotation_from_one_to_the_other(p, q):
    expected = (scipy_of(p).inv() * scipy_of(q)).magnitude()
    assert angle_between(p, q) == pytest.approx(expected, abs=1e-12)
    assert angle_between(q, p) == pytest.approx(expected, abs=1e-12)


@given(units())
def test_an_attitude_and_its_negative_are_the_same(q):
    assert angle_between(q, -q) < 1e-12
    assert inclination_between(q, -q) < 1e-12
    np.testing.assert_allclose(to_matrix(-q), to_matrix(q), **EXACT)


@given(units(), units())
def test_inclination_is_the_angle_by_which_the_vertical_is_missed(p, q):
    # The world's up seen by the body, once by each attitude.
    a, b = scipy_of(p).inv().apply(UP), scipy_of(q).inv().apply(UP)
    expected = np.arctan2(np.linalg.norm(np.cross(a, b)), a @ b)
    assert inclination_between(p, q) == pytest.approx(expected, abs=1e-12)


@given(units(), st.floats(-7.0, 7.0), st.floats(0.0, 3.0), st.floats(-4.0, 4.0))
def test_a_heading_error_is_no_inclination_and_adds_none(q, yaw, tilt, direction):
    turned = ours_of(Rotation.from_rotvec(yaw * UP) * scipy_of(q))
    assert inclination_between(q, turned) < 1e-12
    axis = np.array([np.cos(direction), np.sin(direction), 0.0])
    tipped = ours_of(Rotation.from_rotvec(tilt * axis) * scipy_of(turned))
    assert inclination_between(q, tipped) == pytest.approx(tilt, abs=1e-12)


@given(vectors(4, most=1e6))
def test_normalising_keeps_the_rotation_and_makes_the_scalar_not_negative(q):
    assume(np.linalg.norm(q) > 1e-6)
    unit = normalise(q)
    assert unit[0] >= 0.0
    assert abs(np.linalg.norm(unit) - 1.0) < 1e-12
    np.testing.assert_allclose(to_matrix(unit), scipy_of(q).as_matrix(), **EXACT)


def test_g1_random_attitudes_survive_the_matrix_and_the_matrix_is_orthogonal():
    q = normalise(np.random.default_rng(1).normal(size=(10_000, 4)))
    c = to_matrix(q)
    assert np.abs(c @ np.swapaxes(c, -1, -2) - np.eye(3)).max() < 1e-12
    assert np.abs(np.linalg.det(c) - 1.0).max() < 1e-12
    assert np.abs(from_matrix(c) - q).max() < 1e-12


def test_leading_axes_broadcast_and_give_what_single_calls_give():
    rng = np.random.default_rng(2)
    p, q, v = rng.normal(size=(5, 1, 4)), rng.normal(size=(3, 4)), rng.normal(size=(3, 3))
    p, q = normalise(p), normalise(q)
    for function, a, b, shape in [
        (multiply, p, q, (5, 3, 4)),
        (rotate, p, v, (5, 3, 3)),
        (angle_between, p, q, (5, 3)),
        (inclination_between, p, q, (5, 3)),
    ]:
        together = function(a, b)
        assert together.shape == shape
        for k in range(5):
            for m in range(3):
                np.testing.assert_allclose(together[k, m], function(a[k, 0], b[m]), **EXACT)
    for function, x in [(to_matrix, q), (from_matrix, to_matrix(q)), (from_rotation_vector, v), (normalise, 3 * q)]:
        together = function(x)
        for m in range(3):
            np.testing.assert_allclose(together[m], function(x[m]), **EXACT)
