"""How it is going, judged by the loop itself and by nothing but what it has in its hands; told to systemd."""

from __future__ import annotations

from collections.abc import Callable
from math import isfinite

from quavelet.core.blocks import Flag
from quavelet.core.clock import Clock
from quavelet.core.units import NS_PER_S, NS_PER_US
from quavelet.service.notify import Notify
from quavelet.sinks.message import Message

STATUS_NS = 5 * NS_PER_S
"""How often the status is told where nothing changes, and the time to start is asked for anew."""
SILENT_NS = NS_PER_S
"""Without a sample for so long the chip is said to be lost."""
PATIENCE_US = 30_000_000
"""What is asked for each time while starting."""
WAITING, SETTLING, RUNNING = "waiting for the chip", "settling", "running"
NO_SAMPLE, STUCK = "lost: no sample comes", "lost: the chip is stuck, no axis changes"
_STUCK, _SETTLING = Flag.names(Flag.STUCK)[0], Flag.names(Flag.SETTLING)[0]


class Watchdog:
    """Called by the loop at each deadline, on its thread.

    READY is told with the first attitude that is to be trusted; WATCHDOG only with fresh samples of a chip that is not
    stuck, at most every half of what systemd asked for: a loop that hangs, a chip that freezes and one that has gone
    starve it alike. While the chip is waited for or the attitude settles, the start is given more time; a chip that
    answers and gives nothing of use is not.
    """

    def __init__(self, notify: Notify, *, clock: Clock) -> None:
        self._notify = notify
        self._clock = clock
        self.state = WAITING
        """"waiting for the chip", "settling", "running", or "lost: ..."."""
        self.ready = False
        self._owes_ready = False
        self.remark = ""
        """What else is in the status until it is taken out, such as settings that were refused."""
        self._newest_ns: int | None = None
        self._fresh_ns = clock.now_ns()
        self._fed_ns: int | None = None
        self._told_ns: int | None = None
        self._told = ""

    @property
    def wanted(self) -> bool:
        """Whether systemd listens."""
        return self._notify.wanted

    def waiting(self, reason: str) -> None:
        """The chip does not answer yet, and is tried again."""
        self.state = WAITING
        self._tell(reason, patience=True)

    def tick(self, message: Message | None, words: Callable[[], str]) -> None:
        """A deadline, with the message of its samples if there were any; `words` is asked when a status is due."""
        now_ns = self._clock.now_ns()
        fresh = message is not None and (self._newest_ns is None or message.t_ns > self._newest_ns)
        valid = trusted = False
        if message is not None and fresh:
            self._newest_ns, self._fresh_ns = message.t_ns, now_ns
            valid = _STUCK not in message.flags and all(map(isfinite, message.q))
            trusted = valid and _SETTLING not in message.flags
            self.state = RUNNING if trusted else SETTLING if valid else STUCK
        elif now_ns - self._fresh_ns > SILENT_NS and self._newest_ns is not None:
            self.state = NO_SAMPLE
        if self._owes_ready or (trusted and not self.ready):
            self._owes_ready = not self._notify.send(READY=1)
            self.ready = True
        if valid:
            self._feed(now_ns)
        if self._due(now_ns):
            # Not at once: whether a chip is stuck shows only after a while.
            self._tell(words(), patience=valid and self.state == self._told)

    def reloading(self) -> None:
        """The settings are read again; `reloaded` must follow."""
        if self.ready:
            self._notify.send(RELOADING=1, MONOTONIC_USEC=self._clock.now_ns() // NS_PER_US)

    def reloaded(self, remark: str) -> None:
        """Done; the remark stays in the status."""
        self.remark = remark
        self._told = ""
        if self.ready:
            self._owes_ready = not self._notify.send(READY=1)

    def stopping(self, reason: str = "") -> None:
        """The end has begun."""
        self._notify.send(STOPPING=1, STATUS=reason or "stopping")

    def _feed(self, now_ns: int) -> None:
        interval_ns = self._notify.watchdog_us * NS_PER_US // 2
        if interval_ns and (self._fed_ns is None or now_ns - self._fed_ns >= interval_ns):
            self._fed_ns = now_ns if self._notify.send(WATCHDOG=1) else None

    def _due(self, now_ns: int) -> bool:
        if not self._notify.wanted:
            return False
        return self.state != self._told or self._told_ns is None or now_ns - self._told_ns >= STATUS_NS

    def _tell(self, words: str, *, patience: bool) -> None:
        self._told, self._told_ns = self.state, self._clock.now_ns()
        status = "; ".join(part for part in (self.state, words, self.remark) if part)
        if patience and not self.ready:
            self._notify.send(STATUS=status, EXTEND_TIMEOUT_USEC=PATIENCE_US)
        else:
            self._notify.send(STATUS=status)
