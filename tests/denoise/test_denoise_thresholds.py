"""Thresholds against brute force and against what they promise on noise."""

from __future__ import annotations

from math import log

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from quavelet.denoise.shrink import soft
from quavelet.denoise.thresholds import heursure, level_scaled, mad_sigma, sure, threshold, universal

details = st.lists(st.floats(-50.0, 50.0), min_size=1, max_size=60).map(np.array)


def stein(d, t, sigma):
    """Stein's unbiased risk of soft thresholding a vector at t, from its definition."""
    y = d / sigma
    return len(y) + np.sum(np.minimum(np.abs(y), t / sigma) ** 2) - 2 * np.sum(np.abs(y) <= t / sigma)


@given(d=details, sigma=st.floats(0.1, 10.0))
def test_sure_is_the_least_risk_of_all_thresholds_tried_one_by_one(d, sigma):
    best = min(stein(d, t, sigma) for t in np.abs(d))
    # A hair above: the |d| it is made of must count as within it.
    assert stein(d, sure(d, sigma=sigma) * (1 + 1e-12), sigma) == pytest.approx(best, abs=1e-6)


def test_steins_risk_is_the_error_that_is_really_made():
    rng = np.random.default_rng(3)
    truth = np.where(rng.random(4000) < 0.1, 5.0, 0.0)
    d = truth + rng.normal(size=truth.size)
    chosen = sure(d, sigma=1.0)
    error = {t: np.mean((soft(d, t) - truth) ** 2) for t in (chosen, *np.linspace(0.05, 4.0, 80))}
    assert error[chosen] < 1.03 * min(error.values())


def test_heursure_is_universal_on_noise_and_not_above_it_on_signal():
    rng = np.random.default_rng(4)
    noise = rng.normal(size=1000)
    flat = universal(1.0, n=1000)
    assert heursure(noise, sigma=1.0) == flat
    busy = noise + np.where(rng.random(1000) < 0.3, 8.0, 0.0)
    assert heursure(busy, sigma=1.0) == min(flat, sure(busy, sigma=1.0)) < flat


def test_heursure_does_not_wipe_out_a_level_that_is_all_signal():
    """Where all |d| are alike, Stein's risk is least at a threshold that leaves none of them."""
    d = 100.0 * np.where(np.arange(64) % 2, 1.0, -1.0)
    assert sure(d, sigma=1.0) == 100.0
    assert heursure(d, sigma=1.0) == universal(1.0, n=64)


def test_noise_hardly_ever_exceeds_the_universal_threshold():
    rng = np.random.default_rng(5)
    exceeded = np.abs(rng.normal(size=(200, 4096))).max(axis=1) > universal(1.0, n=4096)
    assert 0.02 < exceeded.mean() < 0.25


def test_paper_001_scales_by_the_level():
    t = [level_scaled(2.0, n=3000, level=j) / universal(2.0, n=3000) for j in (1, 2, 3, 4)]
    assert t == pytest.approx([1 / log(2), 1 / log(3), 1 / log(4), 1 / log(5)])
    assert t[0] == pytest.approx(1.44, abs=0.005)
    assert t[3] == pytest.approx(0.62, abs=0.005)


def test_the_median_deviation_is_sigma_and_does_not_see_outliers():
    d = np.random.default_rng(6).normal(scale=3.0, size=(20000, 2))
    d[::50] *= 1000.0
    assert mad_sigma(d) == pytest.approx([3.0, 3.0], rel=0.06)
    assert mad_sigma(d[:, 0]) == pytest.approx(3.0, rel=0.06)


@pytest.mark.parametrize("rule", ["universal", "level_scaled", "sure", "heursure"])
def test_a_signal_without_noise_has_no_threshold(rule):
    assert threshold(np.zeros(8), rule=rule, sigma=0.0, n=16, level=1) == 0.0
    assert threshold(np.zeros(0), rule=rule, sigma=0.0, n=0, level=1) == 0.0


def test_an_unknown_rule_is_refused():
    with pytest.raises(ValueError, match="'minimax' is not known"):
        threshold(np.zeros(8), rule="minimax", sigma=1.0, n=16, level=1)
