"""The noise of a sensor that lay still, axis by axis."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from quavelet.calibration.allan import ACCEL, GYRO, AllanCurve, DataSheet, NoiseFit, Term, allan_deviation_of, fit_noise
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

    def figures(self) -> dict[str, str | float | dict[str, float]]:
        """All of it in SI, for JSON; the curve by its least deviation alone."""
        least, tau_s = self.curve.minimum()
        found: dict[str, str | float | dict[str, float]] = {
            "sensor": self.sheet.name,
            "axis": self.axis,
            "mean": self.mean,
            "least_deviation": least,
            "averaged_over_s": tau_s,
        }
        if self.fit:
            found["word"] = self.sheet.word(self.fit.density.value)
            for name in ("density", "instability", "walk", "ramp"):
                term: Term = getattr(self.fit, name)
                found[name] = {"value": term.value, "sigma": term.sigma, "limit": term.limit}
        return found


def noise_of(stretches: Sequence[tuple[FloatArray, FloatArray]], *, period_s: float) -> tuple[AxisNoise, ...]:
    """Both sensors' axes over still stretches: rates in rad/s and forces in m/s^2, (N, 3) each, every `period_s`.

    Raises ValueError for fewer samples than an Allan deviation needs.
    """
    return tuple(
        AxisNoise(sheet, axis, mean, curve, _fit(curve))
        for sheet, values in zip((GYRO, ACCEL), zip(*stretches, strict=True), strict=True)
        for axis, mean, curve in _curves(values, period_s)
    )


def _curves(values: Sequence[FloatArray], period_s: float) -> Iterable[tuple[str, float, AllanCurve]]:
    for k, axis in enumerate("xyz"):
        columns = [stretch[:, k] for stretch in values]
        yield axis, float(np.concatenate(columns).mean()), allan_deviation_of(columns, period_s=period_s)


def _fit(curve: AllanCurve) -> NoiseFit | None:
    try:
        return fit_noise(curve)
    except ValueError:
        return None
