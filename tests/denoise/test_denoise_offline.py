"""The offline way: PyWavelets' own pieces as oracle, the papers' recipes, and input that cannot be."""

from __future__ import annotations

import numpy as np
import pytest
import pywt
from hypothesis import given, settings
from hypothesis import strategies as st

from quavelet.denoise.offline import (
    PAPER_000,
    PAPER_001_ACCEL,
    PAPER_001_MAG,
    PAPER_002,
    PAPER_004,
    Recipe,
    denoise,
    denoise_axes,
    paper_000,
    paper_004,
)
from quavelet.denoise.wavelets import shortest

RECIPES = {
    "000": PAPER_000, "001 accel x": PAPER_001_ACCEL[0], "001 accel z": PAPER_001_ACCEL[2],
    "001 mag x": PAPER_001_MAG[0], "001 mag y": PAPER_001_MAG[1], "002": PAPER_002, "004": PAPER_004,
}  # fmt: skip


def white(seed: int, n: int, k: int = 3) -> np.ndarray:
    return np.random.default_rng(seed).normal(size=(n, k))


@settings(max_examples=30, deadline=None)
@given(
    seed=st.integers(0, 10**6),
    n=st.integers(300, 900),
    wavelet=st.sampled_from(["db3", "db4", "sym6", "coif4"]),
    levels=st.integers(1, 3),
    mode=st.sampled_from(["symmetric", "antireflect", "periodization"]),
)
def test_it_is_decompose_threshold_recompose_as_pywavelets_does_it(seed, n, wavelet, levels, mode):
    x = white(seed, n, 1)[:, 0]
    first, *details = pywt.wavedec(x, wavelet, mode=mode, level=levels)
    sigmas = [np.median(np.abs(d)) / 0.6745 for d in details]
    for noise, used in (("first", sigmas[-1:] * levels), ("level", sigmas)):
        kept = [pywt.threshold(d, s * np.sqrt(2 * np.log(n)), "soft") for d, s in zip(details, used, strict=True)]
        expected = pywt.waverec([first, *kept], wavelet, mode=mode)[:n]
        got = denoise(x, wavelet=wavelet, levels=levels, mode=mode, noise=noise)
        assert np.allclose(got, expected, atol=1e-9)


@pytest.mark.parametrize("name", RECIPES)
@settings(max_examples=10, deadline=None)
@given(seed=st.integers(0, 10**6), extra=st.integers(0, 300), scale=st.floats(1e-6, 1e6))
def test_any_length_and_unit_give_back_as_many_rows_and_the_mean(name, seed, extra, scale):
    recipe = RECIPES[name]
    n = shortest(recipe.wavelet, recipe.levels) + extra
    x = 5.0 + white(seed, n)
    out = recipe.apply(x)
    assert out.shape == x.shape
    assert np.allclose(recipe.apply(x * scale), out * scale, rtol=1e-5, atol=1e-5 * scale)
    assert np.allclose(recipe.apply(x[:, 1]), out[:, 1])
    assert np.allclose(recipe.apply(np.full((n, 2), 7.5)), 7.5, atol=1e-5)


@pytest.mark.parametrize("name", RECIPES)
def test_on_noise_the_approximation_is_what_stays(name):
    """sigma falls by sqrt(2^J), whatever the wavelet; that is all there is to gain on a board at rest."""
    recipe = RECIPES[name]
    out = recipe.apply(white(9, 16000))
    assert out.std() * 2 ** (recipe.levels / 2) == pytest.approx(1.0, abs=0.15)


def test_reading_a_takes_away_bias_and_motion_and_reading_c_keeps_them():
    t = np.arange(2000) / 100.0
    turn = 3.0 + np.sin(2 * np.pi * 0.5 * t)
    for reading in ("A", "D"):
        assert np.abs(paper_000(turn, reading=reading)[50:-50]).max() < 1e-2
    noisy = turn + 0.03 * white(2, 2000, 1)[:, 0]
    assert np.abs(paper_000(noisy, reading="C")[50:-50] - turn[50:-50]).std() < 0.02
    a, d = paper_000(noisy, reading="A"), paper_000(noisy, reading="D")
    assert abs(a.mean()) < 1e-3
    assert d.std() < 0.2 * a.std()


