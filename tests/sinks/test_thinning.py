"""What an output leaves out: the rate is kept on the average, and no flag or gap is lost with a message."""

from itertools import pairwise
from math import cos, radians, sin
from random import Random

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st
from network_rig import MESSAGE

from quavelet.sinks.message import Message
from quavelet.sinks.thinning import Thinning, angle_between_deg

NS = 1_000_000_000


def at(t_s: float, **fields: object) -> Message:
    return msgspec.structs.replace(MESSAGE, t_ns=round(t_s * NS), **fields)


def tilted(deg: float) -> tuple[float, float, float, float]:
    return (cos(radians(deg) / 2), sin(radians(deg) / 2), 0.0, 0.0)


def test_without_a_rate_or_a_dead_band_all_go_as_they_are() -> None:
    thinning = Thinning()
    messages = [at(k / 100) for k in range(100)]
    assert [thinning.take(message) for message in messages] == messages


@given(st.integers(0, 1_000_000), st.sampled_from([1.0, 7.0, 10.0, 30.0, 100.0]))
def test_the_mean_rate_is_the_one_asked_for_however_uneven_the_messages_come(seed: int, hz: float) -> None:
    random = Random(seed)
    thinning = Thinning(rate_hz=hz)
    went = sum(thinning.take(at(1.0 + k / 100 + random.uniform(-0.002, 0.002))) is not None for k in range(1_000))
    assert abs(went - 10 * hz) <= 3
    assert went + thinning.left_out == 1_000


DOUBTS = st.lists(st.tuples(st.sets(st.sampled_from(["gap", "stuck", "late"])), st.integers(0, 9)), min_size=20)


@given(DOUBTS)
def test_what_is_left_out_hands_its_flags_and_gaps_on(doubts: list[tuple[set[str], int]]) -> None:
    thinning = Thinning(rate_hz=10.0)
    flags: set[str] = set()
    gap_ns = 0
    for k, (names, gap) in enumerate(doubts):
        flags |= names
        gap_ns += gap
        went = thinning.take(at(1.0 + k / 50, flags=sorted(names), gap_ns=gap))
        if went is not None:
            assert (set(went.flags), went.gap_ns) == (flags, gap_ns)
            flags, gap_ns = set(), 0
    assert thinning.left_out > 0


def test_after_a_long_silence_there_is_no_burst() -> None:
    thinning = Thinning(rate_hz=10.0)
    assert thinning.take(at(1.0)) is not None
    assert sum(thinning.take(at(100.0 + k / 1000)) is not None for k in range(40)) == 1


def test_a_board_that_lies_still_says_so_once_a_second() -> None:
    thinning = Thinning(dead_band_deg=0.5)
    went = [k for k in range(301) if thinning.take(at(k / 100, q=tilted(0.1 * (k % 3)))) is not None]
    assert went == [0, 100, 200, 300]


@pytest.mark.parametrize(
    "change", [{"q": tilted(0.6)}, {"flags": ["gap"]}, {"still": False}, {"yaw": "magnetic"}, {"gap_ns": 1}]
)
def test_whatever_changes_beyond_the_dead_band_goes_at_once(change: dict[str, object]) -> None:
    thinning = Thinning(dead_band_deg=0.5)
    assert thinning.take(at(0.0)) is not None
    assert thinning.take(at(0.01)) is None
    assert thinning.take(at(0.02, **change)) is not None


def test_a_slow_turn_is_not_lost_in_the_dead_band() -> None:
    thinning = Thinning(dead_band_deg=1.0, keep_alive_s=1e6)
    went = [m for k in range(1_001) if (m := thinning.take(at(k / 100, q=tilted(0.01 * k)))) is not None]
    steps = [angle_between_deg(a.q, b.q) for a, b in pairwise(went)]
    assert len(went) >= 10
    assert steps == pytest.approx([1.0] * len(steps), abs=0.011)


@given(st.floats(-180.0, 180.0), st.floats(-180.0, 180.0))
def test_the_angle_between_two_tilts_is_their_difference_whichever_sign_the_quaternion_has(a: float, b: float) -> None:
    w, x, y, z = tilted(b)
    expected = abs((a - b + 180.0) % 360.0 - 180.0)
    assert angle_between_deg(tilted(a), (-w, -x, -y, -z)) == pytest.approx(expected, abs=1e-6)
