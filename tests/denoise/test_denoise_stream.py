"""The streaming wavelet filters: PyWavelets' stationary and decimated transforms as oracles."""

from __future__ import annotations

import numpy as np
import pytest
import pywt
from hypothesis import given, settings
from hypothesis import strategies as st

from quavelet.denoise.fir import FirFilter, approximation_taps
from quavelet.denoise.noise_meter import EVERY
from quavelet.denoise.offline import Recipe
from quavelet.denoise.rows import whole
from quavelet.denoise.shrink import shrink
from quavelet.denoise.sliding import SlidingFilter
from quavelet.denoise.undecimated import UndecimatedFilter

HALF_TAPS = (0.25, 0.21772385, 0.14648437, 0.06551743, 0, -0.02564621, -0.02441406, -0.0128746, 0, 0.0041008,
             0.00292969, 0.00143051, 0, -0.0002861, 0, 3.433e-5)  # fmt: skip
"""The half of db3's with 2 levels from the centre, as printed where the form was derived."""

forms = st.tuples(st.sampled_from(["haar", "db3", "db4", "sym6", "coif1", "bior2.2"]), st.integers(1, 4)).filter(
    lambda f: pywt.Wavelet(f[0]).dec_len < 10 or f[1] < 4
)


def white(seed: int, n: int, k: int = 3) -> np.ndarray:
    return np.random.default_rng(seed).normal(size=(n, k))


def in_pieces(row_filter, rows, seed):
    cuts = np.sort(np.random.default_rng(seed).integers(0, len(rows), 9))
    return np.concatenate([row_filter.push(piece) for piece in np.split(rows, cuts)])


def stationary(x, wavelet, levels, kind, t):
    """PyWavelets' swt, each detail shrunk at t, and iswt; the signal is taken as periodic."""
    done = [(a, shrink(np.ascontiguousarray(d), t, kind=kind)) for a, d in pywt.swt(x, wavelet, level=levels, axis=0)]
    return pywt.iswt(done, wavelet, axis=0)


@settings(max_examples=40, deadline=None)
@given(
    form=forms,
    kind=st.sampled_from(["hard", "soft", "improved", "sigmoid", "power"]),
    t=st.floats(0.0, 3.0),
    seed=st.integers(0, 10**6),
)
def test_it_is_pywavelets_stationary_transform_late_by_the_stated_rows(form, kind, t, seed):
    wavelet, levels = form
    x = white(seed, 1024, 2)
    stream = UndecimatedFilter(wavelet, levels, shrink=kind, threshold=t)
    got = in_pieces(stream, x, seed)[stream.delay :]
    assert stream.delay == (2**levels - 1) * (pywt.Wavelet(wavelet).dec_len - 1)
    inside = slice(stream.delay, 1024 - stream.delay)
    assert np.abs(got[stream.delay :] - stationary(x, wavelet, levels, kind, t)[inside]).max() < 1e-9


@settings(max_examples=25, deadline=None)
@given(form=forms, n=st.integers(1, 200), seed=st.integers(0, 10**6))
def test_without_a_threshold_the_rows_come_out_as_they_were_also_at_the_ends(form, n, seed):
    x = 9.8 + white(seed, n)
    assert np.allclose(whole(UndecimatedFilter(*form, threshold=0.0), x), x, atol=1e-9)


@settings(max_examples=25, deadline=None)
@given(form=forms, n=st.integers(1, 200), at=st.floats(-100.0, 100.0))
def test_a_constant_stays_and_without_the_approximation_nothing_does(form, n, at):
    x = np.full((n, 2), at)
    assert np.allclose(whole(UndecimatedFilter(*form), x), x, atol=1e-8)
    assert np.allclose(whole(UndecimatedFilter(*form, approximation=False), x), 0.0, atol=1e-8)


def test_zeroing_the_approximation_passes_no_mean_and_no_motion():
    """Paper 000, A, at 100 samples a second: of 2 Hz 4e-5 are left, of 5 Hz 0.8 %."""
    t = np.arange(2000) / 100.0
    for hz, gain in ((0.0, 0.0), (0.5, 1e-8), (2.0, 3.85e-5), (5.0, 0.00765), (10.0, 0.234)):
        x = np.cos(2 * np.pi * hz * t)
        out = whole(UndecimatedFilter(threshold=0.0, approximation=False), x)[100:-100]
        assert np.abs(out).max() == pytest.approx(gain, rel=0.01, abs=1e-9)


def test_noise_keeps_0460_of_its_sigma_where_no_detail_is_kept():
    x = white(2, 40000)
    for row_filter in (UndecimatedFilter(threshold=1e9), FirFilter(approximation_taps())):
        assert whole(row_filter, x).std() == pytest.approx(0.460, abs=0.01)
    assert np.sqrt(np.sum(approximation_taps() ** 2)) == pytest.approx(0.460, abs=1e-3)


