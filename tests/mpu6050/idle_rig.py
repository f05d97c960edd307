"""A chip that nobody streams from, for cycle mode and motion: lying still but for pushes."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from hw_fakes import NOISE_ONLY, FakeBus, FakeMpu6050
from hw_fakes.chip import personalities as fakes
from hw_fakes.faults.plan import parse
from hw_fakes.wire.int_line import FakeDataReady
from quavelet.core.clock import VirtualClock
from quavelet.core.health import Health
from quavelet.core.units import NS_PER_S, STANDARD_GRAVITY_M_S2
from quavelet.mpu6050.access import RegisterAccess
from quavelet.mpu6050.int_status import IntStatus
from quavelet.mpu6050.variants import VARIANTS

CHIPS = {chip.name: chip for chip in fakes.PERSONALITIES}
QUIET = replace(NOISE_ONLY, accel_noise_m_s2_rthz=1e-6)
NOT_KEPT = {0x3A, *range(0x3B, 0x49), 0x61, 0x72, 0x73}
"""Registers of results and status."""


@dataclass(frozen=True)
class Pushed:
    """Lies flat; its z shows `push_g` more within each of the intervals."""

    push_g: float = 0.0
    intervals_s: tuple[tuple[float, float], ...] = ()

    def rate_rad_s(self, t_s):
        return np.zeros((len(t_s), 3))

    def specific_force_m_s2(self, t_s):
        pushed = sum(((t_s >= begin) & (t_s < end)).astype(float) for begin, end in self.intervals_s) + np.zeros(
            len(t_s)
        )
        return np.outer(1 + self.push_g * pushed, [0, 0, STANDARD_GRAVITY_M_S2])

    def attitude(self, t_s):
        return np.tile([1.0, 0.0, 0.0, 0.0], (len(t_s), 1))


class IdleRig:
    """The chip, its bus, and access to it; time 0 s of the motion is the clock's 0."""

    def __init__(
        self, name: str = "MPU-6050", *, imperfections: Any = QUIET, motion: Any = None, **kwargs: Any
    ) -> None:
        self.clock = VirtualClock()
        motion = Pushed() if motion is None else motion
        self.chip = FakeMpu6050(
            self.clock, motion=motion, imperfections=imperfections, personality=CHIPS[name], **kwargs
        )
        self.bus = FakeBus({0x68: self.chip}, clock=self.clock, name="fake:idle")
        self.access = RegisterAccess(self.bus, address=0x68, clock=self.clock, health=Health())
        self.variant = VARIANTS[CHIPS[name].who_am_i]
        self.line = FakeDataReady(self.chip, clock=self.clock)

    def status(self) -> IntStatus:
        return IntStatus(self.access)

    def wr(self, register: int, value: int) -> None:
        self.bus.write(0x68, bytes([register, value]))

    def fault(self, text: str) -> None:
        self.bus.adapter.faults.add(parse(text))

    @property
    def now_s(self) -> float:
        return self.clock.now_ns() / NS_PER_S

    @property
    def kept(self) -> dict[int, int]:
        """All registers but those of results."""
        return {at: byte for at, byte in enumerate(self.chip.registers) if at not in NOT_KEPT}
