"""The settings of the stage, and the filter they ask for."""

from __future__ import annotations

from typing import Literal, get_args

import msgspec

from quavelet.core.errors import SettingsError
from quavelet.denoise.fir import FirFilter, approximation_taps
from quavelet.denoise.hampel import ACCEL_FLOOR_M_S2, GYRO_FLOOR_RAD_S, HampelFilter
from quavelet.denoise.median import MedianFilter
from quavelet.denoise.rows import RowFilter
from quavelet.denoise.shrink import Shrink
from quavelet.denoise.smoother import LineSmoother
from quavelet.denoise.thresholds import Noise, StreamRule
from quavelet.denoise.undecimated import UndecimatedFilter

Kind = Literal["none", "wavelet", "lowpass", "median", "hampel", "smoother", "details", "details-shrunk"]

MAX_DELAY = 1000
"""Samples. A filter that waits for more is not one for a stream, and its memory grows with it."""
_OF_FORCE = (False,) * 3 + (True,) * 3
_FLOORS = (GYRO_FLOOR_RAD_S,) * 3 + (ACCEL_FLOOR_M_S2,) * 3


class DenoiseParams(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What is done to rate and acceleration before the attitude; whatever it is, both are delayed alike. Attitude gains
    hardly anything from it.

    kind        "none"
                "wavelet"   details below a threshold are shrunk; (2^levels - 1)(taps - 1) samples late
                "lowpass"   no details at all: one linear filter, as late as "wavelet"
                "median"    of a window; (window - 1)/2 late
                "hampel"    only impulses are replaced, by the median of the window; (window - 1)/2 late
                "smoother"  a straight line through the past; not late
                "details"   paper 000's reading A, with the filter "gyro" its reading B: the rate without its bias and
                            all motion slower than an eighth of the sample rate. For comparison only: the heading
                            cannot move, and is flagged
                "details-shrunk"  its reading D: the details shrunk as by "wavelet" besides
    wavelet     of "wavelet" and "lowpass": "db3", "db4", "sym6", ...; db3 with 2 levels is 15 samples late
    levels      of "wavelet" and "lowpass"
    threshold   of "wavelet": what is called noise
    noise       of "wavelet": sigma from the "first" level, or of each "level" by itself
    shrink      of "wavelet"
    k, alpha    of the shrinks "improved", "sigmoid" and "power"
    window      of "median" and "hampel", in samples
    sigmas      of "hampel": how far from the median an impulse is
    forgetting  of "smoother"
    """

    kind: Kind = "none"
    wavelet: str = "db3"
    levels: int = 2
    threshold: StreamRule = "universal"
    noise: Noise = "first"
    shrink: Shrink = "soft"
    k: float = 16.0
    alpha: float = 1.0
    window: int = 5
    sigmas: float = 4.0
    forgetting: float = 0.6

    def __post_init__(self) -> None:
        if not 1 <= self.levels <= 10:
            raise SettingsError(f"levels = {self.levels} does not fit: give 1 to 10")
        for name, most in (("k", 1000.0), ("alpha", 100.0), ("sigmas", 1000.0)):
            if not 0.0 < getattr(self, name) <= most:
                raise SettingsError(
                    f"{name} = {getattr(self, name)} does not fit: give a positive number, {most:g} at most"
                )
        # What is wrong is wrong whatever the kind: else it would show only when the kind is changed.
        for kind in get_args(Kind)[1:]:
            try:
                row_filter = self._filter(kind)
            except ValueError as error:
                raise SettingsError(str(error)) from error
            if row_filter.delay > MAX_DELAY:
                raise SettingsError(
                    f"{kind} would be {row_filter.delay} samples late: give fewer levels, a shorter wavelet or a "
                    f"shorter window, so that it is {MAX_DELAY} at most"
                )

    @property
    def keeps_slow_motion(self) -> bool:
        """Whether the rate's mean and slow motion come through."""
        return not self.kind.startswith("details")

    def build(self) -> RowFilter | None:
        """A new filter for rows of rate x y z in rad/s and acceleration x y z in m/s^2; None for "none"."""
        return None if self.kind == "none" else self._filter(self.kind)

    def _filter(self, kind: Kind) -> RowFilter:
        if kind == "median":
            return MedianFilter(self.window)
        if kind == "hampel":
            return HampelFilter(self.window, sigmas=self.sigmas, floor=_FLOORS)
        if kind == "smoother":
            return LineSmoother(self.forgetting)
        wavelet = UndecimatedFilter(
            self.wavelet, self.levels, rule=self.threshold, noise=self.noise, shrink=self.shrink, k=self.k,
            alpha=self.alpha, threshold=0.0 if kind == "details" else None,
            approximation=_OF_FORCE if kind.startswith("details") else True,
        )  # fmt: skip
        return FirFilter(approximation_taps(self.wavelet, self.levels)) if kind == "lowpass" else wavelet
