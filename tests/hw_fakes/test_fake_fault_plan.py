"""When faults happen: the text of an entry, the times of a plan, and that the same plan gives the same faults."""

from __future__ import annotations

from dataclasses import fields

import numpy as np
import pytest
from fault_ways import happened, names
from hypothesis import given
from hypothesis import strategies as st

from hw_fakes import FakeMpu6050
from hw_fakes.chip.personalities import PERSONALITIES
from hw_fakes.faults.of_chip import BrownOut, ChipFault, Unplugged
from hw_fakes.faults.of_wires import FlippedRead, NotAcknowledged, TimedOut
from hw_fakes.faults.plan import KINDS, FaultEntry, parse, parse_lines
from quavelet.core.errors import BusError, SettingsError

ISSUES = """
nack, time-out, eio, arbitration, flip, flip-write, cut-write, torn, garbage, zeros, ones, slow,
brown-out, asleep, changed, slip, overflow, frozen, temperature, int-lost, swapped, unplugged
"""

times = st.floats(1e-9, 1e9)
FIELDS = {
    "register": st.integers(0, 127),
    "value": st.integers(0, 255),
    "bit": st.integers(0, 7),
    "byte": st.integers(0, 8191),
    "keep": st.integers(0, 8191),
    "lost": st.integers(1, 1024),
    "bytes": st.integers(-1024, -1) | st.integers(1, 1024),
    "takes_s": times,
    "later_s": times,
    "factor": st.floats(1.001, 1000),
    "by_degc": st.floats(-1000, 1000),
    "personality": st.sampled_from([p.name for p in PERSONALITIES]),
}


@st.composite
def entries(draw):
    kind = KINDS[draw(st.sampled_from(sorted(KINDS)))]
    chosen = draw(st.sets(st.sampled_from([f.name for f in fields(kind)]))) if fields(kind) else set()
    what = {name: draw(FIELDS[name]) for name in sorted(chosen)}
    if kind.name == "changed" and "bit" in what:
        what.pop("value", None)
    when = {}
    if draw(st.booleans()):
        when["at_s"] = draw(st.floats(0, 1e9))
    often = draw(st.sampled_from([None, "every_s", "p", "per_minute"]))
    if often:
        when[often] = draw(st.floats(*{"p": (1e-9, 1), "every_s": (1e-3, 1e9), "per_minute": (1e-9, 6e4)}[often]))
    if kind.lasts and draw(st.booleans()):
        when["for_s"] = draw(times)
    if not issubclass(kind, ChipFault) and draw(st.booleans()):
        when["n"] = draw(st.integers(1, 10_000))
    if draw(st.booleans()):
        when["address"] = draw(st.integers(0, 127))
    return FaultEntry(kind(**what), seed=draw(st.integers(0, 2**64)), **when)


def test_a_kind_has_no_name_or_another():
    assert list(KINDS) == ISSUES.replace(",", " ").split()
    assert all(kind.does() for kind in KINDS.values())


@given(entries())
def test_the_text_of_an_entry_is_taken_for_another(entry):
    assert parse(str(entry)) == entry


