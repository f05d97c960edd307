"""Noise is shown with what is not known of it: brackets, a shade, and the data sheet beside it."""

from __future__ import annotations

import numpy as np
import pytest

from quavelet.calibration.allan import FIT_FROM_S
from quavelet.calibration.noise import AxisNoise, noise_of
from quavelet.core.units import RAD_PER_DEG, STANDARD_GRAVITY_M_S2
from quavelet.drawing.noise import allan_charts, noise_table

PERIOD_S = 0.01
DENSITY_DPS, DENSITY_UG = 0.03, 600.0


@pytest.fixture(scope="module")
def noise() -> tuple[AxisNoise, ...]:
    """White noise alone, a hundred seconds of it."""
    white = np.random.default_rng(5).normal(size=(2, 10_000, 3)) / np.sqrt(2.0 * PERIOD_S)
    gyro = white[0] * DENSITY_DPS * RAD_PER_DEG
    accel = white[1] * DENSITY_UG * 1e-6 * STANDARD_GRAVITY_M_S2
    return noise_of([(gyro, accel)], period_s=PERIOD_S)


def test_a_row_an_axis_in_the_sheets_units_with_what_is_not_seen_in_brackets(noise):
    table = noise_table(noise)
    rows = [dict(zip(table.head, (cell.text for cell in row), strict=True)) for row in table.rows]
    assert [row["sensor"] for row in rows] == [f"{name} {a}" for name in ("gyroscope", "accelerometer") for a in "xyz"]
    for row, density, word in zip(rows, [DENSITY_DPS] * 3 + [DENSITY_UG] * 3, ["poor"] * 3 + ["good"] * 3, strict=True):
        value, sigma = map(float, row["density, /rtHz"].split(" ± "))
        assert abs(value - density) < max(4 * sigma, 0.03 * density)
        assert row["judged"] == word
    assert sum(row["bias instability"].startswith("(< ") for row in rows) >= 4


def test_a_chart_a_sensor_with_shade_fit_and_data_sheet(noise):
    gyro, accel = allan_charts(noise, "still")
    assert (gyro.y_label, accel.y_label) == ("deviation, deg/s", "deviation, ug")
    measured = [curve for curve in gyro.curves if curve.coloured]
    fitted = [curve for curve in gyro.curves if curve.dotted]
    (sheet,) = (curve for curve in gyro.curves if curve.dashed)
    assert ([c.label for c in measured], [c.label for c in fitted]) == (["x", "y", "z"], ["fitted", "", ""])
    for curve in measured:
        assert curve.band is not None
        low, high = curve.band
        assert (low < curve.y).all()
        assert (curve.y < high).all()
    assert all(curve.x.min() >= FIT_FROM_S for curve in fitted), "below that it is the chip's low-pass"
    ratio = np.interp(1.0, measured[0].x, measured[0].y) / np.interp(1.0, sheet.x, sheet.y)
    assert ratio == pytest.approx(DENSITY_DPS / 0.005, rel=0.15)
