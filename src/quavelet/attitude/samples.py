"""The rows of a block as plain floats, for the filters that go sample by sample."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from quavelet.attitude.kernel import Vector
from quavelet.core.blocks import Flag, ImuBlock
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
