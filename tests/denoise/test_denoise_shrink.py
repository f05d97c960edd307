"""What a coefficient becomes at a threshold, against PyWavelets and as properties (paper 001, step 4)."""

from __future__ import annotations

import numpy as np
import pytest
import pywt
from hypothesis import given
from hypothesis import strategies as st

from quavelet.denoise.shrink import hard, improved, power, shrink, sigmoid, soft

BETWEEN = ("improved", "sigmoid", "power")
KINDS = ("hard", "soft", *BETWEEN)
coefficients = st.lists(st.integers(-(10**9), 10**9).map(lambda n: n / 1e3), min_size=1, max_size=40).map(np.array)
thresholds = st.floats(1e-6, 1e5)
ks = st.floats(1.0, 50.0)
alphas = st.floats(0.2, 5.0)


def close(a, b, t):
    assert np.allclose(a, b, rtol=1e-12, atol=1e-5 * t)


@given(w=coefficients, t=thresholds)
def test_hard_and_soft_are_those_of_pywavelets(w, t):
    assert np.array_equal(hard(w, t), pywt.threshold(w, t, "hard"))
    assert np.allclose(soft(w, t), pywt.threshold(w, t, "soft"), rtol=1e-12, atol=1e-12 * t)


@pytest.mark.parametrize("kind", BETWEEN)
@given(w=coefficients, t=thresholds, k=ks, alpha=alphas)
def test_an_improved_function_lies_between_soft_and_hard_and_is_odd(kind, w, t, k, alpha):
    out = shrink(w, t, kind=kind, k=k, alpha=alpha)
    slack = 1e-9 * (np.abs(w) + t)
    assert (np.abs(soft(w, t)) <= np.abs(out) + slack).all()
    assert (np.abs(out) <= np.abs(hard(w, t)) + slack).all()
    assert np.array_equal(shrink(-w, t, kind=kind, k=k, alpha=alpha), -out)


@pytest.mark.parametrize("kind", ("soft", *BETWEEN))
@given(t=thresholds, k=ks, alpha=alphas)
def test_it_is_zero_at_the_threshold_and_below(kind, t, k, alpha):
    w = np.array([t, -t, 0.5 * t, 0.0])
    assert not shrink(w, t, kind=kind, k=k, alpha=alpha).any()


@pytest.mark.parametrize("kind", BETWEEN)
@given(w=coefficients, t=thresholds, alpha=alphas)
def test_a_huge_k_is_hard(kind, w, t, alpha):
    # Hard jumps at the threshold, the others only climb steeply there.
    w = w[np.abs(np.abs(w) - t) > 0.05 * t]
    limit = 1e6 if alpha <= 1.0 or kind == "power" else 1e6 * 20.0**alpha
    close(shrink(w, t, kind=kind, k=limit, alpha=alpha), hard(w, t), t)


@given(w=coefficients, t=thresholds)
def test_the_smallest_k_is_soft(w, t):
    assert np.allclose(improved(w, t, k=1e-12), soft(w, t), rtol=1e-5, atol=1e-5 * t)
    assert np.allclose(sigmoid(w, t, k=1e-12), soft(w, t), rtol=1e-5, atol=1e-5 * t)
    close(power(w, t, k=1.0), soft(w, t), t)


def test_k_of_a_millionth_is_soft_near_the_threshold():
    w, t = np.linspace(-10.0, 10.0, 401), 1.0
    assert np.allclose(improved(w, t, k=1e-6), soft(w, t), atol=1e-5)
    assert np.allclose(sigmoid(w, t, k=1e-6), soft(w, t), atol=1e-5)


@pytest.mark.parametrize("kind", KINDS)
@given(w=coefficients, t=thresholds, unit=st.floats(1e-3, 1e3))
def test_the_unit_does_not_matter(kind, w, t, unit):
    """The same in rad/s and deg/s: the un-normalised exp(-k(|w|-T)) of some papers is not."""
    w = w[np.abs(np.abs(w) - t) > 1e-9 * t]
    assert np.allclose(shrink(w * unit, t * unit, kind=kind), shrink(w, t, kind=kind) * unit, rtol=1e-6)


@pytest.mark.parametrize("kind", KINDS)
def test_no_threshold_leaves_all_and_an_infinite_one_nothing(kind):
    w = np.array([-3.0, -1e-300, 0.0, 2.0])
    assert np.array_equal(shrink(w, 0.0, kind=kind), w)
    assert np.allclose(shrink(w, 1e-310, kind=kind), w)
    assert not shrink(w, 1e300, kind=kind).any()


@pytest.mark.parametrize("kind", KINDS)
def test_thresholds_of_each_column_are_each_column_s_own(kind):
    w = np.random.default_rng(1).normal(size=(50, 3))
    t = np.array([0.5, 0.0, 2.0])
    columns = [shrink(w[:, i].copy(), float(t[i]), kind=kind) for i in range(3)]
    assert np.array_equal(shrink(w, t, kind=kind), np.column_stack(columns))


@pytest.mark.parametrize(
    ("wrong", "says"),
    [({"kind": "garrote"}, "not known"), ({"kind": "improved", "k": 0.0}, "positive"),
     ({"kind": "sigmoid", "alpha": float("nan")}, "positive"), ({"kind": "power", "k": 0.5}, "1 ")],
)  # fmt: skip
def test_a_function_that_cannot_be_is_refused(wrong, says):
    with pytest.raises(ValueError, match=says):
        shrink(np.ones(3), 1.0, **wrong)
