"""Clocks never go back, and sleep to a deadline, not for a duration."""

from __future__ import annotations

from types import SimpleNamespace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from quavelet.core import clock as clock_module
from quavelet.core.clock import MonotonicClock, VirtualClock


@given(
    start_ns=st.integers(0, 10**18),
    steps=st.lists(st.tuples(st.booleans(), st.integers(-(10**12), 10**12)), max_size=30),
)
def test_a_virtual_clock_is_where_the_latest_demand_put_it_and_never_goes_back(start_ns, steps):
    clock = VirtualClock(start_ns)
    for sleeps, ns in steps:
        before_ns = clock.now_ns()
        if sleeps:
            clock.sleep_until_ns(start_ns + ns)
            assert clock.now_ns() >= start_ns + ns
            assert clock.now_ns() in (before_ns, start_ns + ns)
        elif ns < 0:
            with pytest.raises(ValueError, match="cannot go back"):
                clock.advance_ns(ns)
            assert clock.now_ns() == before_ns
        else:
            clock.advance_ns(ns)
            assert clock.now_ns() - before_ns == ns
        assert clock.now_ns() >= before_ns


class System:
    """The module `time` of a machine whose sleeps end early or late by what is given, one a sleep."""

    def __init__(self, now_ns: int, off_ns: list[int]) -> None:
        self.now_ns = now_ns
        self.off_ns = off_ns
        self.slept: list[int] = []

    def sleep(self, seconds: float) -> None:
        assert seconds > 0
        self.slept.append(round(seconds * 1e9))
        self.now_ns += max(1, self.slept[-1] + (self.off_ns.pop(0) if self.off_ns else 0))

    def install(self, monkeypatch: pytest.MonkeyPatch) -> None:
        module = SimpleNamespace(monotonic_ns=lambda: self.now_ns, sleep=self.sleep)
        monkeypatch.setattr(clock_module, "time", module)


def test_a_sleep_cut_short_by_a_signal_goes_on_to_the_deadline(monkeypatch):
    system = System(5_000, [-700_000, -100_000, 60_000])
    system.install(monkeypatch)
    MonotonicClock().sleep_until_ns(1_005_000)
    assert system.slept == [1_000_000, 700_000, 100_000]
    assert MonotonicClock().now_ns() == system.now_ns == 1_005_000 + 60_000


def test_a_late_wake_up_does_not_put_off_the_next_deadline(monkeypatch):
    system = System(0, [300_000, 0])
    system.install(monkeypatch)
    clock = MonotonicClock()
    clock.sleep_until_ns(1_000_000)
    clock.sleep_until_ns(2_000_000)
    assert system.slept == [1_000_000, 700_000]
    assert system.now_ns == 2_000_000


@pytest.mark.parametrize("deadline_ns", [-1, 0, 7_999, 8_000])
def test_a_deadline_that_is_past_is_not_slept_for(monkeypatch, deadline_ns):
    system = System(8_000, [])
    system.install(monkeypatch)
    MonotonicClock().sleep_until_ns(deadline_ns)
    assert system.slept == []


def test_the_hosts_clock_is_clock_monotonic():
    import time

    before_ns = time.clock_gettime_ns(time.CLOCK_MONOTONIC)
    now_ns = MonotonicClock().now_ns()
    assert before_ns <= now_ns <= time.clock_gettime_ns(time.CLOCK_MONOTONIC)
