"""What encodings share: words of doubt, names that are safe, and the time of day."""

from __future__ import annotations

import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from sink_messages import message

from quavelet.core.units import NS_PER_S
from quavelet.sinks.encodings.doubt import Told, in_words, plain
from quavelet.sinks.encodings.wall_time import iso_time, time_of_day


@example("x" * 200)
@given(st.text())
def test_a_name_is_short_and_of_plain_letters_whatever_it_was(name):
    safe = plain(name)
    assert 1 <= len(safe) <= 32 and safe.isascii() and not set(safe) & set(" ,;*$!\\^~\"'=\r\n")


def test_words_name_the_source_the_kind_of_yaw_and_every_flag():
    assert in_words(message(flags=["gap", "stuck"], yaw="magnetic")) == "linux:1; yaw magnetic; gap stuck"
    assert in_words(message(src="fake:tilt")) == "fake:tilt is not a real chip; yaw relative; ok"


def test_words_are_said_again_when_time_begins_anew():
    told = Told()
    assert [told.due("ok", t_ns=t_ns) for t_ns in (100 * NS_PER_S, 101 * NS_PER_S, 3, 4)] == [True, False, True, False]


@pytest.mark.parametrize(
    ("unix_ns", "day", "iso"),
    [
        (0, "000000.000", "1970-01-01T00:00:00.000Z"),
        (1_700_000_000_999_999_999, "221320.999", "2023-11-14T22:13:20.999Z"),
        (951_827_696_007_000_000, "123456.007", "2000-02-29T12:34:56.007Z"),
    ],
)
def test_times_are_cut_and_never_rounded_into_the_next_second(unix_ns, day, iso):
    assert (time_of_day(unix_ns), iso_time(unix_ns)) == (day, iso)
