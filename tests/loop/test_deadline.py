"""The loop keeps absolute deadlines, counts those it misses, and never makes up for them by a burst."""

import signal
import threading
from collections.abc import Callable

import pytest
from hypothesis import given
from hypothesis import strategies as st

from quavelet.core.clock import MonotonicClock, VirtualClock
from quavelet.core.errors import SettingsError
from quavelet.core.units import NS_PER_MS, NS_PER_S
from quavelet.loop.deadline import FixedStepLoop

PERIOD_NS = 5 * NS_PER_MS


class LateClock(VirtualClock):
    """Wakes late by the amounts given, one a sleep, then punctually."""

    def __init__(self, late_ns: list[int]) -> None:
        super().__init__(1_000)
        self._late_ns = list(late_ns)

    def sleep_until_ns(self, t_ns: int) -> None:
        super().sleep_until_ns(t_ns)
        if self._late_ns:
            self.advance_ns(self._late_ns.pop(0))


def recorded(deadlines_ns: list[int], tick: Callable[[], None] = lambda: None) -> Callable[[int], bool]:
    def record(deadline_ns: int) -> bool:
        deadlines_ns.append(deadline_ns)
        tick()
        return True

    return record


def test_the_deadlines_are_start_plus_whole_periods_and_the_last_is_included() -> None:
    clock, seen_ns = VirtualClock(7), list[int]()
    FixedStepLoop(clock, period_ns=PERIOD_NS, tick=recorded(seen_ns)).run(until_ns=7 + 4 * PERIOD_NS)
    assert seen_ns == [7 + k * PERIOD_NS for k in (1, 2, 3, 4)]


def test_an_hour_of_virtual_time_has_no_lateness_and_misses_nothing() -> None:
    loop = FixedStepLoop(VirtualClock(), period_ns=PERIOD_NS, tick=lambda _: True)
    loop.run(until_ns=3600 * NS_PER_S)
    stats = loop.stats
    assert (stats.ticks, stats.missed) == (720_000, 0)
    assert (stats.lateness_p50_ns, stats.lateness_p99_ns, stats.lateness_max_ns) == (0, 0, 0)
    assert (stats.duration_p50_ns, stats.duration_max_ns) == (0, 0)


