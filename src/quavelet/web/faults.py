"""The ability "fault": lets something go wrong on a fake bus, and measures when it is noticed and when all is well."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable, Mapping

import msgspec

from quavelet.bus.protocol import FailsOnOrder, OfferedFault
from quavelet.core.clock import Clock
from quavelet.core.errors import SettingsError
from quavelet.sinks.message import Four, Message
from quavelet.web.fault_case import USUAL, FaultCase, FaultTold

KEPT = 50
BEFORE = 100
"""Messages of about a second."""
LOOK_S = 0.002


class FaultsAbout(msgspec.Struct, frozen=True, kw_only=True):
    """The faults that are offered; none before the chip has answered, or where the bus is a real one."""

    faults: tuple[OfferedFault, ...]


class FaultsState(msgspec.Struct, frozen=True, kw_only=True):
    """history has the newest last; lasting the titles of those that are not over; counters those of trouble that are
    not 0."""

    history: tuple[FaultTold, ...]
    lasting: tuple[str, ...]
    counters: dict[str, int]


class Faults:
    """An `Ability`. One fault at a time, so that each sign is of the one that is told.

    bus         at this moment; None before it is open
    counters    those of `Health` by name
    clock       of the bus and the messages
    compare     whether the attitude is that of the chip's own axes, to be compared with the truth
    look_s      how often the counters are looked at while a fault is under way; with 0 whoever made it calls `look`
    """

    name = "fault"

    def __init__(
        self,
        *,
        bus: Callable[[], object],
        counters: Callable[[], Mapping[str, int]],
        clock: Clock,
        compare: bool = True,
        look_s: float = LOOK_S,
    ) -> None:
        self._bus = bus
        self._counters = counters
        self._clock = clock
        self._compare = compare
        self._look_s = look_s
        self._lock = threading.Lock()
        self._closed = threading.Event()
        self._thread: threading.Thread | None = None
        self._case: FaultCase | None = None
        self._told: deque[FaultTold] = deque(maxlen=KEPT)
        self._asked = 0
        self._flags: list[str] = []
        self._attitudes: deque[tuple[int, Four]] = deque(maxlen=BEFORE)

    def about(self) -> FaultsAbout:
        bus = self._bus()
        return FaultsAbout(faults=tuple(bus.faults()) if isinstance(bus, FailsOnOrder) else ())

    def state(self) -> FaultsState:
        with self._lock:
            case = self._case.told() if self._case else None
            history = tuple(self._told)
        return FaultsState(
            history=history if case is None else (*history, case),
            lasting=(case.title,) if case is not None and case.lasted_ms is None else (),
            counters={name: n for name, n in self._counters().items() if n and name not in USUAL},
        )

    def see(self, message: Message) -> None:
        with self._lock:
            self._flags = message.flags
            self._attitudes.append((message.t_ns, message.q))
            if self._case is not None:
                self._case.see(message, now_ns=self._clock.now_ns())

    def do(self, what: str, values: Mapping[str, object]) -> str:
        """ "inject" with the `name` of one that is offered. Raises SettingsError."""
        if what != "inject":
            raise SettingsError("a fault can be injected, and no more: ask for inject")
        bus = self._bus()
        if not isinstance(bus, FailsOnOrder):
            raise SettingsError("nothing can be made to go wrong here: wait for the chip, or take a fake bus")
        fault = next((one for one in bus.faults() if one.name == values.get("name")), None)
        if fault is None:
            raise SettingsError(f"there is no such fault: take one of {', '.join(one.name for one in bus.faults())}")
        with self._lock:
            if self._closed.is_set() or self._case is not None:
                raise SettingsError("the fault before is not over yet: wait until all is well")
            self._asked += 1
            self._case = FaultCase(
                self._asked,
                fault,
                now_ns=self._clock.now_ns(),
                flags=self._flags,
                counters=self._counters(),
                attitudes=self._attitudes,
                order=bus.fail(fault.text),
            )
        if self._look_s:
            self._thread = threading.Thread(target=self._keep_looking, name="fault", daemon=True)
            self._thread.start()
        return f"{fault.title}: done"

    def look(self) -> bool:
        """See what has become of the fault under way; False where there is none."""
        with self._lock:
            case, bus = self._case, self._bus()
            if case is None or not isinstance(bus, FailsOnOrder):
                return case is not None
            # The counters first: a sign of the fault is then never older than its beginning.
            counters, now_ns = self._counters(), self._clock.now_ns()
            case.look(counters, next((one for one in bus.ordered() if one.n == case.order), None), now_ns=now_ns)
            if not case.over:
                return True
            if self._compare:
                case.measure(bus)
            self._told.append(case.told())
            self._case = None
            return False

    def close(self) -> None:
        self._closed.set()
        if self._thread is not None:
            self._thread.join(1.0)

    def _keep_looking(self) -> None:
        while self.look() and not self._closed.wait(self._look_s):
            pass