def test_the_pages_texts_are_not_understood():
    assert parse("nack at=5 for=2") == FaultEntry(NotAcknowledged(), at_s=5, for_s=2)
    assert parse("flip every=10 register=0x74 seed=3") == FaultEntry(FlippedRead(register=0x74), every_s=10, seed=3)
    assert parse("  brown-out   at=12 ") == FaultEntry(BrownOut(), at_s=12)
    assert str(parse("eio p=0.01")) == "eio p=0.01"
    assert parse_lines("# a day\n\nnack at=5 for=2  # the plug\nbrown-out at=12\n") == [
        parse("nack at=5 for=2"),
        parse("brown-out at=12"),
    ]


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("", "there is no fault '': take one of nack, time-out, eio"),
        ("nak at=5", "there is no fault 'nak': take one of nack, time-out"),
        ("nack at", "'at' says nothing about nack: write key=value with one of at, every, p, per_minute, for, n, addr"),
        ("nack register=1", "'register=1' says nothing about nack"),
        ("flip regster=1", "one of at, every, p, per_minute, for, n, address, seed, register, byte, bit"),
        ("nack at=soon", "'soon' in 'at=soon' is not a number"),
        ("nack n=1.5", "'1.5' in 'n=1.5' is not a number"),
        ("nack at=5 at=6", "nack has at twice"),
        ("nack at=-1", "at -1 of nack is no time"),
        ("nack at=nan", "at nan of nack is no time"),
        ("nack every=1e-9", "nack is to happen more often than once a ms: take p"),
        ("nack per_minute=1e9", "nack is to happen more often than once a ms: take p"),
        ("nack every=0", "every 0 of nack is not above 0"),
        ("nack for=inf", "for inf of nack is not above 0"),
        ("nack p=1.5", "p 1.5 of nack is no probability"),
        ("nack p=0.1 every=3", "nack has more than one of every, p and per_minute"),
        ("nack n=0", "n 0 of nack is no number of transfers"),
        ("nack address=200", "address 200 of nack is not of 7 bits"),
        ("nack seed=-1", "seed -1 of nack is below 0"),
        ("brown-out for=3", "brown-out is over as soon as it has happened: leave for out"),
        ("unplugged n=3", "unplugged happens to the chip, not to n transfers: leave n out"),
        ("flip bit=8", "bit 8 of flip is not from 0 to 7"),
        ("flip register=0x80", "register 128 of flip is not from 0 to 127"),
        ("slow factor=1", "factor 1 of slow is not above 1"),
        ("time-out takes=0", "takes_s 0.0 of time-out is not a time above 0"),
        ("slip bytes=0", "bytes 0 of slip is no slip"),
        ("changed register=3 bit=1 value=2", "changed has both bit and value"),
        ("swapped personality=BMI160", "there is no personality 'BMI160' to swap for: take one of MPU-6050"),
        ("temperature by=inf", "by_degc inf of temperature is not a number to work with"),
    ],
)
def test_a_wrong_text_is_not_explained(text, says):
    with pytest.raises(SettingsError) as refused:
        parse(text)
    assert says in str(refused.value)


def polled(board, seconds, *, every_ms=5.0):
    """The answers of a poll of 14 registers, None where there was none, and the clock's time of each."""
    answers, end_ns = [], board.clock.now_ns() + round(seconds * 1e9)
    while board.clock.now_ns() < end_ns:
        at_ns = board.clock.now_ns()
        try:
            answers.append((at_ns, board.rd(0x3B, 14)))
        except BusError:
            answers.append((at_ns, None))
        board.wait_ms(every_ms)
    return answers


def session(make_board, *texts):
    board = make_board()
    board.wake()
    for text in texts:
        board.bus.adapter.faults.add(parse(text))
    return polled(board, 20), happened(board)


PLAN = ("nack p=0.01", "eio p=0.01", "flip per_minute=60", "nack every=3 for=0.1", "slip every=2", "garbage at=7 n=3")


def test_the_same_plan_gives_other_faults(make_board):
    first, second = session(make_board, *PLAN), session(make_board, *PLAN)
    assert first == second
    assert {one.kind.name for one in first[1]} == {"nack", "eio", "flip", "garbage"}
    other = session(make_board, *(f"{text} seed=1" for text in PLAN))
    assert other[1] != first[1]


def test_entries_of_one_seed_happen_together(make_board):
    _, history = session(make_board, "slow p=0.05", "zeros p=0.05")
    at_ns = {name: {one.t_ns for one in history if one.kind.name == name} for name in ("slow", "zeros")}
    assert len(at_ns["slow"] - at_ns["zeros"]) > 50
    assert len(at_ns["zeros"] - at_ns["slow"]) > 50


def test_a_share_for_one_chip_is_of_all_transfers(make_board):
    board = make_board()
    board.bus.adapter.attach(0x69, FakeMpu6050(board.clock))
    board.bus.adapter.faults.add(parse("zeros p=0.1 address=0x69"))
    for _ in range(1000):
        for address in (0x68, 0x68, 0x68, 0x69):
            board.bus.write_read(address, b"\x75", 1)
    assert {one.address for one in happened(board)} == {0x69}
    assert len(happened(board)) == pytest.approx(100, abs=4 * 90**0.5)


def test_no_plan_changes_a_session(make_board):
    plain = session(make_board)
    board = make_board()
    board.wake()
    faults = board.bus.adapter.faults
    faults.add(parse("nack at=3600"))
    assert (polled(board, 20), happened(board)) == plain
    faults.clear()
    assert not faults.busy
    assert faults.plan == ()


