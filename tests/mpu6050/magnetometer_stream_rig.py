"""A source on a board whose magnetometer's bytes stand in the FIFO's frames."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from chip_rig import ADDRESS, Rig, WatchedBus, config
from chip_rig import NumberedSamples as NumberedSamples
from magnetometer_rig import NOISY, lying
from numpy.typing import NDArray

from hw_fakes import NOISE_ONLY, FakeBus, FakeMpu6050, board
from hw_fakes.magnetometers.base import Magnetometer, MagnetometerImperfections
from hw_fakes.wire.int_line import FakeDataReady
from hw_fakes.world.motion_base import Motion
from quavelet.core.clock import VirtualClock
from quavelet.core.health import Health
from quavelet.core.units import NS_PER_S
from quavelet.mpu6050.drain import Drain
from quavelet.mpu6050.magnetometer.asked import MagnetometerParams
from quavelet.mpu6050.source import ChipSource
from quavelet.mpu6050.stream import StreamInfo


class MagStreamRig(Rig):
    """As `Rig`; where no motion of the chip's own is asked for, its frames name their own sample."""

    def __init__(
        self,
        name: str,
        *,
        motion: Motion | None = None,
        moves: bool = False,
        imperfections: MagnetometerImperfections = NOISY,
        rate_hz: float = 200.0,
        params: MagnetometerParams | None = None,
        speed_hz: int = 400_000,
        wired: bool = False,
    ) -> None:
        self.clock = VirtualClock(5 * NS_PER_S)
        self.samples = NumberedSamples()
        self.motion = motion or lying()
        self.birth_ns = self.clock.now_ns()
        bought = board(name)
        self.aux = bought.aux_master(self.clock, self.motion, imperfections=imperfections)
        self.chip = FakeMpu6050(
            self.clock,
            personality=bought.personality,
            aux=self.aux,
            pll_error=0.004,
            **({"motion": self.motion, "imperfections": NOISE_ONLY} if moves else {"source": self.samples}),
        )
        self.fake_bus = FakeBus({ADDRESS: self.chip, **self.aux.outside()}, clock=self.clock, speed_hz=speed_hz)
        self.line = FakeDataReady(self.chip, clock=self.clock) if wired else None
        self.bus = WatchedBus(self.fake_bus)
        self.health = Health()
        self.config = config(rate_hz)
        self.params = params or MagnetometerParams(use="auto")
        self.infos: list[StreamInfo] = []
        self.drains: list[Drain] = []
        self.source = self.new_source()
        self.blocks = []

    def new_source(self) -> ChipSource:
        return ChipSource(
            self.bus,
            address=ADDRESS,
            config=self.config,
            clock=self.clock,
            health=self.health,
            magnetometer=self.params,
            line=self.line,
            on_stream=self.infos.append,
            on_drain=self.drains.append,
        )

    @property
    def magnetometer(self) -> Magnetometer:
        """The fake magnetometer itself."""
        (target,) = self.aux.targets.values()
        assert isinstance(target, Magnetometer)
        return target

    def unplug(self) -> Callable[[], None]:
        """The magnetometer's wires come off; what is given puts them back, its supply with them."""
        aux, outside = dict(self.aux.targets), {a: t for a, t in self.fake_bus.targets.items() if a != ADDRESS}
        magnetometer = self.magnetometer
        self.aux.targets.clear()
        for address in outside:
            del self.fake_bus.targets[address]

        def back() -> None:
            magnetometer.power_cut()
            self.aux.targets.update(aux)
            self.fake_bus.targets.update(outside)

        return back

    def true_ut(self, t_ns: NDArray[np.int64]) -> NDArray[np.float64]:
        """The field (N, 3) in the body frame at these times."""
        field: NDArray[np.float64] = self.motion.magnetic_field_ut((t_ns - self.birth_ns) / NS_PER_S)
        return field

    def fields(self, since: int = 0) -> NDArray[np.float64]:
        """The measurements (M, 3) from the row `since` on."""
        field_ut = self.got.field_ut[since:]
        return field_ut[~np.isnan(field_ut[:, 0])]
