"""The time of day beside the loop's clock: for what is told to others, and nothing else, since it may be set."""

from __future__ import annotations

import time
from collections.abc import Callable
from datetime import UTC, datetime, timedelta
from typing import NamedTuple

from quavelet.core.clock import Clock
from quavelet.core.units import NS_PER_US

WallNs = Callable[[], int]
"""CLOCK_REALTIME, ns since 1970. It may be set at any moment."""
OffsetNs = Callable[[], int]
"""CLOCK_REALTIME minus the loop's clock, ns; may be called on any thread. It jumps where the time of day is set."""

_TRIES, _AT_ONCE_NS = 5, 20 * NS_PER_US
_BEGIN = datetime(1970, 1, 1, tzinfo=UTC)


def offset_from(clock: Clock, wall_ns: WallNs = time.time_ns) -> OffsetNs:
    """That of this machine. A reading that was held up between the two clocks is not taken: it would be off by so
    much."""

    def offset_ns() -> int:
        best_ns, best_span_ns = 0, -1
        for _ in range(_TRIES):
            before_ns = clock.now_ns()
            now_ns = wall_ns()
            span_ns = clock.now_ns() - before_ns
            if best_span_ns < 0 or span_ns < best_span_ns:
                best_ns, best_span_ns = now_ns - before_ns - span_ns // 2, span_ns
            if span_ns <= _AT_ONCE_NS:
                break
        return best_ns

    return offset_ns


def wall_going_with(clock: Clock) -> WallNs:
    """The time of day on virtual time: as it is now, and from here on as `clock` goes."""
    offset_ns = time.time_ns() - clock.now_ns()
    return lambda: clock.now_ns() + offset_ns


class Instant(NamedTuple):
    """One instant by both clocks: the loop's, ns, and what is to be added for ns since 1970."""

    t_ns: int
    offset_ns: int

    @property
    def utc(self) -> datetime:
        return utc_of(self.t_ns + self.offset_ns)


def utc_of(unix_ns: int) -> datetime:
    """Cut to the microsecond."""
    return _BEGIN + timedelta(microseconds=unix_ns // NS_PER_US)


def unix_ns_of(utc: datetime) -> int:
    """ns since 1970. Raises TypeError for a time without its zone."""
    return (utc - _BEGIN) // timedelta(microseconds=1) * NS_PER_US
