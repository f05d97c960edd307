"""The error-state filter against dense matrices, against scipy's rotations, and against its own word: how far off it
says it is and how far off it is."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from scipy.stats import chi2

from quavelet.attitude.fusion_error import (
    HEADING,
    TILT_X,
    TILT_Y,
    VELOCITY_X,
    VELOCITY_Y,
    Estimate,
    Noise,
    corrected,
    first_root,
    forget,
    predicted,
)
from quavelet.attitude.fusion_root import frozen, thawed
from quavelet.attitude.kernel import normalised, step, up_in_body

G = 9.80665
seeds = st.integers(0, 10**6)
GRAVITY = Noise(
    gyro_rad_s_rthz=0.002, gyro_share_rthz=0.0, accel_m_s2_rthz=0.04, velocity_m_s_rthz=None, bias_rad_s_rts=1e-5
)
VELOCITY = Noise(
    gyro_rad_s_rthz=0.002, gyro_share_rthz=0.0, accel_m_s2_rthz=0.04, velocity_m_s_rthz=0.2, bias_rad_s_rts=1e-5
)


def dense(rows) -> np.ndarray:
    d = np.zeros((len(rows), len(rows)))
    for i, row in enumerate(rows):
        d[i, : len(row)] = row
    return d @ d.T


def scipy_of(q) -> Rotation:
    return Rotation.from_quat(np.roll(q, -1))


def random_estimate(rng: np.random.Generator, velocity: bool) -> Estimate:
    n = 8 if velocity else 6
    d = np.tril(rng.normal(size=(n, n)) + 2 * np.eye(n)) * 0.01
    return Estimate(
        q=normalised(tuple(rng.normal(size=4))),
        root=frozen([d[i, : i + 1].tolist() for i in range(n)]),
        bias_rad_s=tuple(rng.normal(0.0, 0.1, 3)),
    )


@given(seed=seeds, velocity=st.booleans())
def test_the_prediction_is_scipys_rotation_and_the_dense_covariance(seed, velocity):
    rng, dt = np.random.default_rng(seed), 0.01
    e, noise = random_estimate(rng, velocity), VELOCITY if velocity else GRAVITY
    rate, force = rng.normal(0.0, 5.0, 3), rng.normal(0.0, 8.0, 3)
    rows = thawed(e.root)
    after, up = predicted(e, tuple(rate), tuple(force), dt, noise, rows)
    exact = scipy_of(e.q) * Rotation.from_rotvec((rate - e.bias_rad_s) * dt)
    assert (scipy_of(after.q).inv() * exact).magnitude() < 1e-12
    assert np.allclose(up, exact.apply(force), atol=1e-12)
    n = len(rows)
    f = np.eye(n)
    f[np.ix_([TILT_X, TILT_Y, n - 1], [0, 1, 2])] = -dt * exact.as_matrix()
    q = np.diag([1e-10 * dt] * 3 + [0.5 * 0.002**2 * dt] * 2 + [0.5 * 0.04**2 * dt] * (n - 6) + [0.5 * 0.002**2 * dt])
    if velocity:
        # The velocity integrates the force seen with the tilt error the step began with.
        fall = np.eye(n)
        fall[VELOCITY_X, TILT_Y], fall[VELOCITY_Y, TILT_X] = dt * G, -dt * G
        f = f @ fall
        assert np.allclose(after.velocity_m_s, dt * np.array(up[:2]), atol=1e-15)
    assert np.allclose(dense(rows), f @ dense(e.root) @ f.T + q, rtol=1e-10, atol=1e-18)


@given(seed=seeds, velocity=st.booleans())
def test_the_correction_is_josephs_with_the_gain_of_heading_left_out(seed, velocity):
    """Schmidt's consider state: any gain gives P = (I - K H) P (I - K H)^T + K R K^T."""
    rng = np.random.default_rng(seed)
    e = random_estimate(rng, velocity)
    states = (VELOCITY_X, VELOCITY_Y) if velocity else (TILT_X, TILT_Y)
    residual, variance = tuple(rng.normal(0.0, 0.01, 2)), 1e-4
    p, x = dense(e.root), np.zeros(len(e.root))
    for m, value in zip(states, residual, strict=True):
        s = p[m, m] + variance
        gain = p[:, m] / s
        gain[HEADING] = 0.0
        x = x + gain * (value - x[m])
        rest = np.eye(len(p)) - np.outer(gain, np.eye(len(p))[m])
        p = rest @ p @ rest.T + variance * np.outer(gain, gain)
    rows = thawed(e.root)
    after = corrected(e, rows, states, residual, variance)
    assert np.allclose(dense(after.root), p, rtol=1e-9, atol=1e-18)
    assert np.allclose(np.array(after.bias_rad_s) - e.bias_rad_s, x[:3], atol=1e-12)
    turn = (scipy_of(after.q) * scipy_of(e.q).inv()).as_rotvec()
    assert np.allclose(turn, [x[TILT_X], x[TILT_Y], 0.0], atol=1e-12)