def test_measured_noise_does_nearly_as_well_and_a_level_of_its_own_too():
    x = white(3, 20000)
    for noise in ("first", "level"):
        settled = whole(UndecimatedFilter(noise=noise), x)[1000:]
        assert settled.std() == pytest.approx(0.46, abs=0.03)


def test_until_the_noise_is_measured_the_rows_are_as_they_were():
    x = white(4, 400)
    stream = UndecimatedFilter()
    out = np.concatenate([stream.push(x), stream.drain()])[stream.delay :]
    # The details of the rows up to EVERY are not shrunk; a row is made of details of up to `delay` rows later.
    assert np.allclose(out[: EVERY - stream.delay], x[: EVERY - stream.delay])
    assert out[100:].std() < 0.6


def test_after_a_run_the_noise_is_known_and_nothing_else():
    x = white(5, 3000)
    used, fresh = UndecimatedFilter(), UndecimatedFilter(threshold=1e9)
    used.push(x)
    used.drain()
    used_out, fresh_out = (np.concatenate([f.push(7.0 + 1e-3 * x[:200]), f.drain()]) for f in (used, fresh))
    assert np.allclose(used_out, fresh_out, atol=1e-9)


def test_a_rise_of_the_noise_is_followed():
    x = white(6, 4000)
    x[2000:] *= 10.0
    out = whole(UndecimatedFilter(), x)
    assert out[1000:1900].std() < 0.5
    assert out[2700:].std() < 5.0


def test_the_31_taps_of_db3_with_two_levels():
    taps = approximation_taps("db3", 2)
    assert len(taps) == 31
    assert taps[15:] == pytest.approx(HALF_TAPS, abs=6e-9)
    assert np.allclose(taps, taps[::-1])
    impulse = np.zeros(64)
    impulse[32] = 1.0
    (a2, _), _ = pywt.swt(impulse, "db3", level=2)
    assert np.allclose(pywt.iswt([(a2, np.zeros(64)), (np.zeros(64), np.zeros(64))], "db3")[17:48], taps, atol=1e-12)
    response = np.abs(np.fft.rfft(taps, 10000))
    assert np.argmax(response < np.sqrt(0.5)) / 10000 == pytest.approx(0.106, abs=1e-3)
    assert response[1250] == pytest.approx(0.4875, abs=1e-3)


@settings(max_examples=25, deadline=None)
@given(
    form=st.sampled_from([("db3", 2), ("haar", 3), ("db4", 2), ("sym6", 3)]),
    n=st.integers(20, 400),
    kind=st.sampled_from(["soft", "improved"]),
    t=st.floats(0.0, 3.0),
    seed=st.integers(0, 10**6),
)
def test_a_window_moved_by_hops_gives_the_offline_result_from_end_to_end(form, n, kind, t, seed):
    """Acceptance 5a."""
    recipe = Recipe(wavelet=form[0], levels=form[1], shrink=kind, threshold=t)
    n += 100 if form[0] == "sym6" else 10
    x = white(seed, n)
    stream = SlidingFilter(recipe)
    got = np.concatenate([in_pieces(stream, x, seed), stream.drain()])[stream.delay :]
    # sym6's printed taps sum to 3e-12, not 0.
    assert np.abs(got - recipe.apply(x)).max() < (1e-12 if form[0] != "sym6" and kind == "soft" else 1e-10)


def test_db3_with_two_levels_hops_by_4_and_lags_by_12():
    stream = SlidingFilter(Recipe(wavelet="db3", levels=2, threshold=1.0))
    assert (stream.hop, stream.lag, stream.delay, stream._window) == (4, 12, 15, 32)


@pytest.mark.parametrize(
    ("make", "says"),
    [
        (lambda: UndecimatedFilter("dmey", 2), "only approximately"),
        (lambda: UndecimatedFilter("db77", 2), "not known"),
        (lambda: UndecimatedFilter("db3", 0), "levels = 0"),
        (lambda: UndecimatedFilter(shrink="garrote"), "not known"),
        (lambda: UndecimatedFilter(shrink="improved", k=-1.0), "positive"),
        (lambda: UndecimatedFilter(rule="sure"), "not one for a stream"),
        (lambda: SlidingFilter(Recipe()), "fixed"),
        (lambda: FirFilter(np.ones(4)), "no middle"),
        (lambda: FirFilter(np.array([1.0, 2.0, 3.0])), "no middle"),
    ],
)
def test_a_filter_that_cannot_be_is_refused(make, says):
    with pytest.raises(ValueError, match=says):
        make()
