"""From the time of a sample, ns of the loop's clock, to the time of day."""

from __future__ import annotations

import time
from collections.abc import Callable

from quavelet.core.clock import Clock
from quavelet.core.units import NS_PER_MS, NS_PER_S

WallNs = Callable[[], int]
"""CLOCK_REALTIME, ns since 1970. It may be set at any moment, so it is for what is told to others, and nothing else."""
OffsetNs = Callable[[], int]
"""CLOCK_REALTIME minus the loop's clock, ns. Asked for each message: the time of day may be set while we run."""


def offset_from(clock: Clock, wall_ns: WallNs = time.time_ns) -> OffsetNs:
    """That of this machine."""
    return lambda: wall_ns() - clock.now_ns()


def wall_going_with(clock: Clock) -> WallNs:
    """The time of day on virtual time: as it is now, and from here on as `clock` goes."""
    offset_ns = time.time_ns() - clock.now_ns()
    return lambda: clock.now_ns() + offset_ns


def time_of_day(unix_ns: int) -> str:
    """hhmmss.sss in UTC, cut to the millisecond."""
    return time.strftime("%H%M%S", _utc(unix_ns)) + f".{_ms(unix_ns):03d}"


def iso_time(unix_ns: int) -> str:
    """As 2014-08-15T19:00:02.392Z (RFC 3339), cut to the millisecond."""
    return time.strftime("%Y-%m-%dT%H:%M:%S", _utc(unix_ns)) + f".{_ms(unix_ns):03d}Z"


def _utc(unix_ns: int) -> time.struct_time:
    return time.gmtime(unix_ns // NS_PER_S)


def _ms(unix_ns: int) -> int:
    return unix_ns % NS_PER_S // NS_PER_MS
