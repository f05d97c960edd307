"""The part of PyWavelets that quavelet/denoise/wavelets.py uses; the package has no type hints of its own."""

from collections.abc import Sequence

from numpy import float64
from numpy.typing import NDArray

class Wavelet:
    dec_lo: list[float]
    dec_hi: list[float]
    rec_lo: list[float]
    rec_hi: list[float]
    dec_len: int
    orthogonal: bool
    def __init__(self, name: str) -> None: ...

class _Modes:
    modes: list[str]

Modes: _Modes

def wavelist(family: str | None = None, kind: str = "all") -> list[str]: ...
def dwt_max_level(data_len: int, filter_len: int) -> int: ...
def wavedec(
    data: NDArray[float64], wavelet: Wavelet, mode: str = "symmetric", level: int | None = None, axis: int = -1
) -> list[NDArray[float64]]: ...
def waverec(
    coeffs: Sequence[NDArray[float64]], wavelet: Wavelet, mode: str = "symmetric", axis: int = -1
) -> NDArray[float64]: ...
