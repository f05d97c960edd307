"""A service in virtual time whose fault ability sees every message and looks at the counters each millisecond."""

from __future__ import annotations

import sys
from contextlib import ExitStack
from pathlib import Path

from hw_fakes import NOISE_ONLY, FakeBus, FakeMpu6050, Motion, Tilt
from quavelet.core.clock import VirtualClock
from quavelet.core.units import NS_PER_MS, NS_PER_S
from quavelet.service.service import Service
from quavelet.settings import BusSettings, Settings
from quavelet.sinks.message import Message
from quavelet.web.fault_case import FaultTold
from quavelet.web.faults import Faults

# For its matrix of faults, which knows them by the driver itself.
sys.path.append(str(Path(__file__).resolve().parents[1] / "faults"))


class LookingClock(VirtualClock):
    """Before each millisecond that passes while somebody sleeps, `each_ms` is called."""

    def __init__(self) -> None:
        super().__init__()
        self.each_ms = lambda: None

    def sleep_until_ns(self, t_ns: int) -> None:
        while self.now_ns() + NS_PER_MS < t_ns:
            super().sleep_until_ns(self.now_ns() + NS_PER_MS)
            self.each_ms()
        super().sleep_until_ns(t_ns)


class FaultBed:
    """The first fault is injected at `at_s`, each other a second after all is well again, and then the run ends."""

    def __init__(self, motion: Motion | None = None, *, at_s: float = 4.5) -> None:
        self.clock = LookingClock()
        chip = FakeMpu6050(
            self.clock, motion=motion or Tilt(start_s=3.0), imperfections=NOISE_ONLY, pll_error=0.01, seed=1
        )
        self.bus = FakeBus({0x68: chip}, clock=self.clock, name="fake:faults")
        self.service = Service(
            Settings(bus=BusSettings(name="fake:faults")),
            clock=self.clock,
            talk=lambda _text: None,
            console=self._console,
            realtime=False,
            opened=lambda _name, _clock: self.bus,
        )
        self.ability = Faults(
            bus=lambda: self.service.imu.bus if self.service.imu else None,
            counters=lambda: self.service.imu.health.as_dict() if self.service.imu else {},
            clock=self.clock,
            look_s=0.0,
        )
        self.clock.each_ms = self._each_ms
        self._waiting: list[str] = []
        self._next_ns = round(at_s * NS_PER_S)

    def inject(self, *names: str) -> list[FaultTold]:
        """Run the whole service with these faults in it, one after the other; what is told of them."""
        self._waiting = list(names)
        self.service.run(until_ns=120 * NS_PER_S)
        return list(self.ability.state().history)

    def _each_ms(self) -> None:
        now_ns = self.clock.now_ns()
        if self.ability.look():
            self._next_ns = now_ns + NS_PER_S
        elif not self._waiting:
            self.service.stop()
        elif now_ns >= self._next_ns:
            self.ability.do("inject", {"name": self._waiting.pop(0)})

    def _console(self, service: Service, stack: ExitStack) -> None:
        del stack
        # One that is looked at before the next is made, as nearly as a thread of its own allows.
        service.messages.subscribe("page", self, depth=1, policy=service.policy)

    def write(self, message: Message) -> None:
        self.ability.see(message)

    def close(self) -> None:
        self.ability.close()
