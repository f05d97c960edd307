"""Faults that somebody on another thread orders: taken up, and followed, by the thread that makes the transfers."""

from __future__ import annotations

from collections import deque
from dataclasses import replace
from itertools import count, takewhile

from hw_fakes.faults.base import Happened
from hw_fakes.faults.engine import Faults
from hw_fakes.faults.of_chip import ChipFault
from hw_fakes.faults.plan import FaultEntry, parse
from quavelet.bus.protocol import OrderedFault
from quavelet.core.clock import Clock
from quavelet.core.errors import SettingsError
from quavelet.core.units import NS_PER_S

KEPT = 100


class Orders:
    """No lock is shared with the transfers: orders wait in a queue, what became of them is a tuple that is replaced."""

    def __init__(self, faults: Faults, *, clock: Clock) -> None:
        self.seen: tuple[OrderedFault, ...] = ()
        self._faults = faults
        self._clock = clock
        self._numbers = count(1)
        self._waiting: deque[tuple[int, FaultEntry]] = deque()
        self._open: dict[int, tuple[FaultEntry, int]] = {}
        self._last: Happened | None = None

    def order(self, text: str) -> int:
        """To be taken up by the next transfer; its number. Raises SettingsError as `FailsOnOrder.fail`."""
        entry = parse(text)
        if not (entry.at_s is entry.every_s is entry.p is entry.per_minute is None):
            raise SettingsError(f"'{text}' is not for now: leave at, every, p and per_minute out")
        try:
            self._faults.check_there(entry)
        except ValueError as error:
            raise SettingsError(str(error)) from None
        n = next(self._numbers)
        self._waiting.append((n, entry))
        return n

    @property
    def busy(self) -> bool:
        """Whether an order waits or is not over; each transfer asks."""
        return bool(self._waiting or self._open)

    def take_up(self) -> None:
        """Before a transfer."""
        while self._waiting:
            n, entry = self._waiting.popleft()
            if not self._open:
                self._last = self._faults.history[-1] if self._faults.history else None
            self._open[n] = entry, self._clock.now_ns()
            self.seen = (*self.seen[-KEPT + 1 :], OrderedFault(n, str(entry)))
            self._faults.add(entry)

    def follow(self) -> None:
        """After a transfer."""
        history, last = self._faults.history, self._last
        fresh = list(takewhile(lambda it: it is not last, reversed(history)))[::-1]
        self._last = history[-1] if history else None
        self.seen = tuple(self._followed(one, fresh) if one.n in self._open else one for one in self.seen)

    def _followed(self, one: OrderedFault, fresh: list[Happened]) -> OrderedFault:
        entry, from_ns = self._open[one.n]
        own = [it for it in fresh if it.kind is entry.kind]
        if own and one.began_ns is None:
            one = replace(one, began_ns=own[0].t_ns)
        if not self._faults.is_over(entry):
            return one
        del self._open[one.n]
        if isinstance(entry.kind, ChipFault):
            return replace(one, ended_ns=own[-1].t_ns if own else self._clock.now_ns())
        planned_ns = from_ns + round((entry.for_s or 0.0) * NS_PER_S)
        return replace(one, ended_ns=planned_ns if entry.for_s is not None else self._clock.now_ns())
