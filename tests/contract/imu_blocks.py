"""Calibrated samples for tests: evenly spaced, without a bias, as flagged."""

from __future__ import annotations

import numpy as np

from quavelet.core.blocks import Flag, ImuBlock


def imu_block(rates, forces, *, period_s: float = 0.01, flags: int = 0, still: bool = False) -> ImuBlock:
    """Samples of these rates and forces (N, 3), rad/s and m/s^2."""
    rates, forces = np.asarray(rates, dtype=float), np.asarray(forces, dtype=float)
    n = len(rates)
    return ImuBlock(
        t_ns=np.round(np.arange(1, n + 1) * period_s * 1e9).astype(np.int64),
        period_s=np.full(n, period_s),
        gap_ns=np.zeros(n, dtype=np.int64),
        flags=np.full(n, flags, dtype=np.uint32),
        gyro_rad_s=rates,
        accel_m_s2=forces,
        temp_degc=np.full(n, 25.0),
        gyro_bias_rad_s=np.zeros((n, 3)),
        still=np.full(n, still),
    )


def level(n: int) -> np.ndarray:
    """The forces of a board that lies level."""
    return np.tile([0.0, 0.0, 9.80665], (n, 1))


def with_gap(data: ImuBlock, start: int, end: int) -> ImuBlock:
    """The block without rows start to end, flagged and measured as the decoder does it."""
    cut = data[[*range(start), *range(end, len(data))]]
    cut.gap_ns[start] = round((end - start) * data.period_s[0] * 1e9)
    cut.flags[start] |= Flag.GAP
    return cut
