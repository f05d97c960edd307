"""Square roots of a covariance against the plain covariance: Joseph's form, and batch weighted least squares."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from quavelet.attitude.fusion_root import add_noise, diagonal_root, isolate, measure, potter, sigma, thawed

seeds = st.integers(0, 10**6)


def dense(rows) -> np.ndarray:
    """P = D D^T of a root, triangular or full."""
    d = np.zeros((len(rows), len(rows)))
    for i, row in enumerate(rows):
        d[i, : len(row)] = row
    return d @ d.T


def random_root(rng: np.random.Generator, n: int) -> list[list[float]]:
    """Sigmas from 1e-4 to 1, correlated."""
    d = np.tril(rng.normal(size=(n, n)) + 2 * np.eye(n)) * 10.0 ** rng.uniform(-4, 0, (n, 1))
    return [d[i, : i + 1].tolist() for i in range(n)]


def joseph(p: np.ndarray, h: np.ndarray, variance: float, forgetting: float = 1.0) -> tuple[np.ndarray, np.ndarray]:
    gain = p @ h / (h @ p @ h + forgetting * variance)
    rest = np.eye(len(p)) - np.outer(gain, h)
    return (rest @ p @ rest.T + forgetting * variance * np.outer(gain, gain)) / forgetting, gain


def assert_same(found: np.ndarray, expected: np.ndarray, tolerance: float = 1e-9) -> None:
    """Element by element, on the scale of the two states' sigmas."""
    scale = np.sqrt(np.diag(expected))
    assert np.abs(found - expected / 1.0)[np.outer(scale, scale) == 0].sum() == 0
    assert (np.abs(found - expected) <= tolerance * np.outer(scale, scale)).all()


@given(seed=seeds, n=st.integers(2, 8), data=st.data())
def test_carlson_leaves_the_triangle_that_joseph_leaves(seed, n, data):
    rng = np.random.default_rng(seed)
    rows, m = random_root(rng, n), data.draw(st.integers(0, n - 1))
    variance = 10.0 ** rng.uniform(-8, 2)
    expected, gain = joseph(dense(rows), np.eye(n)[m], variance)
    found = measure(rows, m, variance)
    assert [len(row) for row in rows] == list(range(1, n + 1))
    assert_same(dense(rows), expected, 1e-9)
    assert np.allclose(found, gain, rtol=1e-9, atol=1e-12)


def test_potter_stays_with_joseph_over_thousands_of_updates(capsys):
    """With forgetting, on the first scalar of a step of two."""
    rng, n = np.random.default_rng(8), 4
    rows = [row + [0.0] * (n - len(row)) for row in random_root(rng, n)]
    p = dense(rows)
    worst = 0.0
    for _ in range(4000):
        for forgetting in (0.98, 1.0):
            h, variance = rng.normal(size=n), 0.3
            p, gain = joseph(p, h, variance, forgetting)
            found = potter(rows, h.tolist(), variance, forgetting)
            worst = max(worst, np.abs(found - gain).max() / np.abs(gain).max())
        worst = max(worst, np.abs(dense(rows) - p).max() / np.abs(p).max())
    with capsys.disabled():
        print(f"\nPotter against Joseph, 8000 updates: {worst:.1e} relative")
    assert worst < 1e-9


@given(seed=seeds, forgetting=st.floats(0.9, 1.0))
def test_recursive_least_squares_is_batch_least_squares_with_fading_weights(seed, forgetting):
    """x and P after N steps are those of one solution with weights lambda^(N-i) and the start's prior so faded."""
    rng = np.random.default_rng(seed)
    n, steps = 3, 60
    h, z, variance = rng.normal(size=(steps, n)), rng.normal(size=steps), 0.25
    rows, x = [[2.0, 0.0, 0.0], [0.0, 2.0, 0.0], [0.0, 0.0, 2.0]], np.zeros(n)
    for row, value in zip(h, z, strict=True):
        left = value - row @ x
        x = x + left * np.array(potter(rows, row.tolist(), variance, forgetting))
    weights = forgetting ** np.arange(steps - 1, -1, -1) / variance
    information = h.T @ (weights[:, None] * h) + forgetting**steps * np.eye(n) / 4.0
    assert np.abs(x - np.linalg.solve(information, h.T @ (weights * z))).max() < 1e-9
    assert np.abs(dense(rows) - np.linalg.inv(information)).max() < 1e-9


@given(seed=seeds, n=st.integers(1, 8), data=st.data())
def test_noise_is_added_to_its_state_alone(seed, n, data):
    rng = np.random.default_rng(seed)
    rows, i = random_root(rng, n), data.draw(st.integers(0, n - 1))
    sd = 10.0 ** rng.uniform(-4, 1)
    expected = dense(rows) + np.diag(sd**2 * np.eye(n)[i])
    add_noise(rows, i, sd)
    assert_same(dense(rows), expected)


def test_noise_on_a_state_without_any_doubt_divides_by_nothing():
    rows = thawed(diagonal_root([0.0, 0.0, 0.0]))
    add_noise(rows, 0, 0.0)
    add_noise(rows, 1, 0.5)
    assert np.array_equal(dense(rows), np.diag([0.0, 0.25, 0.0]))


@given(seed=seeds, n=st.integers(2, 8), data=st.data())
def test_an_isolated_state_goes_with_no_other_and_the_others_keep_their_sigmas(seed, n, data):
    rows, i = random_root(np.random.default_rng(seed), n), data.draw(st.integers(0, n - 1))
    before = dense(rows)
    isolate(rows, i, 0.7)
    after = dense(rows)
    assert after[i, i] == pytest.approx(0.49)
    others = np.arange(n) != i
    assert (after[i, others] == 0.0).all()
    assert np.allclose(np.diag(after)[others], np.diag(before)[others], rtol=1e-12)
    assert np.allclose(after[:i, others], before[:i, others], rtol=1e-12)


def test_single_precision_is_where_the_plain_form_fails_and_the_root_cannot():
    """A near-singular case: (I - K h^T) P in float32 goes indefinite; a root squared never is."""
    p = np.diag([1.0, 1.0]).astype(np.float32)
    rows = thawed(diagonal_root([1.0, 1.0]))
    rows[0].append(0.0)
    h, variance = np.array([1.0, 1.0 + 1e-4], dtype=np.float32), np.float32(1e-8)
    for _ in range(50):
        gain = p @ h / (h @ p @ h + variance)
        p = (p - np.outer(gain, h @ p)).astype(np.float32)
        potter(rows, h.tolist(), float(variance))
    assert np.linalg.eigvalsh(p.astype(float)).min() < 0.0
    assert np.linalg.eigvalsh(dense(rows)).min() > 0.0
    assert sigma(rows[0]) > 0.0
