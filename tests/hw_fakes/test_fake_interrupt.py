"""The INT pin: level, pulse or latch, and the times of its edges."""

from __future__ import annotations

from itertools import pairwise

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from hw_fakes.chip.personalities import MPU6500

ACTIVE_LOW, OPEN_DRAIN, LATCHED, ANY_READ_CLEARS = 0x80, 0x40, 0x20, 0x10
DATA_READY, OVERFLOW = 0x01, 0x10


def times(board, *, high, since_ns=0):
    return [edge.t_ns for edge in board.chip.int_edges(since_ns) if edge.high == high]


def configured(board, pin, enable, *, div=9, dlpf=1):
    board.wake(div=div, dlpf=dlpf)
    board.wr(0x37, pin, enable)
    return board


def test_pin_stays_inactive_where_no_interrupt_is_enabled(board):
    configured(board, 0x00, 0x00)
    board.start_fifo()
    board.wait_ms(1000)
    assert board.byte(0x3A) == 0x11
    assert not board.chip.int_level()
    assert board.chip.int_edges(0) == []


@pytest.mark.parametrize(("pin", "high"), [(0x00, True), (ACTIVE_LOW, False), (OPEN_DRAIN | ACTIVE_LOW, False)])
def test_pulse_lasts_50_us_at_the_level_asked_for(board, pin, high):
    configured(board, pin, DATA_READY)
    start_ns = board.clock.now_ns()
    board.clock.sleep_until_ns(start_ns + 11_000_000)
    begins = times(board, high=high, since_ns=start_ns)
    assert len(begins) == 1
    for after_ns, level in ((-1, not high), (0, high), (49_999, high), (50_000, not high)):
        board.clock.sleep_until_ns(begins[0] + 10_000_000 + after_ns)
        assert board.chip.int_level() == level


@pytest.mark.parametrize(("dlpf", "div", "rate_hz"), [(1, 9, 100), (1, 0, 1000), (0, 0, 8000), (0, 2, 8000 / 3)])
@pytest.mark.parametrize("error", [0.0, -0.013])
def test_pulses_come_at_the_sample_rate_and_none_is_lost_however_rarely_one_looks(
    make_board, dlpf, div, rate_hz, error
):
    board = configured(make_board(pll_error=error), 0x00, DATA_READY, div=div, dlpf=dlpf)
    start_ns = board.clock.now_ns()
    board.wait_ms(500)
    begins = times(board, high=True, since_ns=start_ns)
    period_ns = 1e9 / (rate_hz * (1 + error))
    assert len(begins) == pytest.approx(5e8 / period_ns, abs=1)
    for n, t_ns in enumerate(begins):
        assert t_ns == pytest.approx(begins[0] + n * period_ns, abs=1.001)
    assert [t + 50_000 for t in begins[:-1]] == times(board, high=False, since_ns=begins[0])[: len(begins) - 1]


def test_edges_of_the_last_moment_are_had_after_a_day_without_the_day(board):
    configured(board, 0x00, DATA_READY, div=0)
    board.clock.advance_ns(86_400_000_000_000)
    now_ns = board.clock.now_ns()
    edges = board.chip.int_edges(now_ns - 10_000_000)
    assert len(edges) in (20, 21)
    assert all(now_ns - 10_000_000 <= edge.t_ns <= now_ns for edge in edges)
    assert len(board.chip._pin._history) < 10


def test_an_edge_comes_when_the_data_ready_bit_does(board):
    configured(board, LATCHED, DATA_READY)
    board.byte(0x3A)
    board.wait_ms(25)
    (t_ns,) = times(board, high=True, since_ns=board.clock.now_ns() - 24_000_000)
    board.byte(0x3A)
    board.clock.sleep_until_ns(t_ns + 29_999_999)
    board.chip.write(b"\x3a")
    assert board.chip.read(1) == b"\x01"  # of the two samples between
    board.chip.stop()
    board.clock.sleep_until_ns(t_ns + 30_000_000)
    board.chip.write(b"\x3a")
    assert board.chip.read(1) == b"\x01"
    board.chip.stop()


def test_latched_pin_stays_until_the_status_is_read(board):
    configured(board, LATCHED, DATA_READY)
    board.wait_ms(11)
    assert board.chip.int_level()
    board.wait_ms(100)
    board.sensors()
    assert board.chip.int_level()
    before_ns = board.clock.now_ns()
    board.byte(0x3A)
    assert not board.chip.int_level()
    assert times(board, high=False) == [before_ns]
    board.wait_ms(10)
    assert board.chip.int_level()
    assert len(times(board, high=True)) == 2