def test_a_missed_deadline_is_counted_and_never_caught_up_by_a_burst() -> None:
    clock, seen_ns = VirtualClock(), list[int]()
    slow = [1, int(3.5 * PERIOD_NS), 1, 1]
    loop = FixedStepLoop(
        clock, period_ns=PERIOD_NS, tick=recorded(seen_ns, lambda: clock.advance_ns(slow.pop(0) if slow else 1))
    )
    loop.run(until_ns=8 * PERIOD_NS)
    assert [t // PERIOD_NS for t in seen_ns] == [1, 2, 6, 7, 8]
    assert (loop.stats.ticks, loop.stats.missed) == (5, 3)
    assert loop.stats.lateness_max_ns == 0
    assert loop.stats.duration_max_ns == int(3.5 * PERIOD_NS)


def test_a_wake_up_later_than_a_period_serves_its_own_deadline_and_skips_those_it_slept_through() -> None:
    clock, seen_ns = LateClock([0, int(2.5 * PERIOD_NS)]), list[int]()
    loop = FixedStepLoop(clock, period_ns=PERIOD_NS, tick=recorded(seen_ns))
    loop.run(until_ns=1_000 + 6 * PERIOD_NS)
    assert [(t - 1_000) // PERIOD_NS for t in seen_ns] == [1, 2, 5, 6]
    assert (loop.stats.missed, loop.stats.lateness_max_ns) == (2, int(2.5 * PERIOD_NS))


def test_lateness_does_not_add_up() -> None:
    clock, seen_ns = LateClock([300_000] * 1_000), list[int]()
    loop = FixedStepLoop(clock, period_ns=PERIOD_NS, tick=recorded(seen_ns))
    loop.run(until_ns=1_000 + 1_000 * PERIOD_NS)
    assert seen_ns[-1] == 1_000 + 1_000 * PERIOD_NS
    assert (loop.stats.lateness_max_ns, loop.stats.missed) == (300_000, 0)


def test_a_tick_that_ends_just_at_the_next_deadline_has_not_missed_it() -> None:
    clock, seen_ns = VirtualClock(), list[int]()
    loop = FixedStepLoop(clock, period_ns=PERIOD_NS, tick=recorded(seen_ns, lambda: clock.advance_ns(PERIOD_NS)))
    loop.run(until_ns=5 * PERIOD_NS)
    assert (loop.stats.ticks, loop.stats.missed, loop.stats.lateness_max_ns) == (5, 0, 0)


def test_deadlines_after_the_end_of_the_run_are_not_missed() -> None:
    clock = VirtualClock()
    loop = FixedStepLoop(clock, period_ns=PERIOD_NS, tick=recorded([], lambda: clock.advance_ns(9 * PERIOD_NS + 1)))
    loop.run(until_ns=4 * PERIOD_NS)
    assert (loop.stats.ticks, loop.stats.missed) == (1, 3)


@given(
    st.lists(st.integers(0, 4 * PERIOD_NS), max_size=30),
    st.lists(st.integers(0, 4 * PERIOD_NS), max_size=30),
    st.integers(0, 40 * PERIOD_NS),
)
def test_every_deadline_is_either_served_or_missed(late_ns: list[int], busy_ns: list[int], span_ns: int) -> None:
    clock, seen_ns = LateClock(late_ns), list[int]()
    loop = FixedStepLoop(
        clock, period_ns=PERIOD_NS, tick=recorded(seen_ns, lambda: clock.advance_ns(busy_ns.pop() if busy_ns else 0))
    )
    loop.run(until_ns=1_000 + span_ns)
    assert loop.stats.ticks + loop.stats.missed == span_ns // PERIOD_NS
    assert loop.stats.ticks == len(seen_ns) == len(set(seen_ns))
    assert all((t - 1_000) % PERIOD_NS == 0 for t in seen_ns)


def test_the_loop_ends_when_the_tick_says_so() -> None:
    seen_ns: list[int] = []

    def tick(deadline_ns: int) -> bool:
        seen_ns.append(deadline_ns)
        return len(seen_ns) < 3

    loop = FixedStepLoop(VirtualClock(), period_ns=10, tick=tick)
    loop.run()
    assert seen_ns == [10, 20, 30]


def test_iterating_gives_the_same_deadlines_as_ticks_and_skips_what_the_body_overran() -> None:
    clock, seen_ns = VirtualClock(), list[int]()
    loop = FixedStepLoop(clock, period_ns=10)
    for deadline_ns in loop.deadlines(until_ns=60):
        seen_ns.append(deadline_ns)
        clock.advance_ns(25 if deadline_ns == 20 else 1)
    assert seen_ns == [10, 20, 50, 60]
    assert (loop.stats.ticks, loop.stats.missed, loop.stats.duration_max_ns) == (4, 2, 25)


def test_leaving_the_iteration_early_leaves_the_loop_fit_for_another() -> None:
    clock = VirtualClock()
    loop = FixedStepLoop(clock, period_ns=10)
    assert next(iter(loop.deadlines())) == 10
    clock.advance_ns(7)
    assert list(loop.deadlines(until_ns=40)) == [27, 37]
    assert (loop.stats.ticks, loop.stats.missed) == (3, 0)


def test_what_a_tick_raises_reaches_the_caller() -> None:
    def tick(_: int) -> bool:
        raise OSError("the wire is off")

    loop = FixedStepLoop(VirtualClock(), period_ns=10, tick=tick)
    with pytest.raises(OSError, match="the wire is off"):
        loop.run()
    assert loop.stats.ticks == 1


def test_stop_within_a_tick_and_stop_before_the_run_both_hold() -> None:
    def tick(_: int) -> bool:
        loop.stop()
        return True

    loop = FixedStepLoop(VirtualClock(), period_ns=10, tick=tick)
    loop.run()
    loop.run()
    assert loop.stats.ticks == 1


def test_stop_from_another_thread_ends_the_run() -> None:
    ticked = threading.Event()

    def tick(_: int) -> bool:
        ticked.set()
        return True

    loop = FixedStepLoop(MonotonicClock(), period_ns=NS_PER_MS, tick=tick)
    thread = threading.Thread(target=loop.run)
    thread.start()
    assert ticked.wait(10)
    loop.stop()
    thread.join(10)
    assert not thread.is_alive()


def test_stop_from_a_signal_handler_ends_the_run() -> None:
    def tick(_: int) -> bool:
        signal.raise_signal(signal.SIGTERM)
        return True

    loop = FixedStepLoop(MonotonicClock(), period_ns=NS_PER_MS, tick=tick)
    before = signal.signal(signal.SIGTERM, lambda *_: loop.stop())
    try:
        loop.run()
    finally:
        signal.signal(signal.SIGTERM, before)
    assert loop.stats.ticks == 1


def test_no_ticks_give_zero_figures_and_a_period_of_nothing_is_refused() -> None:
    loop = FixedStepLoop(VirtualClock(), period_ns=10, tick=lambda _: True)
    loop.run(until_ns=9)
    assert (loop.stats.ticks, loop.stats.missed, loop.stats.lateness_max_ns) == (0, 0, 0)
    with pytest.raises(SettingsError, match="must be positive"):
        FixedStepLoop(VirtualClock(), period_ns=0, tick=lambda _: True)