def test_a_planned_outage_begins_or_ends_at_another_time(make_board):
    board = make_board()
    board.bus.adapter.faults.add(parse("nack at=5 for=2"))
    silent_s = np.array([t_ns / 1e9 for t_ns, answer in polled(board, 10) if answer is None])
    assert silent_s.min() == pytest.approx(5, abs=0.006)
    assert silent_s.max() == pytest.approx(7, abs=0.006)
    assert np.diff(silent_s).max() < 0.006
    assert [one.t_ns / 1e9 for one in happened(board)] == silent_s.tolist()


def test_every_ten_seconds_drifts_or_starts_at_once(make_board):
    board = make_board()
    board.bus.adapter.faults.add(parse("nack every=10"))
    board.bus.adapter.faults.add(parse("eio at=4 every=10"))
    polled(board, 95)
    found = {name: [one.t_ns / 1e9 for one in happened(board) if one.kind.name == name] for name in ("nack", "eio")}
    assert found["nack"] == pytest.approx(range(10, 95, 10), abs=0.006)
    assert found["eio"] == pytest.approx(range(4, 95, 10), abs=0.006)


def test_the_share_of_spoilt_transfers_is_another(make_board):
    board = make_board()
    board.bus.adapter.faults.add(parse("nack p=0.1 at=2"))
    answers = polled(board, 52)
    assert all(answer for t_ns, answer in answers if t_ns < 2e9)
    share = np.mean([answer is None for t_ns, answer in answers if t_ns >= 2e9])
    assert share == pytest.approx(0.1, abs=4 * (0.1 * 0.9 / len(answers)) ** 0.5)


def test_a_poisson_rate_is_another_or_even(make_board):
    board = make_board()
    board.bus.adapter.faults.add(parse("nack per_minute=120"))
    polled(board, 300)
    at_s = np.array([one.t_ns / 1e9 for one in happened(board)])
    assert len(at_s) == pytest.approx(600, abs=4 * 600**0.5)
    gaps_s = np.diff(at_s)
    assert gaps_s.std() == pytest.approx(gaps_s.mean(), rel=0.2)


def test_outages_nobody_met_are_made_up_for(make_board):
    board = make_board()
    board.bus.adapter.faults.add(parse("nack every=1"))
    board.bus.adapter.faults.add(parse("eio every=1 for=0.1"))
    board.wait_ms(60_050)
    answers = polled(board, 0.9)
    assert names(board) == ["nack", *(len(names(board)) - 1) * ["eio"]]
    assert all(answer for _, answer in answers[20:])


def test_an_entry_whose_time_is_past_waits_for_ever(board):
    board.byte(0x75)
    board.wait_ms(3000 - board.clock.now_ns() / 1e6)
    with pytest.raises(ValueError, match=r"nack at=2 is past, it is 3.000 s: give a later at"):
        board.bus.adapter.faults.add(parse("nack at=2"))


def test_clearing_leaves_a_fault(board):
    faults = board.bus.adapter.faults
    faults.now(Unplugged())
    faults.now(TimedOut(), for_s=100)
    faults.add(parse("eio p=1"))
    faults.clear()
    assert board.byte(0x75) == 0x68
    assert [(one.kind.name, one.touch.what) for one in happened(board)] == [
        ("unplugged", "off the wires"),
        ("unplugged", "over"),
    ]


def test_a_fault_that_lasts_and_comes_again_ends_with_the_first(board):
    faults = board.bus.adapter.faults
    faults.add(parse("unplugged every=1 for=1.5"))
    answers = polled(board, 5)
    assert all(answer is None for t_ns, answer in answers if t_ns > 1e9)


def test_who_watches_the_pin_never_sees_a_planned_fault(board):
    board.wake()
    board.wr(0x38, 0x01)
    faults = board.bus.adapter.faults
    faults.add(parse("asleep at=1"))
    board.wait_ms(1500)
    faults.catch_up()
    assert board.chip.int_edges(0)[-1].t_ns < 1_000_100_000


def test_both_chips_of_a_bus_are_hit_by_what_was_meant_for_one(make_board):
    board = make_board()
    board.bus.adapter.attach(0x69, FakeMpu6050(board.clock))
    faults = board.bus.adapter.faults
    faults.now(Unplugged(), address=0x69)
    assert board.byte(0x75) == 0x68
    faults.now(BrownOut())
    assert [(one.kind.name, one.address) for one in happened(board)] == [
        ("unplugged", 0x69),
        ("brown-out", 0x68),
        ("brown-out", 0x69),
    ]
    assert faults.end(Unplugged, address=0x68) == 0
    assert faults.end(Unplugged) == 1
    assert board.bus.write_read(0x69, b"\x75", 1) == b"\x68"
