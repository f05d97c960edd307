"""An `Imu` that runs for a while on its own clock."""

from __future__ import annotations

from quavelet.core.blocks import AttitudeBlock, concat
from quavelet.core.units import NS_PER_S
from quavelet.imu import Imu


def run_for(imu: Imu, seconds: float) -> AttitudeBlock:
    """All samples of the next seconds."""
    blocks = []
    for _ in imu.loop.deadlines(imu.clock.now_ns() + round(seconds * NS_PER_S)):
        block = imu.read()
        if block is not None and len(block):
            blocks.append(block)
    return concat(blocks)
