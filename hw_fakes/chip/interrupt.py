"""The INT pin: its level, and when it changed (RM registers 55, 56 and 58)."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass, replace

from hw_fakes.chip import registers as reg
from hw_fakes.chip.samples import Run

PULSE_NS = 50_000
_KEPT = 1024


@dataclass(frozen=True, slots=True)
class Edge:
    """The pin changed at `t_ns`; it has been `high` since."""

    t_ns: int
    high: bool


@dataclass(frozen=True, slots=True)
class _Pulses:
    """Even pulses, number `first` up to `end`; those begun or still lasting at `cut_ns` end there.

    Pulse n = 0, 1, ... begins n + 1 periods, each of `divider` ticks, after the start. None lasts longer than half a
    period: at 32 kHz, which the 6500 class can do, 50 us would run into the next.
    """

    start_ns: int
    tick_ns: float
    divider: int
    first: int
    end: int
    active_high: bool
    cut_ns: int | None = None

    def begin_ns(self, n: int) -> int:
        return self.start_ns + math.ceil((n + 1) * self.divider * self.tick_ns)

    @property
    def lasts_ns(self) -> int:
        period_ns = self.divider * self.tick_ns
        return min(PULSE_NS, int(period_ns / 2)) if period_ns else PULSE_NS

    def edges(self, since_ns: int, now_ns: int) -> Iterator[Edge]:
        first, lasts_ns = self.first, self.lasts_ns
        if self.tick_ns:
            first = max(first, int((since_ns - PULSE_NS - self.start_ns) / (self.tick_ns * self.divider)) - 1)
        until_ns = now_ns if self.cut_ns is None else min(self.cut_ns, now_ns)
        for n in range(first, self.end):
            begin_ns = self.begin_ns(n)
            yield Edge(begin_ns, self.active_high)
            if begin_ns + lasts_ns <= until_ns or self.cut_ns is not None:
                yield Edge(min(begin_ns + lasts_ns, until_ns), not self.active_high)


class IntPin:
    """The pin with its history: even pulses are kept as one entry, so hours of them take no room.

    Push-pull or open drain is the same here: the board is taken to have the pull-up that open drain needs. Latched, the
    pin is active while INT_STATUS and INT_ENABLE have a bit in common; otherwise each event gives a pulse.
    """

    def __init__(self) -> None:
        self._history: deque[Edge | _Pulses] = deque(maxlen=_KEPT)
        self._config = 0
        self._enabled = 0
        self._high = False  # between pulses
        self.connected = True

    def follow(self, registers: bytes | bytearray, now_ns: int) -> None:
        """Take over the three registers as they are at `now_ns`."""
        config, enabled = registers[reg.INT_PIN_CFG], registers[reg.INT_ENABLE]
        if (config, enabled) != (self._config, self._enabled):
            last = self._history[-1] if self._history else None
            if isinstance(last, _Pulses) and last.cut_ns is None and self._in_pulse(now_ns):
                self._history[-1] = replace(last, cut_ns=now_ns)
            self._config, self._enabled = config, enabled
        self._settle(now_ns, status=registers[reg.INT_STATUS])

    def sampled(self, run: Run, first: int, end: int, overflow: int) -> None:
        """Samples `first` up to `end` of a run fell; from `overflow` on the FIFO lost bytes for them."""
        if not self.connected:
            return
        if self._enabled & reg.DATA_RDY_INT:
            begin = first
        elif self._enabled & reg.FIFO_OFLOW_INT:
            begin = max(first, overflow)
        else:
            return
        if begin >= end:
            return
        pulses = _Pulses(run.start_ns, run.tick_ns, run.divider, begin, end, self._active_high)
        if self._config & reg.LATCH_INT_EN:
            self._latch(pulses.begin_ns(begin))
        else:
            self._append(pulses)

    def happened(self, interrupt: int, t_ns: int) -> None:
        """Something that sets this bit of INT_STATUS happened by itself at `t_ns`, not before what came earlier."""
        if not (self.connected and self._enabled & interrupt):
            return
        if self._config & reg.LATCH_INT_EN:
            self._latch(t_ns)
        elif not self._in_pulse(t_ns):
            self._append(_Pulses(t_ns, 0.0, 1, 0, 1, self._active_high))

    def high(self, now_ns: int) -> bool:
        """Whether the pin's level is high."""
        return self._high != self._in_pulse(now_ns)

    def edges(self, since_ns: int, now_ns: int) -> list[Edge]:
        """All changes from `since_ns` to `now_ns`, oldest first, as far as the history goes back."""
        found: list[Edge] = []
        for entry in self._history:
            for edge in (entry,) if isinstance(entry, Edge) else entry.edges(since_ns, now_ns):
                if found and found[-1].t_ns == edge.t_ns:
                    found.pop()  # there and back in no time
                elif since_ns <= edge.t_ns <= now_ns:
                    found.append(edge)
        return found

    @property
    def _active_high(self) -> bool:
        return not self._config & reg.INT_LEVEL

    def _settle(self, t_ns: int, *, status: int) -> None:
        active = bool(self.connected and self._config & reg.LATCH_INT_EN and status & self._enabled)
        high = active == self._active_high
        if high != self._high:
            self._high = high
            self._history.append(Edge(t_ns, high))

    def _latch(self, t_ns: int) -> None:
        last = self._history[-1] if self._history else None
        # What falls within a transaction shows in the status, and so at the pin, only once that is over.
        earliest_ns = last.t_ns if isinstance(last, Edge) else 0
        self._settle(max(t_ns, earliest_ns), status=self._enabled)

    def _in_pulse(self, now_ns: int) -> bool:
        last = self._history[-1] if self._history else None
        if not isinstance(last, _Pulses) or last.cut_ns is not None:
            return False
        return now_ns < last.begin_ns(last.end - 1) + last.lasts_ns

    def _append(self, pulses: _Pulses) -> None:
        last = self._history[-1] if self._history else None
        if isinstance(last, _Pulses) and last == replace(pulses, first=last.first, end=pulses.first):
            self._history[-1] = replace(last, end=pulses.end)
        else:
            self._history.append(pulses)
