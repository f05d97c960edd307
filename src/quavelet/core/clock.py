"""Time as an argument: the host's monotonic clock, or a virtual one that moves only when told."""

from __future__ import annotations

import time
from typing import Protocol

from quavelet.core.units import NS_PER_S


class Clock(Protocol):
    """Integer nanoseconds that never go back."""

    def now_ns(self) -> int:
        """The present time."""
        ...

    def sleep_until_ns(self, t_ns: int) -> None:
        """Return at `t_ns` or as soon after it as can be; at once when it is past."""
        ...


class MonotonicClock:
    """CLOCK_MONOTONIC of this machine."""

    def now_ns(self) -> int:
        return time.monotonic_ns()

    def sleep_until_ns(self, t_ns: int) -> None:
        # time.sleep of the rest is as punctual as clock_nanosleep(TIMER_ABSTIME) on Python 3.11+,
        # which itself sleeps to an absolute deadline; a signal handler may cut the sleep short.
        while (rest_ns := t_ns - time.monotonic_ns()) > 0:
            time.sleep(rest_ns / NS_PER_S)


class VirtualClock:
    """A clock for simulation: sleeping moves it, and so does whoever models something that takes time."""

    def __init__(self, start_ns: int = 0) -> None:
        self._now_ns = start_ns

    def now_ns(self) -> int:
        return self._now_ns

    def sleep_until_ns(self, t_ns: int) -> None:
        self._now_ns = max(self._now_ns, t_ns)

    def advance_ns(self, dt_ns: int) -> None:
        """Let `dt_ns` >= 0 pass."""
        if dt_ns < 0:
            raise ValueError("a clock cannot go back: give dt_ns >= 0")
        self._now_ns += dt_ns
