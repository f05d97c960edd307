"""Median, Hampel and line smoother: scipy and batch least squares as oracles."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import ndimage

from quavelet.core.units import RAD_PER_DEG
from quavelet.denoise.hampel import GYRO_FLOOR_RAD_S, hampel_filter
from quavelet.denoise.median import MedianFilter, median_filter
from quavelet.denoise.smoother import LineSmoother, noise_gain, smooth

odd = st.integers(0, 20).map(lambda h: 2 * h + 1)
signals = st.lists(st.floats(-1e3, 1e3), min_size=1, max_size=120).map(np.array)


@settings(deadline=None)
@given(x=signals, window=odd)
def test_the_median_is_scipys_also_at_the_ends_and_where_the_window_is_longer_than_the_signal(x, window):
    assert np.array_equal(median_filter(x, window), ndimage.median_filter(x, window, mode="nearest"))


@given(x=st.lists(st.sampled_from([0.0, -0.0, 1.0, -1.0]), min_size=1, max_size=60), window=odd)
def test_the_streaming_median_is_the_centred_one_later_to_the_bit(x, window):
    """Acceptance 5b; with both zeros, whose order in a sorted window must not depend on the way there."""
    column = np.array(x)[:, None]
    stream, got = MedianFilter(window), []
    for k in range(len(x)):
        saved, stream = stream.state(), MedianFilter(window)
        stream.restore(saved)
        got.append(stream.push(column[k : k + 1]))
    got = np.concatenate(got)
    offline = median_filter(column, window)
    late = window // 2
    assert got[late:].tobytes() == offline[: max(0, len(x) - late)].tobytes()


def test_half_a_window_of_impulses_leaves_no_trace_and_one_more_does():
    x = np.zeros(60)
    x[20:26] = 1e3
    assert not median_filter(x, 13).any()
    x[26] = 1e3
    assert median_filter(x, 13).any()


def hampel_by_hand(x, window, sigmas, floor):
    half, out = window // 2, x.copy()
    padded = np.pad(x, half, mode="edge")
    for k in range(len(x)):
        around = padded[k : k + window]
        median = np.median(around)
        spread = max(1.4826 * np.median(np.abs(around - median)), floor)
        if abs(x[k] - median) > sigmas * spread:
            out[k] = median
    return out


@settings(deadline=None)
@given(x=signals, window=odd, sigmas=st.floats(0.5, 6.0), floor=st.floats(0.0, 10.0))
def test_the_hampel_filter_is_the_one_written_out(x, window, sigmas, floor):
    assert np.array_equal(
        hampel_filter(x, window, sigmas=sigmas, floor=floor), hampel_by_hand(x, window, sigmas, floor)
    )


def test_spikes_of_the_gyroscope_go_and_its_noise_stays():
    """Paper 003's setting: 0.2 % spikes of 8 deg/s in 0.035 deg/s of noise."""
    rng = np.random.default_rng(20190910)
    clean = rng.normal(size=(12000, 3)) * 0.0354 * RAD_PER_DEG
    spikes = np.where(rng.random(clean.shape) < 0.002, rng.normal(size=clean.shape) * 8.0 * RAD_PER_DEG, 0.0)
    out = hampel_filter(clean + spikes, 5, sigmas=4.0, floor=GYRO_FLOOR_RAD_S)
    assert out.std() < 1.02 * clean.std()
    assert np.mean(out == clean) > 0.99


def test_a_spread_of_nothing_does_not_make_the_last_bit_a_spike():
    x = np.zeros(50)
    x[20] = 0.1 * RAD_PER_DEG
    assert np.array_equal(hampel_filter(x, 5, floor=GYRO_FLOOR_RAD_S), x)
    assert not hampel_filter(x, 5).any()


@settings(deadline=None)
@given(x=signals, forgetting=st.floats(0.05, 0.97))
def test_the_recursive_line_is_the_batch_weighted_least_squares_line(x, forgetting):
    """Paper 003, equations 2 to 4: x = (H'WH)^-1 H'Wz with W = diag(lambda^(m-i)), from the second row on."""
    got = smooth(x, forgetting=forgetting)
    assert got[0] == x[0]
    for m in {2, 3, 10, len(x)} - {n for n in (2, 3, 10) if n > len(x)} - {1}:
        age = np.arange(m)[::-1]
        root = np.sqrt(forgetting**age)
        h = np.column_stack([np.ones(m), -age])
        line, *_ = np.linalg.lstsq(root[:, None] * h, root * x[:m], rcond=None)
        assert got[m - 1] == pytest.approx(line[0], abs=1e-6 * (1.0 + np.abs(x).max()))


@pytest.mark.parametrize(("forgetting", "gain"), [(0.6, 0.716), (0.8, 0.514)])
def test_noise_gain_of_the_line_smoother(forgetting, gain):
    """Acceptance 3b."""
    x = np.random.default_rng(1).normal(size=40000)
    assert smooth(x, forgetting=forgetting)[100:].std() == pytest.approx(gain, abs=0.03)
    assert noise_gain(forgetting) == pytest.approx(gain, abs=0.03)
    assert smooth(x, forgetting=forgetting)[100:].std() == pytest.approx(noise_gain(forgetting), rel=0.02)


@given(start=st.floats(-10.0, 10.0), slope=st.floats(-10.0, 10.0), forgetting=st.floats(0.1, 0.95))
def test_a_ramp_comes_out_without_lag(start, slope, forgetting):
    ramp = start + slope * np.arange(200)
    assert np.allclose(smooth(ramp, forgetting=forgetting), ramp, atol=1e-6)


def test_the_gains_settle_at_the_double_exponential_ones():
    smoother = LineSmoother(0.8)
    smoother.push(np.zeros((500, 1)))
    level, slope = smoother._next_gains()
    assert level == pytest.approx(1 - 0.8**2, abs=1e-12)
    assert slope == pytest.approx((1 - 0.8) ** 2, abs=1e-12)


@pytest.mark.parametrize("window", [0, 4, -3])
def test_a_window_without_a_middle_is_refused(window):
    for make in (median_filter, hampel_filter):
        with pytest.raises(ValueError, match="odd number"):
            make(np.zeros(9), window)


@pytest.mark.parametrize("make", [lambda x: median_filter(x, 3), lambda x: hampel_filter(x, 3), smooth])
def test_bad_rows_are_named_and_one_row_is_enough(make):
    with pytest.raises(ValueError, match="row 1 is not finite"):
        make(np.array([0.0, np.nan, 1.0]))
    with pytest.raises(ValueError, match="shape"):
        make(np.zeros((0, 3)))
    assert make(np.array([4.0])).tolist() == [4.0]
    assert make(np.full((20, 2), 3.0)).tolist() == np.full((20, 2), 3.0).tolist()


@pytest.mark.parametrize("forgetting", [0.0, 1.0, float("nan"), -0.5])
def test_forgetting_outside_of_its_range_is_refused(forgetting):
    with pytest.raises(ValueError, match="between 0 and 1"):
        smooth(np.zeros(3), forgetting=forgetting)
    with pytest.raises(ValueError, match="positive"):
        hampel_filter(np.zeros(3), 3, sigmas=0.0)
