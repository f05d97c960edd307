"""Times of day as the encodings write them."""

from __future__ import annotations

import time

from quavelet.core.units import NS_PER_MS, NS_PER_S


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
