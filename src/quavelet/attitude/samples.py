"""What the filters that go sample by sample share: rows as plain floats, and the block that comes of them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from quavelet.attitude.kernel import Vector
from quavelet.core.blocks import AttitudeBlock, Flag, FlagArray, FloatArray, ImuBlock
from quavelet.core.units import NS_PER_S


@dataclass(frozen=True, slots=True)
class Sample:
    """One row of an `ImuBlock`; bias is None while it is unknown, accel_clipped says that force lacks its peak."""

    rate: Vector
    force: Vector
    dt: float
    gap_s: float
    still: bool
    stuck: bool
    accel_clipped: bool
    bias: Vector | None
    temp_degc: float


def samples(block: ImuBlock) -> Iterator[Sample]:
    """The rows of `block` in their order."""
    columns = zip(
        block.gyro_rad_s.tolist(),
        block.accel_m_s2.tolist(),
        block.period_s.tolist(),
        block.gap_ns.tolist(),
        block.still.tolist(),
        block.flags.tolist(),
        block.gyro_bias_rad_s.tolist(),
        block.temp_degc.tolist(),
        strict=True,
    )
    stuck, clipped, unknown = int(Flag.STUCK), int(Flag.ACCEL_CLIPPED), int(Flag.BIAS_UNKNOWN)
    for rate, force, dt, gap_ns, still, flags, bias, temp_degc in columns:
        yield Sample(
            rate=tuple(rate),
            force=tuple(force),
            dt=dt,
            gap_s=gap_ns / NS_PER_S,
            still=still,
            stuck=bool(flags & stuck),
            accel_clipped=bool(flags & clipped),
            bias=None if flags & unknown else tuple(bias),
            temp_degc=temp_degc,
        )


def attitude_of(
    block: ImuBlock, *, q: FloatArray, sigma_rad: FloatArray, drift_rad_s: FloatArray, flags: FlagArray
) -> AttitudeBlock:
    """The attitudes q (N, 4) that were found of `block`, of either sign; drift_rad_s (N, 3) is the bias that the filter
    found beyond the block's."""
    return AttitudeBlock(
        t_ns=block.t_ns,
        period_s=block.period_s,
        gap_ns=block.gap_ns,
        flags=flags,
        q=np.where(q[:, :1] < 0.0, -q, q),
        sigma_rad=sigma_rad,
        gyro_rad_s=block.gyro_rad_s - drift_rad_s,
        accel_m_s2=block.accel_m_s2,
        temp_degc=block.temp_degc,
        gyro_bias_rad_s=block.gyro_bias_rad_s + drift_rad_s,
        still=block.still,
    )
