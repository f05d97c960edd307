"""An asyncio loop whose time is a virtual clock's, so that waits of an hour take no longer than the clock does."""

from __future__ import annotations

import asyncio
import selectors
import time
from collections.abc import Mapping

from quavelet.core.clock import Clock
from quavelet.core.units import NS_PER_S

LOOK_S = 0.002
"""Real time between two looks at the clock, which somebody else moves."""


class _Impatient(selectors.DefaultSelector):  # type: ignore[misc, valid-type]
    def select(self, timeout: float | None = None) -> list[tuple[selectors.SelectorKey, int]]:
        found: list[tuple[selectors.SelectorKey, int]] = super().select(
            min(LOOK_S, LOOK_S if timeout is None else timeout)
        )
        return found


class DrivenLoop(asyncio.SelectorEventLoop):
    """Timers go by `clock`; sockets and threads are real. Whoever moves the clock faster than a broker can answer must
    wait for the answer."""

    def __init__(self, clock: Clock) -> None:
        self._driven_by = clock
        self._let_go_s: float | None = None
        self._looks = _Impatient()
        super().__init__(self._looks)

    def time(self) -> float:
        driven_s = self._driven_by.now_ns() / NS_PER_S
        return driven_s if self._let_go_s is None else driven_s + time.monotonic() - self._let_go_s

    def let_go(self) -> None:
        """From now on real time goes by as well: a part that closes may wait, and nobody moves the clock any more."""
        self._let_go_s = time.monotonic()

    @property
    def sockets(self) -> int:
        """How many are open on it, besides its own."""
        known: Mapping[object, object] | None = self._looks.get_map()
        return len(known or ()) - 1
