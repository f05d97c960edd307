"""Counts to SI: scales, signs, and the calibration's own arithmetic against numpy's matrix product."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from quavelet.calibration.calibrate import Calibrate
from quavelet.calibration.model import BiasCurve, ImuCalibration
from quavelet.core.blocks import Flag, RawBlock, Scale

SCALE = Scale(
    gyro_rad_s_per_lsb=np.radians(1 / 16.4), accel_m_s2_per_lsb=9.80665 / 4096, temp_degc_per_lsb=1 / 340,
    temp_degc_at_zero=36.53,
)  # fmt: skip
matrices = st.tuples(*[st.tuples(*[st.floats(-2.0, 2.0)] * 3)] * 3)
vectors = st.tuples(*[st.floats(-5.0, 5.0)] * 3)


def raw(counts) -> RawBlock:
    counts = np.asarray(counts, dtype=np.int16)
    n = len(counts)
    return RawBlock(
        t_ns=np.arange(n, dtype=np.int64),
        period_s=np.full(n, 0.01),
        gap_ns=np.zeros(n, dtype=np.int64),
        flags=np.zeros(n, dtype=np.uint32),
        counts=counts,
        scale=SCALE,
    )


def test_each_count_lands_on_its_own_axis_with_its_own_unit():
    out = Calibrate(ImuCalibration()).process(raw([[4096, -8192, 2048, -3400, 164, -328, 1640]]))
    assert np.allclose(out.accel_m_s2[0] / 9.80665, [1.0, -2.0, 0.5])
    assert np.allclose(np.degrees(out.gyro_rad_s[0]), [10.0, -20.0, 100.0])
    assert np.isclose(out.temp_degc[0], 26.53)
    assert out.flags[0] == Flag.BIAS_UNKNOWN


@given(
    gyro_matrix=matrices, accel_matrix=matrices, bias=vectors, offset=vectors,
    counts=st.lists(st.tuples(*[st.integers(-32768, 32767)] * 7), min_size=1, max_size=20),
)  # fmt: skip
def test_the_model_is_matrix_times_measured_minus_offset(gyro_matrix, accel_matrix, bias, offset, counts):
    calibration = ImuCalibration(
        gyro_bias_rad_s=bias, gyro_matrix=gyro_matrix, accel_offset_m_s2=offset, accel_matrix=accel_matrix
    )
    out = Calibrate(calibration).process(raw(counts))
    c = np.array(counts, dtype=float)
    gyro = (c[:, 4:] * SCALE.gyro_rad_s_per_lsb - bias) @ np.array(gyro_matrix).T
    accel = (c[:, :3] * SCALE.accel_m_s2_per_lsb - offset) @ np.array(accel_matrix).T
    assert np.allclose(out.gyro_rad_s, gyro, atol=1e-9)
    assert np.allclose(out.accel_m_s2, accel, atol=1e-9)
    assert not out.flags.any()
    assert np.allclose(out.gyro_bias_rad_s, np.array(gyro_matrix) @ bias)


def test_an_empty_block_goes_through():
    assert len(Calibrate(ImuCalibration()).process(raw(np.zeros((0, 7))))) == 0


CURVE = BiasCurve(
    reference_degc=30.0,
    coefficients_rad_s=((0.02, -0.01, 0.03), (0.001, 0.002, -0.001)),
    lowest_degc=20.0,
    highest_degc=40.0,
    sigma_rad_s=1e-3,
    slope_sigma_rad_s_degc=1e-5,
)


def at_temperatures(*temp_degc: float) -> RawBlock:
    counts = np.zeros((len(temp_degc), 7))
    counts[:, 3] = [round((t - 36.53) * 340) for t in temp_degc]
    return raw(counts)


def test_the_bias_over_temperature_is_held_at_its_ends_never_extrapolated():
    out = Calibrate(ImuCalibration(gyro_bias_curve=CURVE)).process(at_temperatures(-10.0, 20.0, 25.0, 30.0, 40.0, 70.0))
    x = [0.01, 0.01, 0.015, 0.02, 0.03, 0.03]
    assert np.allclose(out.gyro_rad_s[:, 0], np.negative(x), atol=2e-6)


def test_a_temperature_without_a_calibration_is_flagged_and_no_other():
    calibration = ImuCalibration(gyro_bias_curve=CURVE, lowest_degc=15.0, highest_degc=45.0)
    out = Calibrate(calibration).process(at_temperatures(14.9, 15.1, 30.0, 44.9, 45.1))
    flagged = (out.flags & Flag.UNCALIBRATED_TEMPERATURE) != 0
    assert flagged.tolist() == [True, False, False, False, True]
    assert not (Calibrate(ImuCalibration()).process(at_temperatures(-40.0, 125.0)).flags & ~Flag.BIAS_UNKNOWN).any()


def test_what_a_force_does_to_the_gyroscope_is_taken_off():
    per_force = ((0.001, 0.0, 0.0), (0.0, 0.002, 0.0), (0.003, 0.0, 0.0))
    counts = np.zeros((1, 7))
    counts[0, :2] = [1000, -2000]
    force = counts[0, :3] * SCALE.accel_m_s2_per_lsb
    out = Calibrate(ImuCalibration(gyro_per_force=per_force)).process(raw(counts))
    assert np.allclose(out.gyro_rad_s[0], -np.array(per_force) @ force)