def test_an_oscillation_survives_the_improved_function_better_than_the_soft_one():
    clean = 10.0 * np.sin(2 * np.pi * 5.0 * np.arange(3000) / 100.0)
    x = clean + white(4, 3000, 1)[:, 0]
    error = {s: np.std(denoise(x, wavelet="sym6", levels=4, shrink=s) - clean) for s in ("soft", "improved")}
    assert error["improved"] < 0.6 * error["soft"]
    assert error["improved"] < 1.0 < error["soft"]


def test_whose_details_measure_the_noise():
    """Behind a low-pass the noise is below level 1, which then says little of it; a motion that fills a level is
    taken for noise where each level speaks for itself."""
    coloured = np.convolve(white(8, 20000, 1)[:, 0], np.hanning(10) / 5.0, "valid")
    own, first = (denoise(coloured, noise=n).std() for n in ("level", "first"))
    assert own < 0.6 * first
    motion = 10.0 * np.sin(2 * np.pi * 5.0 * np.arange(3000) / 100.0)
    moving = motion + white(4, 3000, 1)[:, 0]
    own, first = (np.std(denoise(moving, noise=n) - motion) for n in ("level", "first"))
    assert own > 0.95 * motion.std() > 2.0 * first


def test_gravity_comes_through_dmey_as_it_is():
    """dmey's high-pass sums to 1e-3: of 9.8 m/s^2 a ripple of 0.015 would be left, 0.09 degrees of tilt."""
    x = 9.80665 + 1e-3 * white(3, 3000)
    assert PAPER_001_ACCEL[0].apply(x).std() < 0.5e-3


def test_each_axis_has_its_own_wavelet():
    x = white(5, 1200)
    out = denoise_axes(x, PAPER_001_ACCEL)
    assert np.array_equal(out[:, 2], PAPER_001_ACCEL[2].apply(x[:, 2]))
    assert not np.allclose(out[:, 0], PAPER_001_ACCEL[2].apply(x[:, 0]))


def test_the_hybrid_of_paper_004_bridges_impulses_that_the_wavelet_alone_spreads():
    rng = np.random.default_rng(2020)
    x = rng.normal(size=600) * 0.4
    x[rng.random(600) < 0.03] += 30.0
    assert paper_004(x).std() < 0.2
    assert PAPER_004.apply(x).std() > 5 * paper_004(x).std()


def test_a_fixed_threshold_and_no_detail_at_all():
    x = white(6, 500)
    assert np.allclose(denoise(x, wavelet="db3", levels=2, threshold=0.0), x, atol=1e-9)
    low = Recipe(wavelet="db3", levels=2, keep="approximation").apply(x)
    assert np.allclose(denoise(x, wavelet="db3", levels=2, threshold=1e9), low)


@pytest.mark.parametrize(
    ("signal", "wrong", "says"),
    [
        (np.zeros(975), {"wavelet": "dmey", "levels": 4}, "975 samples are too few for dmey with 4 levels: give 976"),
        (np.zeros(1), {}, "1 samples are too few for db4 with 5 levels: give 224"),
        (np.zeros((0, 3)), {}, "shape"),
        (np.zeros((4, 4, 4)), {}, "shape"),
        (np.array([1.0, 2.0, np.nan] * 100), {}, "row 2 is not finite"),
        (np.array([1.0, np.inf] * 200), {}, "row 1 is not finite"),
        (np.zeros(500), {"wavelet": "db99"}, "'db99' is not known"),
        (np.zeros(500), {"wavelet": "mexh"}, "'mexh' is not known: give a discrete one"),
        (np.zeros(500), {"mode": "mirror"}, "mode 'mirror' is not known"),
        (np.zeros(500), {"levels": 0}, "levels = 0"),
        (np.zeros(500), {"rule": "minimax"}, "rule 'minimax'"),
        (np.zeros(500), {"shrink": "garrote"}, "shrink 'garrote'"),
    ],
)
def test_what_cannot_be_done_is_said(signal, wrong, says):
    with pytest.raises(ValueError, match=says):
        denoise(signal, **wrong)


def test_dmey_with_four_levels_has_enough_at_976():
    assert pywt.dwt_max_level(976, 62) == 4
    assert denoise(np.zeros(976), wavelet="dmey", levels=4).shape == (976,)


def test_axes_and_readings_that_do_not_fit_are_refused():
    with pytest.raises(ValueError, match="3 recipes do not fit 2 columns"):
        denoise_axes(np.zeros((1000, 2)), PAPER_001_MAG)
    with pytest.raises(ValueError, match="reading 'B' is not known"):
        paper_000(np.zeros(100), reading="B")