def test_latched_pin_is_released_by_any_read_where_that_was_asked_for(board):
    configured(board, LATCHED | ANY_READ_CLEARS | ACTIVE_LOW, DATA_READY)
    board.wait_ms(11)
    assert not board.chip.int_level()
    board.sensors()
    assert board.chip.int_level()


def test_one_reading_the_data_only_gets_no_second_edge_from_a_latched_pin(board):
    configured(board, LATCHED, DATA_READY)
    for _ in range(50):
        board.wait_ms(10)
        board.sensors()
    assert len(board.chip.int_edges(0)) == 1


def test_overflow_moves_the_pin_at_the_sample_that_loses_bytes(board):
    configured(board, LATCHED, OVERFLOW, div=0)
    board.start_fifo()
    board.wait_ms(73)
    assert not board.chip.int_level()
    board.wait_ms(200)
    assert board.chip.int_level()
    (t_ns,) = times(board, high=True)
    # Time 0 of the samples is the waking write; the frames that fit are 73 of 14 bytes.
    board.byte(0x3A)
    again = type(board)()
    configured(again, LATCHED, OVERFLOW, div=0)
    again.start_fifo()
    again.clock.sleep_until_ns(t_ns - 1)
    assert again.fifo_count() == 73 * 14
    again.clock.sleep_until_ns(t_ns + 200_000)
    assert again.fifo_count() == 1024


def test_overflow_pulses_with_each_sample_that_loses_bytes(board):
    configured(board, 0x00, OVERFLOW, div=0)
    board.start_fifo()
    board.wait_ms(80)
    assert len(times(board, high=True)) == 80 - 73
    board.byte(0x3A)
    board.rd(0x74, 1024)
    count = len(times(board, high=True))
    board.wait_ms(50)
    assert len(times(board, high=True)) == count


def test_byte_too_many_written_to_the_fifo_moves_the_pin(board):
    configured(board, LATCHED, OVERFLOW)
    board.wr(0x6A, 0x40)
    board.wr(0x74, *bytes(1024))
    assert not board.chip.int_level()
    board.wr(0x74, 1)
    assert board.chip.int_level()


def test_turning_the_pin_over_turns_its_level_over(board):
    board.wake()
    assert not board.chip.int_level()
    now_ns = board.clock.now_ns()
    board.wr(0x37, ACTIVE_LOW)
    assert board.chip.int_level()
    assert [(e.t_ns, e.high) for e in board.chip.int_edges(0)] == [(now_ns, True)]


def test_reset_and_sleep_release_the_pin_or_keep_it_latched(board):
    configured(board, LATCHED, DATA_READY)
    board.wait_ms(11)
    board.wr(0x6B, 0x40)
    assert board.chip.int_level()
    board.wr(0x6B, 0x80)
    assert not board.chip.int_level()


def test_within_a_transaction_the_pin_keeps_the_samples_of_its_beginning(board):
    configured(board, LATCHED, DATA_READY)
    board.byte(0x3A)
    board.chip.write(b"\x3b")
    board.chip.read(7)
    board.wait_ms(20)
    assert not board.chip.int_level()
    board.chip.read(7)
    board.chip.stop()
    assert board.chip.int_level()


@given(
    pins=st.lists(st.sampled_from([0x00, ACTIVE_LOW, LATCHED, LATCHED | ACTIVE_LOW, LATCHED | 0x10]), min_size=1),
    gaps_us=st.lists(st.integers(20, 4000), min_size=1, max_size=40),
)
@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None, max_examples=40)
def test_edges_alternate_in_time_and_end_at_the_level(make_board, pins, gaps_us):
    board = configured(make_board(), 0x00, DATA_READY | OVERFLOW, div=0)
    board.start_fifo()
    for k, gap_us in enumerate(gaps_us):
        board.wait_ms(gap_us / 1000)
        if k % 3 == 0:
            board.wr(0x37, pins[k % len(pins)])
        elif k % 3 == 1:
            board.byte(0x3A)
        level = board.chip.int_level()
        edges = board.chip.int_edges(0)
        assert all(a.t_ns < b.t_ns and a.high != b.high for a, b in pairwise(edges))
        assert (edges[-1].high if edges else False) == level


def test_pulses_at_32_khz_do_not_run_into_one_another(make_board):
    board = configured(make_board(personality=MPU6500), 0x00, DATA_READY)
    board.wr(0x1B, 0x01)
    since_ns = board.clock.now_ns()
    board.wait_ms(5)
    edges = board.chip.int_edges(since_ns)
    assert len(edges) == pytest.approx(2 * 5 * 32, abs=2)
    assert all(a.t_ns < b.t_ns and a.high != b.high for a, b in pairwise(edges))
