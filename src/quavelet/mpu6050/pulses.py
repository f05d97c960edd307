"""Which sample a pulse of the data-ready line belongs to, and whether pulses come at all.

The line numbers its pulses, and the chip takes samples whether anybody reads them or not: so sample number less pulse
number stays the same over every gap in which the chip samples on. It is found where the count leaves no doubt, and
anew where pulses are no longer where the time base has their samples: the chip was reset, or the wire was off.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from quavelet.bus.protocol import Edge
from quavelet.core.health import Health
from quavelet.core.units import NS_PER_MS, NS_PER_S
from quavelet.mpu6050.drain import Drain
from quavelet.mpu6050.timebase import BOUND, FIT_PERIODS, TimeBase

CLEAR_PERIODS = 0.15
"""So far from any pulse nobody doubts which samples a count holds."""
CLEAR_NS = 200_000
"""Where that is less it is enough to begin with: no interrupt is later, and a loop in step with the chip may never come
farther from one."""
MISSED_NS = 100 * NS_PER_MS
"""Samples without a pulse for so long, or for two periods where that is longer, are timed by counts again."""


@dataclass(frozen=True, slots=True)
class PulseState:
    """All memory.

    last       the newest edge heard
    even       it came a period after the one before: the wire carries pulses, and not what motors spread
    offset     number of a sample less that of its pulse, None where it is not known
    misfits    drains one after the other whose newest pulse was not where the time base has its sample
    unequal    clear drains one after the other whose count is not what the pulses make it
    pulse_ns   host time of the newest even pulse, or of the first samples; -1 before
    missed     pulses are out
    """

    last: Edge | None = None
    even: bool = False
    offset: int | None = None
    misfits: int = 0
    unequal: int = 0
    pulse_ns: int = -1
    missed: bool = False


class Pulses:
    """Tells a time base of the pulses whose samples are known."""

    def __init__(self, timebase: TimeBase, *, health: Health) -> None:
        self._timebase = timebase
        self._health = health
        self._known: tuple[Edge, ...] = ()
        self._s = PulseState()

    def state(self) -> PulseState:
        return self._s

    def restore(self, state: PulseState) -> None:
        self._s = state

    @property
    def in_use(self) -> bool:
        """Whether samples are timed by them."""
        return self._s.offset is not None and not self._s.missed

    def hear(self, edges: tuple[Edge, ...], *, gap: bool) -> None:
        """The edges of a drain, oldest first; `gap` where samples were lost since the drain before."""
        s = self._s
        self._known = edges if s.last is None else (s.last, *edges)
        if not edges:
            return
        newest, even = edges[-1], len(self._known) > 1 and self._is_period(*self._known[-2:])
        s = replace(s, last=newest, even=even)
        if even:
            s = replace(s, pulse_ns=newest.t_ns, missed=False)
            if s.offset is not None:
                n = newest.seq + s.offset
                if self._timebase.fits(n, newest.t_ns):
                    self._tell(n, newest)
                    s = replace(s, misfits=0)
                elif gap or s.misfits:
                    s = replace(s, offset=None, misfits=0)
                else:
                    s = replace(s, misfits=1)
        self._s = s

    def match(self, taken: int, drain: Drain) -> bool:
        """Where it is not known: find which sample is whose, by a count of `taken` samples in all. Whether it was."""
        s = self._s
        if s.offset is not None or not s.even:
            return False
        edge = self._newest_in_count(drain, clear_ns=min(CLEAR_PERIODS * self._period_ns, CLEAR_NS))
        if edge is None:
            return False
        self._s = replace(s, offset=taken - edge.seq, unequal=0)
        self._tell(taken, edge, anew=True)
        return True

    def vanished(self, taken: int, drain: Drain) -> bool:
        """Whether fewer samples than pulses have come, as where whole frames vanish from the FIFO. Where there were
        more, what was known of the pulses was wrong."""
        s = self._s
        edge = self._newest_in_count(drain, clear_ns=CLEAR_PERIODS * self._period_ns)
        if edge is None or s.offset is None or s.misfits:
            return False
        missing = edge.seq + s.offset - taken
        if missing and s.unequal:
            self._s = replace(s, unequal=0, offset=s.offset if missing > 0 else None)
            return missing > 0
        self._s = replace(s, unequal=int(missing != 0))
        return False

    def expect(self, now_ns: int) -> None:
        """Samples have come, and so must pulses."""
        s = self._s
        if s.pulse_ns < 0:
            self._s = replace(s, pulse_ns=now_ns)
        elif not s.missed and now_ns - s.pulse_ns > max(MISSED_NS, 2 * self._period_ns):
            self._health.data_ready_missed += 1
            self._s = replace(s, missed=True)

    def _newest_in_count(self, drain: Drain, *, clear_ns: float) -> Edge | None:
        """The pulse of the newest sample that the drain's count holds, where none came close to it."""
        edge = next((edge for edge in reversed(self._known) if edge.t_ns <= drain.after_ns), None)
        if edge is None or drain.before_ns - edge.t_ns < clear_ns:
            return None
        return edge if drain.after_ns - edge.t_ns <= self._period_ns - clear_ns else None

    def _tell(self, n: int, edge: Edge, *, anew: bool = False) -> None:
        if not self._timebase.observe_edge(n, edge.t_ns, anew=anew):
            self._health.rate_out_of_bounds += 1

    def _is_period(self, before: Edge, after: Edge) -> bool:
        """Whether these are pulses of samples, as many periods apart as their numbers are."""
        n = after.seq - before.seq
        return abs((after.t_ns - before.t_ns) / self._period_ns - n) <= FIT_PERIODS + BOUND * n

    @property
    def _period_ns(self) -> float:
        return self._timebase.period_s * NS_PER_S
