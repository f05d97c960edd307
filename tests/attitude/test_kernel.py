"""The scalar kernel against literal Runge-Kutta, and against scipy's rotations."""

from __future__ import annotations

from math import cos, pi, radians, sin

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from quavelet.attitude import kernel

rates = st.tuples(*[st.floats(-35.0, 35.0)] * 3)
forces = st.tuples(*[st.floats(-20.0, 20.0)] * 3).filter(lambda f: sum(x * x for x in f) > 1e-2)
quaternions = (
    st.tuples(*[st.floats(-1.0, 1.0)] * 4).filter(lambda q: sum(x * x for x in q) > 1e-2).map(kernel.normalised)
)
periods = st.floats(1e-4, 0.02)


def scipy_of(q: kernel.Quaternion) -> Rotation:
    w, x, y, z = q
    return Rotation.from_quat([x, y, z, w])


def literal_runge_kutta(q: kernel.Quaternion, rate: kernel.Vector, dt: float, order: int) -> np.ndarray:
    """The textbook stages of q' = q (x) [0, rate] / 2, for a rate held over the step."""

    def slope(p: np.ndarray) -> np.ndarray:
        return 0.5 * np.array(kernel.product(tuple(p), (0.0, *rate)))

    p = np.array(q)
    k1 = slope(p)
    if order == 1:
        end = p + dt * k1
    elif order == 2:
        end = p + dt * slope(p + 0.5 * dt * k1)
    else:
        k2 = slope(p + 0.5 * dt * k1)
        k3 = slope(p + 0.5 * dt * k2)
        k4 = slope(p + dt * k3)
        end = p + dt / 6.0 * (k1 + 2 * k2 + 2 * k3 + k4)
    return end / np.linalg.norm(end)


@pytest.mark.parametrize(("method", "order"), [("rk1", 1), ("rk2", 2), ("rk4", 4)])
@given(q=quaternions, rate=rates, dt=periods)
def test_the_closed_form_is_the_literal_runge_kutta_step(method, order, q, rate, dt):
    closed = np.array(kernel.step(q, rate, dt, method))
    assert np.abs(closed - literal_runge_kutta(q, rate, dt, order)).max() < 1e-15


@given(q=quaternions, rate=rates, dt=periods)
def test_the_exponential_is_the_exact_rotation(q, rate, dt):
    exact = scipy_of(q) * Rotation.from_rotvec(np.array(rate) * dt)
    assert (scipy_of(kernel.step(q, rate, dt, "exp")).inv() * exact).magnitude() < 1e-12


@pytest.mark.parametrize(
    ("method", "least_deg", "most_deg"), [("rk1", 0.15, 0.25), ("rk4", 0.0, 1e-4), ("exp", 0.0, 1e-8)]
)
def test_ten_seconds_at_200_deg_s_cost_what_the_order_promises(method, least_deg, most_deg, capsys):
    axis = np.array([1.0, -2.0, 0.5]) / np.linalg.norm([1.0, -2.0, 0.5])
    rate = tuple(radians(200.0) * axis)
    q = kernel.IDENTITY
    for _ in range(1000):
        q = kernel.step(q, rate, 0.01, method)
    half = radians(2000.0) / 2
    exact = (cos(half), *(sin(half) * axis))
    error = kernel.product(tuple(np.array(exact) * [1, -1, -1, -1]), q)
    error_deg = 2 * np.degrees(np.arctan2(np.linalg.norm(error[1:]), abs(error[0])))
    with capsys.disabled():
        print(f"\n{method}: {error_deg:.3g} deg after 10 s at 200 deg/s, 100 Hz")
    assert least_deg <= error_deg < most_deg


@given(q=quaternions, p=quaternions)
def test_the_product_composes_rotations_in_the_same_order_as_scipy(q, p):
    assert (scipy_of(kernel.product(p, q)).inv() * (scipy_of(p) * scipy_of(q))).magnitude() < 1e-12


@given(q=quaternions)
def test_up_in_the_body_is_the_vertical_turned_back(q):
    assert np.allclose(kernel.up_in_body(q), scipy_of(q).inv().apply([0.0, 0.0, 1.0]), atol=1e-12)


@given(force=forces)
def test_a_standing_board_has_gravity_up_and_yaw_zero(force):
    attitude = scipy_of(kernel.standing(force))
    assert np.allclose(attitude.apply(force), [0.0, 0.0, np.linalg.norm(force)], atol=1e-9)
    # The body's x axis stays in the world's x-z plane, on the +x side: that is yaw zero.
    x_axis = attitude.apply([1.0, 0.0, 0.0])
    assert abs(x_axis[1]) < 1e-9
    assert x_axis[0] > -1e-9


@given(q=quaternions, force=forces)
def test_the_tilt_error_turns_the_wrong_up_towards_the_measured_one(q, force):
    error = np.array(kernel.tilt_error(q, force))
    up, measured = np.array(kernel.up_in_body(q)), np.array(force) / np.linalg.norm(force)
    assert abs(error @ up) < 1e-12  # nothing of it steers heading
    small = kernel.normalised(kernel.product(q, (1.0, *(1e-6 * error))))
    before, after = measured @ up, measured @ np.array(kernel.up_in_body(small))
    assert after >= before - 1e-15


def test_free_fall_gives_no_correction_and_no_division_by_zero():
    assert kernel.tilt_error(kernel.IDENTITY, (0.0, 0.0, 0.0)) == kernel.ZERO


@given(a=rates, v=forces)
def test_across_leaves_nothing_along_the_vector(a, v):
    unit = tuple(np.array(v) / np.linalg.norm(v))
    assert abs(np.dot(kernel.across(a, unit), unit)) < 1e-12


@given(a=rates, limit=st.floats(0.01, pi))
def test_clamped_stays_within_the_limit_and_leaves_the_rest_alone(a, limit):
    assert np.array_equal(kernel.clamped(a, limit), np.clip(a, -limit, limit))
