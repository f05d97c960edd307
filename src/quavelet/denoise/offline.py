"""A whole signal at once: decompose, shrink the details, recompose; and how each paper does it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from quavelet.core.blocks import FloatArray
from quavelet.denoise.median import median_filter
from quavelet.denoise.shrink import Shrink, shrink
from quavelet.denoise.signal import as_columns, like
from quavelet.denoise.thresholds import Noise, Rule, mad_sigma, threshold
from quavelet.denoise.wavelets import decompose, recompose

Reading = Literal["A", "C", "D"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Recipe:
    """All that decides what `denoise` does; its keywords, together.

    threshold   in the unit of the signal, for every level, in place of `rule` and `noise`
    keep        "all"; "details": without the approximation (what it removes is the mean and all slow motion);
                "approximation": without any detail, a linear low-pass
    """

    wavelet: str = "db4"
    levels: int = 5
    rule: Rule = "universal"
    noise: Noise = "first"
    shrink: Shrink = "soft"
    k: float = 16.0
    alpha: float = 1.0
    mode: str = "symmetric"
    threshold: float | None = None
    keep: Literal["all", "details", "approximation"] = "all"

    def apply(self, signal: FloatArray) -> FloatArray:
        """As `denoise`."""
        x = as_columns(signal)
        # dmey's high-pass does not quite sum to 0: gravity would leak into the details and come out as a ripple.
        mean = x.mean(axis=0)
        levels = decompose(x - mean, wavelet=self.wavelet, levels=self.levels, mode=self.mode)
        first = mad_sigma(levels[-1])
        approximation = np.zeros_like(levels[0]) if self.keep == "details" else levels[0]
        done = [approximation]
        for level, details in zip(range(self.levels, 0, -1), levels[1:], strict=True):
            sigma = first if self.noise == "first" else mad_sigma(details)
            done.append(self._shrunk(details, sigma, n=len(x), level=level))
        out = recompose(done, wavelet=self.wavelet, mode=self.mode)[: len(x)]
        return like(signal, out if self.keep == "details" else out + mean)

    def _shrunk(self, details: FloatArray, sigma: FloatArray, *, n: int, level: int) -> FloatArray:
        if self.keep == "approximation":
            return np.zeros_like(details)
        if self.threshold is not None:
            t = np.full(details.shape[1], self.threshold)
        else:
            t = np.array(
                [
                    threshold(column, rule=self.rule, sigma=float(s), n=n, level=level)
                    for column, s in zip(details.T, sigma, strict=True)
                ]
            )
        return shrink(details, t, kind=self.shrink, k=self.k, alpha=self.alpha)


def denoise(
    signal: FloatArray,
    *,
    wavelet: str = "db4",
    levels: int = 5,
    rule: Rule = "universal",
    noise: Noise = "first",
    shrink: Shrink = "soft",
    k: float = 16.0,
    alpha: float = 1.0,
    mode: str = "symmetric",
    threshold: float | None = None,
) -> FloatArray:
    """The signal (N,) or (N, k), each column by itself along the first axis, with its details shrunk.

    rule        "universal", "level_scaled" (paper 001), "sure" (paper 002) or "heursure"
    noise       "first": sigma from level 1's details; "level": from each level's own (see `Noise`)
    shrink      "soft", "hard", "improved", "sigmoid" or "power", with k and alpha (see `shrink`)
    mode        how the signal goes on beyond its ends; with "antireflect" or "smooth" the last sample is
                noisier than it was
    threshold   in the unit of the signal, for all levels, in place of `rule`

    Raises ValueError for a name that is not known, a value that is not finite, and a signal too short for
    so many levels (db4 with 5 needs 224 samples, dmey with 4 976).
    """
    recipe = Recipe(
        wavelet=wavelet, levels=levels, rule=rule, noise=noise, shrink=shrink, k=k, alpha=alpha, mode=mode,
        threshold=threshold,
    )  # fmt: skip
    return recipe.apply(signal)


def denoise_axes(signal: FloatArray, recipes: Sequence[Recipe]) -> FloatArray:
    """The signal (N, k), each column by its own recipe, as paper 001 has it. Raises ValueError as `denoise`."""
    x = as_columns(signal)
    if x.shape[1] != len(recipes):
        raise ValueError(f"{len(recipes)} recipes do not fit {x.shape[1]} columns: give one for each")
    return np.column_stack([recipe.apply(column) for recipe, column in zip(recipes, x.T, strict=True)])


PAPER_000 = Recipe(wavelet="db3", levels=2)
"""Reading C of paper 000; its rule is not printed."""

_PAPER_001 = Recipe(levels=4, rule="level_scaled", shrink="improved")
PAPER_001_ACCEL = (
    replace(_PAPER_001, wavelet="dmey", k=9.0),
    replace(_PAPER_001, wavelet="dmey", k=9.0),
    replace(_PAPER_001, wavelet="sym6", k=16.0),
)
"""Paper 001's accelerometer x y z."""
PAPER_001_MAG = (
    replace(_PAPER_001, wavelet="sym6", k=16.0),
    replace(_PAPER_001, wavelet="coif4", k=20.0),
    replace(_PAPER_001, wavelet="coif4", k=20.0),
)
"""Paper 001's magnetometer x y z."""

PAPER_002 = Recipe(wavelet="db4", levels=5, rule="sure", noise="level")
PAPER_004 = Recipe(wavelet="db4", levels=5, noise="level")
"""The wavelet half of paper 004; its rule is not printed."""


def paper_000(rate: FloatArray, *, reading: Reading = "C") -> FloatArray:
    """The rate (N,) or (N, k) by one of the readings of paper 000, db3 with 2 levels.

    A: the approximation A2 zeroed, the details kept.  C: A2 kept, the details shrunk (soft, universal).
    D: A2 zeroed and the details shrunk. A and D take away all that is slower than an eighth of the sample
    rate: the bias, and every motion of a hand or a vehicle. (Reading B is A's rate in another attitude loop.)
    """
    if reading == "A":
        return replace(PAPER_000, keep="details", threshold=0.0).apply(rate)
    if reading == "C":
        return PAPER_000.apply(rate)
    if reading == "D":
        return replace(PAPER_000, keep="details").apply(rate)
    raise ValueError(f"reading {reading!r} is not known: give A, C or D")


def paper_004(signal: FloatArray, *, window: int = 13) -> FloatArray:
    """The median and wavelet hybrid of paper 004, (N,) or (N, k).

    window: odd; it must be longer than twice the longest disturbance, so it depends on the sample rate.
    """
    return PAPER_004.apply(median_filter(signal, window))
