"""The FIFO, byte by byte."""

from __future__ import annotations

from collections import deque

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from hw_fakes import TYPICAL, Still
from hw_fakes.chip.fifo import Fifo

LEANING = Still(roll_deg=30.0, pitch_deg=-20.0)


@given(st.lists(st.one_of(st.binary(max_size=700), st.integers(1, 1100), st.none()), max_size=30))
def test_fifo_is_a_queue_of_1024_bytes_that_drops_the_oldest(steps):
    fifo, model, last = Fifo(), deque(maxlen=1024), 0
    for step in steps:
        if step is None:
            fifo.clear()
            model.clear()
        elif isinstance(step, bytes):
            assert fifo.push(step) == (len(model) + len(step) > 1024)
            model.extend(step)
        else:
            expected = []
            for _ in range(step):
                last = model.popleft() if model else last
                expected.append(last)
            assert fifo.pop(step) == bytes(expected)
        assert len(fifo) == len(model)


@given(st.lists(st.one_of(st.binary(max_size=700), st.integers(1, 1100)), max_size=30))
def test_fifo_that_stops_keeps_the_oldest(steps):
    fifo, model = Fifo(), b""
    fifo.stops = True
    for step in steps:
        if isinstance(step, bytes):
            assert fifo.push(step) == (len(model) + len(step) > 1024)
            model = (model + step)[:1024]
        else:
            fifo.pop(step)
            model = model[step:]
        assert bytes(fifo.content) == model


def test_frame_is_in_the_order_of_the_register_numbers(make_board):
    board = make_board(motion=LEANING)
    board.wake()
    board.start_fifo(0xF8)
    board.wait_ms(5)
    frames = board.drain()
    assert len(frames) == 5
    assert np.array_equal(frames[-1], board.sensors())
    assert frames[0, 0] > 0 and frames[0, 1] > 0 and frames[0, 2] > 0


@pytest.mark.parametrize(
    ("mask", "words"),
    [(0x08, [0, 1, 2]), (0x80, [3]), (0x40, [4]), (0x20, [5]), (0x10, [6]), (0x78, [0, 1, 2, 4, 5, 6]), (0x90, [3, 6])],
)
def test_each_bit_of_fifo_en_sends_its_words(make_board, mask, words):
    board = make_board(motion=LEANING)
    board.wake(gyro=0xE0)  # self-test, so that the three gyroscope words differ
    board.start_fifo(mask)
    board.wait_ms(3)
    frames = board.drain(len(words))
    assert len(frames) == 3
    assert np.array_equal(frames[-1], board.sensors()[words])


