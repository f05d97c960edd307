"""What a fault, or a change of motion, takes hold of: samples as they show, samples computed ahead, the INT pin."""

from __future__ import annotations

import numpy as np

from hw_fakes import Still, Turntable


def test_spoilt_words_show_in_one_place_and_not_in_the_other(board):
    board.wake()
    board.start_fifo()
    board.chip.spoil_words = lambda words: words // 2
    board.wait_ms(20)
    assert board.sensors()[2] == 8192
    frames = board.drain()
    assert len(frames) > 10
    assert (frames[:, 2] == 8192).all()
    board.chip.spoil_words = None
    board.drain()  # what was taken while the FIFO was read
    board.wait_ms(5)
    assert board.sensors()[2] == 16384
    assert (board.drain()[:, 2] == 16384).all()


def test_only_the_words_of_the_fifo_are_spoilt_in_it(board):
    board.wake()
    board.start_fifo(0x70)
    board.chip.spoil_words = lambda words: np.tile(np.arange(7, dtype=np.int16), (len(words), 1))
    board.wait_ms(20)
    assert (board.drain(words=3) == [4, 5, 6]).all()


def test_a_changed_motion_shows_only_after_what_was_computed_ahead(make_board):
    board = make_board(motion=Turntable(start_s=0.0))
    board.wake()
    board.wait_ms(3000)
    assert board.sensors()[6] == 30 * 131
    board.chip.source.motion = Still()
    board.wait_ms(2)
    assert board.sensors()[6] == 30 * 131
    board.chip.recompute()
    board.wait_ms(2)
    assert board.sensors()[6] == 0


def test_a_pin_that_is_cut_off_still_shows_interrupts(board):
    board.wake()
    board.wr(0x38, 1)
    board.chip.int_connected = False
    begin_ns = board.clock.now_ns()
    board.wait_ms(20)
    assert board.chip.int_edges(begin_ns) == []
    board.chip.int_connected = True
    begin_ns = board.clock.now_ns()
    board.wait_ms(20)
    assert len(board.chip.int_edges(begin_ns)) >= 38


def test_a_latched_pin_that_is_cut_off_stays_active(board):
    board.wake()
    board.wr(0x37, 0x20, 1)
    board.wait_ms(5)
    assert board.chip.int_level()
    board.chip.int_connected = False
    assert not board.chip.int_level()
    board.wait_ms(5)
    assert not board.chip.int_level()
