"""Waits before the next try: they grow, they end, and a fleet does not come back all at once."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from quavelet.sinks.transports.backoff import Backoff


def test_waits_grow_from_a_second_to_a_minute_and_begin_again_after_success() -> None:
    backoff = Backoff(uniform=lambda: 1.0)
    assert [backoff.wait_s() for _ in range(9)] == [1, 2, 4, 8, 16, 32, 60, 60, 60]
    backoff.reset()
    assert backoff.wait_s() == 1


def test_what_only_a_person_can_mend_is_not_tried_every_second() -> None:
    assert Backoff(uniform=lambda: 0.0).wait_s(slow=True) == 30.0


@given(st.lists(st.booleans(), min_size=1, max_size=40), st.floats(0.0, 1.0, exclude_max=True))
def test_no_wait_is_shorter_than_the_first_nor_longer_than_the_longest(slow: list[bool], uniform: float) -> None:
    backoff = Backoff(uniform=lambda: uniform)
    assert all(1.0 <= backoff.wait_s(slow=one) <= 60.0 for one in slow)


def test_a_fleet_that_lost_its_broker_does_not_come_back_in_one_moment() -> None:
    fleet = [Backoff() for _ in range(50)]
    for one in fleet:
        for _ in range(6):
            one.wait_s()
    waits = sorted(one.wait_s() for one in fleet)
    assert waits[-1] - waits[0] > 10.0
