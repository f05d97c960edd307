"""The stage from counts to SI."""

from __future__ import annotations

import numpy as np

from quavelet.calibration.model import ImuCalibration, Matrix, Vector
from quavelet.core.blocks import Flag, FloatArray, ImuBlock, RawBlock


class Calibrate:
    """`RawBlock` to `ImuBlock` by an `ImuCalibration`. It has no memory.

    Where the calibration knows no gyroscope bias the rate keeps its bias and every sample is flagged
    BIAS_UNKNOWN, for the stage `StillBias` to clear.
    """

    def __init__(self, calibration: ImuCalibration) -> None:
        self.calibration = calibration

    def process(self, block: RawBlock) -> ImuBlock:
        cal, scale = self.calibration, block.scale
        counts = block.counts.astype(np.float64)
        bias = cal.gyro_bias_rad_s
        unknown = np.uint32(Flag.BIAS_UNKNOWN if bias is None else 0)
        offset = bias or (0.0, 0.0, 0.0)
        return ImuBlock(
            t_ns=block.t_ns,
            period_s=block.period_s,
            gap_ns=block.gap_ns,
            flags=block.flags | unknown,
            gyro_rad_s=_corrected(counts[:, 4:7] * scale.gyro_rad_s_per_lsb, cal.gyro_matrix, offset),
            accel_m_s2=_corrected(counts[:, 0:3] * scale.accel_m_s2_per_lsb, cal.accel_matrix, cal.accel_offset_m_s2),
            temp_degc=counts[:, 3] * scale.temp_degc_per_lsb + scale.temp_degc_at_zero,
            gyro_bias_rad_s=np.tile(np.array(offset), (len(block), 1)),
            still=np.zeros(len(block), dtype=np.bool_),
        )

    def state(self) -> None:
        return None

    def restore(self, state: None) -> None:
        del state


def _corrected(measured: FloatArray, matrix: Matrix, offset: Vector) -> FloatArray:
    """matrix (measured - offset), written out: a matrix product may round differently by the block's length."""
    x, y, z = (measured[:, i] - offset[i] for i in range(3))
    return np.stack([row[0] * x + row[1] * y + row[2] * z for row in matrix], axis=1)
