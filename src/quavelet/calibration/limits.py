"""What no value of a calibration can be: far outside the data sheet, where a file is wrong and no chip."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from math import isfinite

from quavelet.core.errors import CalibrationError
from quavelet.core.units import RAD_PER_DEG

Number = int | float

_LARGEST = 2**63
_SIGMA = (0.0, 1.0)
_RANGES: Mapping[str, tuple[float, float]] = {
    "chip.who_am_i": (0x01, 0xFE),
    "chip.address": (0x08, 0x77),
    "made.gyro_range_dps": (250, 2000),
    "made.accel_range_g": (2, 16),
    "made.lowest_degc": (-60.0, 130.0),
    "made.highest_degc": (-60.0, 130.0),
    "accelerometer.offset_m_s2": (-5.0, 5.0),
    "accelerometer.offset_sigma_m_s2": (0.0, 5.0),
    "accelerometer.sigma_m_s2": (1e-6, 5.0),
    "gyro_bias.reference_degc": (-60.0, 130.0),
    "gyro_bias.lowest_degc": (-60.0, 130.0),
    "gyro_bias.highest_degc": (-60.0, 130.0),
    "gyro_bias.sigma_rad_s": (1e-9, 1.0),
    "gyro_bias.slope_sigma_rad_s_degc": (0.0, 0.1),
    "gyro_bias.per_force_rad_s": (-0.005, 0.005),
    "gyro_bias.residual_rms_rad_s": _SIGMA,
    "gyro_scale.scale_sigma": (1e-9, 0.2),
    "magnetometer.hard_iron_ut": (-5000.0, 5000.0),
    "magnetometer.soft_iron": (-3.0, 3.0),
    "magnetometer.field_ut": (1.0, 2000.0),
    "magnetometer.field_sigma": (1e-9, 1.0),
    "magnetometer.coverage": (0.0, 1.0),
}
_BIAS_RAD_S = (60.0 * RAD_PER_DEG, 2.0 * RAD_PER_DEG, 0.1 * RAD_PER_DEG, 0.01 * RAD_PER_DEG, 0.001 * RAD_PER_DEG)
"""Of the coefficients of powers 0 to 4."""
_DIAGONAL, _ACROSS = (0.7, 1.4), (-0.15, 0.15)


def check_finite(tables: object, *, key: str = "") -> None:
    """Raises CalibrationError that names the key of a number that is none."""
    if isinstance(tables, dict):
        for name, value in tables.items():
            check_finite(value, key=f"{key}.{name}" if key else str(name))
    elif isinstance(tables, list):
        for value in tables:
            check_finite(value, key=key)
    elif isinstance(tables, int) and abs(tables) > _LARGEST:
        raise CalibrationError(f"{key} is far too large a number: calibrate anew")
    elif isinstance(tables, float) and not isfinite(tables):
        raise CalibrationError(f"{key} = {tables} is not a finite number: calibrate anew")


def check_sane(tables: Mapping[str, object]) -> None:
    """Raises CalibrationError that names the key of a value that no chip can have."""
    for name, table in tables.items():
        if isinstance(table, dict):
            for key, value in table.items():
                _check(f"{name}.{key}", value)
    kept = tables.get("kept")
    for made in kept.values() if isinstance(kept, dict) else ():
        check_sane({"made": made})
    for name in ("made", "gyro_bias"):
        table = tables.get(name)
        if isinstance(table, dict) and not table["lowest_degc"] <= table["highest_degc"]:
            raise CalibrationError(f"{name}.lowest_degc is above {name}.highest_degc: calibrate anew")


def _check(key: str, value: object) -> None:
    if key in _RANGES:
        for number in _numbers(value):
            _within(key, number, _RANGES[key])
    elif key in ("accelerometer.matrix", "gyro_scale.matrix") and isinstance(value, list):
        for i, row in enumerate(value):
            for j, number in enumerate(row):
                _within(key, number, _DIAGONAL if i == j else _ACROSS)
    elif key == "gyro_bias.coefficients_rad_s" and isinstance(value, list):
        if not 1 <= len(value) <= len(_BIAS_RAD_S):
            raise CalibrationError(f"{key} has {len(value)} rows: a bias has one to {len(_BIAS_RAD_S)}")
        for row, limit in zip(value, _BIAS_RAD_S, strict=False):
            for number in row:
                _within(key, number, (-limit, limit))
    elif key.endswith("sigma"):
        for number in _numbers(value):
            _within(key, number, _SIGMA)


def _within(key: str, number: Number, limits: tuple[float, float]) -> None:
    if not limits[0] <= number <= limits[1]:
        raise CalibrationError(f"{key} = {number:g} is beyond what a chip can have: calibrate anew")


def _numbers(value: object) -> Iterator[Number]:
    if isinstance(value, list):
        for item in value:
            yield from _numbers(item)
    elif isinstance(value, int | float):
        yield value
