"""A whole session on a fake bus in virtual time: every drain through the driver and the pipeline."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hw_fakes import FakeBus
from quavelet.core.blocks import AttitudeBlock, RawBlock, concat
from quavelet.core.clock import VirtualClock
from quavelet.core.quaternion import inclination_between
from quavelet.core.units import NS_PER_S
from quavelet.imu import Imu
from quavelet.settings import Settings


@dataclass
class Session:
    """What came out, and the parts it came from."""

    raw: RawBlock
    attitude: AttitudeBlock
    imu: Imu

    @property
    def chip(self):
        return self.imu.bus.targets[self.imu.settings.bus.address]

    def world_s(self) -> np.ndarray:
        """The motion's time of each sample."""
        return np.array([self.chip.world_time_s(int(t)) for t in self.attitude.t_ns])

    def truth(self) -> np.ndarray:
        """The true attitude at each sample's time (N, 4)."""
        return self.chip.motion.attitude(self.world_s())

    def tilt_error_deg(self) -> np.ndarray:
        """The angle between true and found vertical at each sample."""
        return np.degrees(inclination_between(self.truth(), self.attitude.q))


def run_session(bus: FakeBus, clock: VirtualClock, settings: Settings, *, seconds: float | None) -> Session:
    """Run until `seconds` have passed, or until the bus has no more to give where that is None."""
    imu = Imu(bus, settings=settings, clock=clock)
    raws, attitudes = [], []
    until_ns = None if seconds is None else clock.now_ns() + round(seconds * NS_PER_S)
    process = imu.pipeline.process

    def keeping(raw: RawBlock) -> AttitudeBlock:
        block = process(raw)
        if len(raw):
            raws.append(raw)
            attitudes.append(block)
        return block

    imu.pipeline.process = keeping
    for _ in imu.messages(until_ns=until_ns):
        pass
    return Session(concat(raws), concat(attitudes), imu)
