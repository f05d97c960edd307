"""The functions of the module `time` by a virtual clock, for code that is given no clock."""

from __future__ import annotations

import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from typing import Any
from unittest import mock

from quavelet.core.clock import VirtualClock
from quavelet.core.units import NS_PER_S

LOOK_NS = 1000
"""What looking at the clock takes, so that a loop that waits for a deadline comes to its end."""

READERS = ("time", "monotonic", "perf_counter")
_REAL: dict[str, Callable[..., Any]] = {
    name: getattr(time, name) for name in ("sleep", *READERS, *(f"{name}_ns" for name in READERS))
}


@contextmanager
def virtual_time(clock: VirtualClock) -> Iterator[None]:
    """Inside the block `time.sleep` moves `clock`, and `time`, `monotonic`, `perf_counter`, also as `_ns`, follow it.

    It is so for the thread that enters the block, and under every name by which a module has one of these functions,
    those of the standard library and of pytest excepted. They go on from the real time; one block at a time.
    """
    with ExitStack() as stack:
        for name, function in _FUNCTIONS.items():
            stack.enter_context(replaced(time, name, function))
        stack.enter_context(_time.follows(clock))
        yield


@contextmanager
def replaced(home: Any, name: str, function: object) -> Iterator[None]:
    """Inside the block `home.name` is another, also in modules that took it from there by that name."""
    real = getattr(home, name)
    with ExitStack() as stack:
        stack.enter_context(mock.patch.object(home, name, function))
        for path, module in list(sys.modules.items()):
            top = path.partition(".")[0]
            if top in sys.stdlib_module_names or top in ("pytest", "_pytest"):
                continue
            if getattr(module, "__dict__", {}).get(name) is real:
                stack.enter_context(mock.patch.object(module, name, function))
        yield


class _Time:
    """Functions that are virtual while they follow a clock, in one thread; otherwise they are the real ones.

    A module that is first imported meanwhile keeps them, so they must be right afterwards too.
    """

    def __init__(self) -> None:
        self._followed: VirtualClock | None = None
        self._thread = 0
        self._start_ns: dict[str, int] = {}

    @contextmanager
    def follows(self, clock: VirtualClock) -> Iterator[None]:
        self._thread = threading.get_ident()
        self._start_ns = {name: _REAL[f"{name}_ns"]() - clock.now_ns() for name in READERS}
        self._followed = clock
        try:
            yield
        finally:
            self._followed = None

    def sleep(self, seconds: float, /) -> None:
        clock = self._clock()
        if clock is None:
            _REAL["sleep"](seconds)
        elif seconds < 0:
            raise ValueError("sleep length must be non-negative")
        else:
            clock.advance_ns(round(seconds * NS_PER_S))

    def reader(self, name: str, *, in_seconds: bool) -> Callable[[], int | float]:
        real = _REAL[name if in_seconds else f"{name}_ns"]

        def now() -> int | float:
            clock = self._clock()
            if clock is None:
                present: int | float = real()
                return present
            clock.advance_ns(LOOK_NS)
            now_ns = self._start_ns[name] + clock.now_ns()
            return now_ns / NS_PER_S if in_seconds else now_ns

        return now

    def _clock(self) -> VirtualClock | None:
        return self._followed if threading.get_ident() == self._thread else None


_time = _Time()
_FUNCTIONS: dict[str, Callable[..., Any]] = {
    "sleep": _time.sleep,
    **{name: _time.reader(name, in_seconds=True) for name in READERS},
    **{f"{name}_ns": _time.reader(name, in_seconds=False) for name in READERS},
}
