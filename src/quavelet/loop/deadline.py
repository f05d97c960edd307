"""The loop: one tick at each fixed deadline of the host's clock."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

from quavelet.core.clock import Clock
from quavelet.core.errors import SettingsError
from quavelet.loop.histogram import Histogram


@dataclass(frozen=True, slots=True)
class LoopStats:
    """How punctual the loop has been; percentiles as `Histogram.percentile` states them, maxima exact.

    ticks     deadlines that were served
    missed    deadlines that passed before the loop was free, and were skipped
    lateness  from the deadline to the wake-up
    duration  of the tick itself; a tick that ends the run of its own accord is left out
    """

    ticks: int
    missed: int
    lateness_p50_ns: int
    lateness_p99_ns: int
    lateness_max_ns: int
    duration_p50_ns: int
    duration_p99_ns: int
    duration_max_ns: int


NO_LOOP = LoopStats(0, 0, 0, 0, 0, 0, 0, 0)
"""Of a loop that has not begun, or where there is none."""


class FixedStepLoop:
    """Gives the deadlines start + k period, k = 1, 2, ..., each as it is reached.

    The deadlines are absolute, so lateness never adds up. A deadline that is past by the time the loop
    is free is counted as missed and skipped: a late loop drops its work, it does not catch up by a burst.

    Either iterate over `deadlines`, the tick being what is done between two of them, or give `tick` and call
    `run`: the tick is called with each deadline in ns and returns False to end the run.
    """

    def __init__(self, clock: Clock, *, period_ns: int, tick: Callable[[int], bool] | None = None) -> None:
        """Raises SettingsError unless period_ns > 0."""
        if period_ns <= 0:
            raise SettingsError(f"the loop's period must be positive, not {period_ns} ns")
        self._clock = clock
        self._period_ns = period_ns
        self._tick = tick
        self._missed = 0
        self._stopped = False
        self.lateness = Histogram()
        self.duration = Histogram()

    def run(self, until_ns: int | None = None) -> None:
        """Call the tick at every deadline up to and including `until_ns`, for ever where it is None.

        Returns early after `stop`, or when the tick returns False. What the tick raises comes through.
        """
        for deadline_ns in self.deadlines(until_ns):
            if self._tick is not None and not self._tick(deadline_ns):
                return

    def deadlines(self, until_ns: int | None = None) -> Iterator[int]:
        """Every deadline in ns up to and including `until_ns`, for ever where it is None, or until `stop`.

        The first is one period after the first value is asked for.
        """
        clock, period_ns = self._clock, self._period_ns
        deadline_ns = clock.now_ns() + period_ns
        while not self.stopped() and (until_ns is None or deadline_ns <= until_ns):
            clock.sleep_until_ns(deadline_ns)
            if self.stopped():
                return
            woken_ns = clock.now_ns()
            self.lateness.add(woken_ns - deadline_ns)
            yield deadline_ns
            done_ns = clock.now_ns()
            self.duration.add(done_ns - woken_ns)
            deadline_ns += period_ns
            # A deadline reached to the nanosecond can still be served; those before it cannot.
            past_ns = done_ns if until_ns is None else min(done_ns, until_ns + 1)
            skipped = max(0, -((deadline_ns - past_ns) // period_ns))
            deadline_ns += skipped * period_ns
            self._missed += skipped

    def stop(self) -> None:
        """End the run after the tick in hand, or at the next deadline without a tick.

        Safe from another thread and from a signal handler; a stopped loop stays stopped.
        """
        self._stopped = True

    def stopped(self) -> bool:
        """Whether `stop` was called."""
        return self._stopped

    @property
    def stats(self) -> LoopStats:
        """The figures of all runs so far; may be read from any thread."""
        lateness, duration = self.lateness, self.duration
        return LoopStats(
            ticks=lateness.count,
            missed=self._missed,
            lateness_p50_ns=lateness.percentile(50),
            lateness_p99_ns=lateness.percentile(99),
            lateness_max_ns=lateness.max_ns,
            duration_p50_ns=duration.percentile(50),
            duration_p99_ns=duration.percentile(99),
            duration_max_ns=duration.max_ns,
        )
