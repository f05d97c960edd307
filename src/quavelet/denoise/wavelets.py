"""PyWavelets behind typed functions: no other file imports it.

Levels count from 1, the finest; coefficients stand as [A_J, d_J, ..., d_1].
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import pywt

from quavelet.core.blocks import FloatArray

MODES = tuple(pywt.Modes.modes)
"""Ways to go on beyond the ends of a signal: "symmetric", "antireflect", ..."""


@dataclass(frozen=True, slots=True)
class Filters:
    """The four filters of a wavelet, of equal length; low-passes sum to sqrt(2)."""

    dec_lo: tuple[float, ...]
    dec_hi: tuple[float, ...]
    rec_lo: tuple[float, ...]
    rec_hi: tuple[float, ...]
    orthogonal: bool

    def __len__(self) -> int:
        return len(self.dec_lo)


@cache
def filters(wavelet: str) -> Filters:
    """The filters of a discrete wavelet ("db3", "sym6", "coif4", "dmey"). Raises ValueError for another name."""
    w = _wavelet(wavelet)
    return Filters(tuple(w.dec_lo), tuple(w.dec_hi), tuple(w.rec_lo), tuple(w.rec_hi), w.orthogonal)


def shortest(wavelet: str, levels: int) -> int:
    """The fewest samples in which the deepest level holds a value that the ends have no part in."""
    return (len(filters(wavelet)) - 1) << levels


def decompose(signal: FloatArray, *, wavelet: str, levels: int, mode: str = "symmetric") -> list[FloatArray]:
    """[A_J, d_J, ..., d_1] of a signal, along its first axis.

    Raises ValueError for an unknown wavelet or mode, and for a signal too short for so many levels.
    """
    if levels < 1:
        raise ValueError(f"levels = {levels} does not fit: give 1 or more")
    if mode not in MODES:
        raise ValueError(f"mode {mode!r} is not known: give one of {', '.join(MODES)}")
    w, needed = _wavelet(wavelet), shortest(wavelet, levels)
    if len(signal) < needed:
        raise ValueError(
            f"{len(signal)} samples are too few for {wavelet} with {levels} levels: "
            f"give {needed} or more, or fewer levels"
        )
    return pywt.wavedec(signal, w, mode=mode, level=levels, axis=0)


def recompose(coefficients: list[FloatArray], *, wavelet: str, mode: str = "symmetric") -> FloatArray:
    """The signal of `decompose`, possibly with one row more at its end."""
    return pywt.waverec(coefficients, _wavelet(wavelet), mode=mode, axis=0)


@cache
def _wavelet(name: str) -> pywt.Wavelet:
    if name not in pywt.wavelist(kind="discrete"):
        raise ValueError(f"wavelet {name!r} is not known: give a discrete one, such as db3, db4, sym6, coif4 or dmey")
    return pywt.Wavelet(name)
