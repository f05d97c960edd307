"""The noise of a sensor that lay still, axis by axis."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from quavelet.calibration.allan import ACCEL, GYRO, AllanCurve, DataSheet, NoiseFit, allan_deviation, fit_noise
from quavelet.core.blocks import FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class AxisNoise:
    """One axis: its Allan deviation, and what that is made of (None: the record is too short to say); `mean` is what
    it read, SI."""

    sheet: DataSheet
    axis: str
    mean: float
    curve: AllanCurve
    fit: NoiseFit | None


def noise_of(gyro_rad_s: FloatArray, accel_m_s2: FloatArray, *, period_s: float) -> tuple[AxisNoise, ...]:
    """Both sensors' axes over a still stretch, (N, 3) each, sampled every `period_s`.

    Raises ValueError for fewer samples than an Allan deviation needs.
    """
    return tuple(
        AxisNoise(sheet, axis, float(column.mean()), curve, _fit(curve))
        for sheet, values in ((GYRO, gyro_rad_s), (ACCEL, accel_m_s2))
        for axis, column, curve in _curves(values, period_s)
    )


def _curves(values: FloatArray, period_s: float) -> Iterable[tuple[str, FloatArray, AllanCurve]]:
    for axis, column in zip("xyz", values.T, strict=True):
        yield axis, column, allan_deviation(column, period_s=period_s)


def _fit(curve: AllanCurve) -> NoiseFit | None:
    try:
        return fit_noise(curve)
    except ValueError:
        return None