def test_forgetting_stops_where_nothing_is_observed():
    """A level board for twenty minutes: nothing sees the vertical bias, whose sigma must not grow without end."""
    e = Estimate((1.0, 0.0, 0.0, 0.0), first_root(0.02, 0.01, 0.0, None))
    for _ in range(12_000):
        rows = thawed(e.root)
        forget(rows, 0.9985**0.5, (0.02,) * 3 + (0.05,) * 2)
        e, _ = predicted(e, (0.0, 0.0, 0.0), (0.0, 0.0, G), 0.1, GRAVITY, rows)
        e = corrected(e, rows, (TILT_X, TILT_Y), (0.0, 0.0), 1e-5)
    p = dense(e.root)
    assert np.sqrt(p[2, 2]) == pytest.approx(0.02, rel=0.02)
    assert np.sqrt(p[0, 0]) < 0.002
    assert np.isfinite(p).all()


@pytest.mark.parametrize("velocity", [False, True], ids=["gravity", "velocity"])
def test_the_error_is_as_large_as_the_covariance_says(velocity, capsys):
    """Normalised estimation error squared of tilt and bias over many runs with noise as modelled: its mean is within
    the bounds of chance, and so is the share of tilt errors within one sigma."""
    rng, dt, n, runs = np.random.default_rng(31), 0.04, 700, 24
    noise = VELOCITY if velocity else GRAVITY
    states = (VELOCITY_X, VELOCITY_Y) if velocity else (TILT_X, TILT_Y)
    variance = 0.5 * 0.2**2 / dt if velocity else 0.5 * (0.04 / G) ** 2 / dt
    nees, within, heading = [], [], []
    for _ in range(runs):
        truth = tuple(np.roll(Rotation.from_rotvec(rng.normal(0.0, 0.4, 3)).as_quat(), 1))
        wrong = Rotation.from_rotvec([*rng.normal(0.0, 0.05, 2), 0.0]).inv() * scipy_of(truth)
        bias, speed = rng.normal(0.0, 0.02, 3), rng.normal(0.0, 0.5, 2)
        e = Estimate(tuple(np.roll(wrong.as_quat(), 1)), first_root(0.02, 0.05, 0.0, 0.5 if velocity else None))
        rates = 1.5 * np.sin(np.outer(np.arange(n) * dt, [0.9, 0.7, 0.4]) + rng.uniform(0.0, 6.28, 3))
        rate_noise = rng.normal(0.0, 0.002 * np.sqrt(0.5 / dt), (n, 3))
        force_noise = rng.normal(0.0, 0.04 * np.sqrt(0.5 / dt), (n, 3))
        speeds = speed + rng.normal(0.0, np.sqrt(variance), (n, 2))
        walk = bias + rng.normal(0.0, 1e-5 * np.sqrt(dt), (n, 3)).cumsum(axis=0)
        for k in range(n):
            truth = step(truth, tuple(rates[k]), dt, "exp")
            seen, force = rates[k] + walk[k] + rate_noise[k], G * np.array(up_in_body(truth)) + force_noise[k]
            rows = thawed(e.root)
            e, up = predicted(e, tuple(seen), tuple(force), dt, noise, rows)
            residual = speeds[k] - e.velocity_m_s if velocity else np.array([up[1], -up[0]]) / G
            e = corrected(e, rows, states, tuple(residual), variance)
        error = (scipy_of(truth) * scipy_of(e.q).inv()).as_rotvec()
        x = np.array([*(walk[-1] - e.bias_rad_s), *error[:2]])
        nees.append(x @ np.linalg.solve(dense(e.root)[:5, :5], x))
        within.extend(np.abs(error[:2]) < e.tilt_sigma_rad())
        heading.append(error[2] / e.heading_sigma_rad())
    low, high = chi2.ppf([0.001, 0.999], 5 * runs) / runs
    with capsys.disabled():
        print(f"\nNEES {np.mean(nees):.2f} of 5 ({low:.2f} to {high:.2f})")
        print(f"tilt within one sigma {np.mean(within):.0%}, heading's error {np.std(heading):.2f} sigma")
    assert low < np.mean(nees) < high
    assert 0.55 < np.mean(within) < 0.81
    assert 0.7 < np.sqrt(np.mean(np.square(heading))) < 1.35
