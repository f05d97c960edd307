"""A service on a fake chip in virtual time, with things that happen at set times, and all it tells systemd."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import ExitStack
from pathlib import Path

from hw_fakes import FakeBus, FakeMpu6050, Motion, Still
from hw_fakes.faults.plan import parse
from hw_fakes.target import Target
from quavelet.core.clock import Clock, VirtualClock
from quavelet.core.errors import DeviceMissing
from quavelet.core.units import NS_PER_S
from quavelet.core.wall_clock import WallNs
from quavelet.service.notify import Notify
from quavelet.service.service import STDOUT, Service
from quavelet.settings import BusSettings, ServiceSettings, Settings
from quavelet.sinks.message import Message

WATCHDOG_S = 10


class EventClock(VirtualClock):
    """Does what is planned as its time comes."""

    def __init__(self, start_s: float = 0.0) -> None:
        super().__init__(round(start_s * NS_PER_S))
        self.events: list[tuple[int, Callable[[], None]]] = []

    def at(self, t_s: float, what: Callable[[], None]) -> None:
        self.events.append((round(t_s * NS_PER_S), what))
        self.events.sort(key=lambda event: event[0])

    def sleep_until_ns(self, t_ns: int) -> None:
        while self.events and self.events[0][0] <= t_ns:
            due_ns, what = self.events.pop(0)
            super().sleep_until_ns(due_ns)
            what()
        super().sleep_until_ns(t_ns)


class Heard(Notify):
    """What would go to systemd, with its times in s; while `deaf` nothing can be sent."""

    def __init__(self, clock: Clock) -> None:
        super().__init__(watchdog_us=WATCHDOG_S * 1_000_000)
        self.told: list[tuple[float, dict[str, str | int]]] = []
        self.deaf = False
        self._clock = clock

    @property
    def wanted(self) -> bool:
        return True

    def send(self, **fields: str | int) -> bool:
        if not self.deaf:
            self.told.append((self._clock.now_ns() / NS_PER_S, fields))
        return not self.deaf

    def times(self, name: str) -> list[float]:
        return [t_s for t_s, fields in self.told if name in fields]

    @property
    def statuses(self) -> list[str]:
        return [str(fields["STATUS"]) for _, fields in self.told if "STATUS" in fields]


class Kept:
    """A sink that keeps what it gets, where `counts_only` the newest alone; it leaves after `most`."""

    def __init__(self, most: int = 1 << 30, *, counts_only: bool = False) -> None:
        self.messages: list[Message] = []
        self.count = 0
        self.closed = False
        self._most = most
        self._counts_only = counts_only

    def write(self, message: Message) -> None:
        if self.count == self._most:
            raise BrokenPipeError
        self.count += 1
        if self._counts_only:
            self.messages.clear()
        self.messages.append(message)

    def close(self) -> None:
        self.closed = True


class Bed:
    """One chip, one service; `plugged` says whether there is such a bus at all, `wired` whether the chip is on it."""

    def __init__(
        self,
        motion: Motion | None = None,
        *,
        settings: Settings | None = None,
        wait: bool = False,
        most: int = 1 << 30,
        record: Path | None = None,
        load: Callable[[], Settings] | None = None,
        clock: EventClock | None = None,
        accel_trim: tuple[int, int, int] = (100, -200, 300),
        environ: Mapping[str, str] | None = None,
        counts_only: bool = False,
        wall_ns: WallNs | None = None,
    ) -> None:
        self.clock = clock or EventClock()
        self.said: list[str] = []
        self.kept = Kept(most, counts_only=counts_only)
        self.heard = Heard(self.clock)
        self.chip = FakeMpu6050(
            self.clock, motion=motion or Still(roll_deg=5.0, pitch_deg=-3.0), seed=1, accel_trim=accel_trim
        )
        self.beside: dict[int, Target] = {}
        """What else is on the bus."""
        self.plugged = self.wired = True
        self.bus: FakeBus | None = None
        self.service = Service(
            settings or Settings(bus=BusSettings(name="fake:bed"), service=ServiceSettings(wait_for_device=wait)),
            clock=self.clock,
            talk=self.said.append,
            console=self._console,
            record=record,
            realtime=False,
            notify=self.heard,
            load=load,
            opened=self._open,
            environ=environ,
            wall_ns=wall_ns,
        )

    def fault(self, text: str) -> None:
        """Let it happen now."""
        assert self.bus is not None
        self.bus.adapter.faults.add(parse(text))

    def run(self, until_s: float) -> None:
        self.service.run(until_ns=round(until_s * NS_PER_S))

    @property
    def messages(self) -> list[Message]:
        return self.kept.messages

    def _open(self, name: str, clock: Clock) -> FakeBus:
        if not self.plugged:
            raise DeviceMissing("there is no bus fake:bed: plug it in")
        self.bus = FakeBus({0x68: self.chip, **self.beside} if self.wired else {}, clock=clock, name=name)
        return self.bus

    def _console(self, service: Service, stack: ExitStack) -> None:
        del stack
        service.messages.subscribe(STDOUT, self.kept, policy=service.policy)
