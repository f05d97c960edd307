"""The time of day: that nothing of ours goes by it, and that whoever reads it from us is told when it was set."""

from __future__ import annotations

from collections.abc import Callable

from quavelet.core.clock import Clock
from quavelet.core.units import NS_PER_MS, NS_PER_S
from quavelet.core.wall_clock import WallNs, offset_from
from quavelet.service.status import is_synchronised
from quavelet.sinks.spans import span_in_words
from quavelet.sinks.status import ClockStatus

STEP_NS = 500 * NS_PER_MS
"""Time servers move a clock gently by 0.5 ms a second, and set it where it is off by 0.1 to 1 s."""
LOOK_NS, TELL_AGAIN_NS = NS_PER_S, 60 * NS_PER_S


class TimeOfDay:
    """CLOCK_REALTIME beside the loop's `clock`; `look` is called by the loop.

    A Pi without a battery wakes up in the past and is set right by a time server minutes later. asleep_ns is how long
    the machine has been suspended: the loop's clock stands still then, and the other does not.
    """

    def __init__(
        self, wall_ns: WallNs, *, clock: Clock, asleep_ns: Callable[[], int], talk: Callable[[str], None]
    ) -> None:
        self.steps = 0
        """How often it was set."""
        self._clock = clock
        self.offset_ns = offset_from(clock, wall_ns)
        """CLOCK_REALTIME less the loop's clock; may be called on any thread."""
        self._asleep_ns = asleep_ns
        self._talk = talk
        self._before_ns = self._awake_offset_ns()
        self._look_ns = clock.now_ns() + LOOK_NS

    def look(self) -> None:
        """Tell if it was set, at most once a minute."""
        now_ns = self._clock.now_ns()
        if now_ns < self._look_ns:
            return
        offset_ns = self._awake_offset_ns()
        by_ns, self._before_ns = offset_ns - self._before_ns, offset_ns
        self._look_ns = now_ns + LOOK_NS
        if abs(by_ns) >= STEP_NS:
            self.steps += 1
            self._look_ns = now_ns + TELL_AGAIN_NS
            self._talk(
                f"the time of day was set {'forward' if by_ns > 0 else 'back'} by "
                f"{span_in_words(abs(by_ns) / NS_PER_S)}: UTC in outputs and recordings jumps with it; the attitude, "
                "the loop and t_ns do not"
            )

    def status(self) -> ClockStatus:
        """As it stands; may be called on any thread."""
        return ClockStatus(offset_ns=self.offset_ns(), synchronised=is_synchronised(), steps=self.steps)

    def _awake_offset_ns(self) -> int:
        return self.offset_ns() - self._asleep_ns()
