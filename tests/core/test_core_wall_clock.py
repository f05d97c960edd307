"""Times told to others are off by what a reading of the two clocks is off, on a machine that is busy too."""

import time
from datetime import UTC, datetime

from hypothesis import given
from hypothesis import strategies as st

from quavelet.core.clock import VirtualClock
from quavelet.core.units import NS_PER_MS, NS_PER_S, NS_PER_US
from quavelet.core.wall_clock import offset_from, unix_ns_of, utc_of, wall_going_with

OFFSET_NS = 1_700_000_000 * NS_PER_S


class HeldUp(VirtualClock):
    """Each look at it takes its next hold, and then none."""

    def __init__(self, holds_ns: list[int]) -> None:
        super().__init__(5 * NS_PER_S)
        self.holds_ns = holds_ns

    def now_ns(self) -> int:
        now_ns = super().now_ns()
        self.advance_ns(self.holds_ns.pop(0) if self.holds_ns else 0)
        return now_ns

    def wall_ns(self) -> int:
        return self.now_ns() + OFFSET_NS


@given(holds_ms=st.lists(st.integers(0, 500), max_size=12))
def test_a_reading_that_was_held_up_is_not_taken_while_others_were_not(holds_ms):
    clock = HeldUp([ms * NS_PER_MS for ms in holds_ms])
    off_ns = offset_from(clock, clock.wall_ns)() - OFFSET_NS
    # Each reading looks three times; the fifth begins after twelve looks.
    assert off_ns == 0


@given(holds_us=st.lists(st.integers(0, 5000), min_size=15, max_size=15))
def test_it_is_off_by_half_of_its_best_reading_at_most(holds_us):
    clock = HeldUp([us * NS_PER_US for us in holds_us])
    off_ns = offset_from(clock, clock.wall_ns)() - OFFSET_NS
    spans_us = [holds_us[k] + holds_us[k + 1] for k in range(0, 15, 3)]
    assert abs(off_ns) <= max(min(spans_us), 20) * NS_PER_US / 2


def test_the_offset_takes_the_loops_time_to_the_time_of_day():
    clock = VirtualClock(5 * NS_PER_S)
    offset_ns = offset_from(clock)
    before_ns = time.time_ns()
    assert 0 <= offset_ns() + clock.now_ns() - before_ns < 60 * NS_PER_S
    first_ns = offset_ns()
    clock.advance_ns(3600 * NS_PER_S)
    assert offset_ns() < first_ns - 3000 * NS_PER_S


def test_a_clock_that_was_set_is_seen_at_the_next_look():
    clock, by_ns = VirtualClock(), [0]
    offset_ns = offset_from(clock, lambda: clock.now_ns() + OFFSET_NS + by_ns[0])
    assert offset_ns() == OFFSET_NS
    by_ns[0] = -3600 * NS_PER_S
    assert offset_ns() == OFFSET_NS - 3600 * NS_PER_S


def test_on_virtual_time_the_time_of_day_begins_now_and_goes_with_it():
    clock = VirtualClock(5 * NS_PER_S)
    wall_ns = wall_going_with(clock)
    first_ns = wall_ns()
    assert abs(utc_of(first_ns) - datetime.now(UTC)).total_seconds() < 60
    clock.advance_ns(3600 * NS_PER_S)
    assert wall_ns() == first_ns + 3600 * NS_PER_S


@given(unix_ns=st.integers(0, 4 * 10**18))
def test_utc_is_cut_to_the_microsecond(unix_ns):
    assert unix_ns_of(utc_of(unix_ns)) == unix_ns - unix_ns % 1000


def test_utc_is_that_of_the_calendar():
    assert utc_of(951_827_696_007_000_999) == datetime(2000, 2, 29, 12, 34, 56, 7000, tzinfo=UTC)