# Some of the frames that FIFO_EN can make, and what of one is left over in 1024 bytes.
@pytest.mark.parametrize(
    ("mask", "frame", "slip"),
    [(0x80, 2, 0), (0x60, 4, 0), (0x08, 6, 4), (0x88, 8, 0), (0x68, 10, 4), (0x78, 12, 4), (0xF8, 14, 2)],
)
def test_overflow_leaves_the_head_inside_a_frame(make_board, mask, frame, slip):
    board = make_board(motion=LEANING)
    board.wake()
    board.start_fifo(mask)
    board.wait_ms(600)
    assert board.fifo_count() == 1024
    assert board.byte(0x3A) & 0x10
    print(f"\nFIFO_EN 0x{mask:02x}: frames of {frame} bytes, the head is {1024 % frame} bytes before one")
    assert 1024 % frame == slip
    data = board.rd(0x74, 1024)
    # The newest byte is the end of a frame, so frames begin `slip` bytes after the head.
    whole = data[slip:]
    assert whole == whole[:frame] * (len(whole) // frame)
    assert data[:slip] == whole[frame - slip : frame]


def test_overflow_begins_with_the_first_byte_lost(board):
    board.wake()
    board.start_fifo(0xF8)
    board.wait_ms(73)
    assert board.fifo_count() == 73 * 14
    assert not board.byte(0x3A) & 0x10
    board.wait_ms(1)
    assert board.fifo_count() == 1024
    assert board.byte(0x3A) & 0x10


def test_a_fifo_just_full_has_lost_nothing(board):
    board.wake()
    board.start_fifo(0x48)  # frames of 8 bytes
    board.wait_ms(128.05)
    assert board.fifo_count() == 1024
    assert not board.byte(0x3A) & 0x10
    board.wait_ms(1)
    assert board.byte(0x3A) & 0x10


def test_a_long_pause_gives_the_newest_samples(make_board):
    def newest(step_ms):
        board = make_board(pll_error=0.003, imperfections=TYPICAL)
        board.wake(div=1)
        board.start_fifo()
        for _ in range(int(3000 / step_ms)):
            board.wait_ms(step_ms)
            board.chip.write(b"\x75")  # a look, on no wire: it takes no time
            board.chip.stop()
        return board.chip.samples_taken, bytes(board.chip.fifo.content)

    assert newest(3000) == newest(10)


def test_count_that_changes_between_its_two_bytes_is_latched_by_the_high_one(board):
    board.wake()
    board.start_fifo()
    board.wait_ms(18)
    high = board.byte(0x72)
    board.wait_ms(5)
    low = board.byte(0x73)
    assert high << 8 | low == 18 * 14
    assert board.byte(0x73) == low
    assert board.fifo_count() > 18 * 14


def test_empty_fifo_repeats_its_last_byte(board):
    board.wake()
    board.start_fifo(0x08)
    board.wait_ms(1)
    assert board.rd(0x74, 10) == bytes([0, 0, 0, 0, 0x40, 0, 0, 0, 0, 0])


def test_a_byte_written_to_the_fifo_comes_out_again(board):
    board.wake()
    board.wr(0x6A, 0x40)
    board.wr(0x74, 0xA5, 0x5A)
    assert board.fifo_count() == 2
    assert board.rd(0x74, 4) == bytes([0xA5, 0x5A, 0x5A, 0x5A])


def test_fifo_reset_is_ignored_while_the_fifo_is_on(board):
    board.wake()
    board.start_fifo()
    board.wait_ms(10)
    board.wr(0x6A, 0x44)
    assert board.fifo_count() >= 140
    board.wr(0x6A, 0x04)
    assert board.fifo_count() == 0
    assert board.byte(0x6A) == 0


def test_fifo_that_is_off_neither_fills_nor_gives_but_keeps_what_it_has(board):
    board.wake()
    board.start_fifo()
    board.wait_ms(10)
    board.wr(0x6A, 0x00)
    count = board.fifo_count()
    board.wait_ms(50)
    board.rd(0x74, 28)
    assert board.fifo_count() == count >= 140


def test_a_burst_that_reaches_the_fifo_register_pops_it_and_stays_there(board):
    board.wake(div=9)
    board.start_fifo(0x08)
    board.wait_ms(42)
    data = board.rd(0x72, 2 + 12)
    assert data[:2] == bytes([0, 24])
    assert data[2:] == bytes([0, 0, 0, 0, 0x40, 0]) * 2
    assert board.fifo_count() == 12
    board.rd(0x70, 6)  # a dump of the registers around it loses data
    assert board.fifo_count() == 10


@given(steps_ms=st.lists(st.floats(0.1, 60.0), min_size=1, max_size=12))
@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None, max_examples=30)
def test_samples_do_not_depend_on_how_often_one_looks(make_board, steps_ms):
    def stream(steps):
        board = make_board(imperfections=TYPICAL, seed=3)
        board.wake(dlpf=3, div=4)
        board.start_fifo()
        for step_ms in steps:
            board.wait_ms(step_ms)
            board.chip.write(b"\x3a")
            board.chip.read(15)
            board.chip.stop()
        return bytes(board.chip.fifo.content)

    assert stream(steps_ms) == stream([sum(round(ms * 1e6) for ms in steps_ms) * 1e-6])
