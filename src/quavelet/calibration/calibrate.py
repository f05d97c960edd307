"""The stage from counts to SI."""

from __future__ import annotations

import numpy as np

from quavelet.calibration.model import NO_MATRIX, ImuCalibration, MagnetometerCalibration, Matrix
from quavelet.core.blocks import Flag, FloatArray, ImuBlock, RawBlock


class Calibrate:
    """`RawBlock` to `ImuBlock` by an `ImuCalibration`. It has no memory.

    Where the calibration has no constant bias, every sample is flagged BIAS_UNKNOWN, for the stage `StillBias` to
    clear: what a bias over temperature leaves is measured as a whole bias is. The block's `gyro_bias_rad_s` is the
    constant one, in the axes of the rates; what goes with temperature and force is taken off like an error of scale.
    """

    def __init__(self, calibration: ImuCalibration) -> None:
        self.calibration = calibration

    def process(self, block: RawBlock) -> ImuBlock:
        cal, scale = self.calibration, block.scale
        counts = block.counts.astype(np.float64)
        temp_degc = counts[:, 3] * scale.temp_degc_per_lsb + scale.temp_degc_at_zero
        bias = cal.gyro_bias_rad_s
        unknown = np.uint32(Flag.BIAS_UNKNOWN if bias is None else 0)
        outside = (temp_degc < cal.lowest_degc) | (temp_degc > cal.highest_degc)
        strange = np.where(outside, np.uint32(Flag.UNCALIBRATED_TEMPERATURE), np.uint32(0))
        offset = np.tile(np.array(bias or (0.0, 0.0, 0.0)), (len(block), 1))
        accel = counts[:, 0:3] * scale.accel_m_s2_per_lsb - np.array(cal.accel_offset_m_s2)
        accel = _product(cal.accel_matrix, accel)
        gyro = counts[:, 4:7] * scale.gyro_rad_s_per_lsb - offset
        if cal.gyro_bias_curve is not None:
            gyro = gyro - cal.gyro_bias_curve.at(temp_degc)
        if cal.gyro_per_force != NO_MATRIX:
            gyro = gyro - _product(cal.gyro_per_force, accel)
        return ImuBlock(
            t_ns=block.t_ns,
            period_s=block.period_s,
            gap_ns=block.gap_ns,
            flags=block.flags | unknown | strange,
            gyro_rad_s=_product(cal.gyro_matrix, gyro),
            accel_m_s2=accel,
            temp_degc=temp_degc,
            gyro_bias_rad_s=_product(cal.gyro_matrix, offset),
            still=np.zeros(len(block), dtype=np.bool_),
            field_ut=block.field_ut if cal.magnetometer is None else _field_ut(cal.magnetometer, block.field_ut),
        )

    def state(self) -> None:
        return None

    def restore(self, state: None) -> None:
        del state


def _field_ut(magnetometer: MagnetometerCalibration, field_ut: FloatArray) -> FloatArray:
    return _product(magnetometer.soft_iron, field_ut - np.array(magnetometer.hard_iron_ut))


def _product(matrix: Matrix, rows: FloatArray) -> FloatArray:
    """matrix times each row (N, 3), written out: a matrix product may round differently by the block's length."""
    x, y, z = rows.T
    return np.stack([row[0] * x + row[1] * y + row[2] * z for row in matrix], axis=1)
