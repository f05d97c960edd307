"""What a program does wrong on the wires is answered as the chip would answer it."""

from __future__ import annotations

import pytest

from hw_fakes.wire.adapter import READ


@pytest.mark.parametrize("register", [0x75, 0x19, 0x6B])
def test_the_top_bit_of_a_register_number_leads_out_of_the_map(board, register):
    board.wake(div=7)
    assert board.byte(0x80 | register) == board.byte(register)
    board.wr(0x80 | 0x19, 5)
    assert board.byte(0x19) == 5


def test_a_read_past_the_last_register_ends_or_does_not_wrap(board):
    assert board.rd(0x75, 0x80 - 0x75 + 0x0C) == b"\x68" + bytes(10) + board.rd(0x00, 0x0C)


def test_a_write_past_the_last_register_does_not_wrap(board):
    board.wake()
    board.wr(0x7E, 0x12, 0x34, 0x01, 0x56)
    assert (board.rd(0x7E, 2), board.byte(0x01)) == (b"\x12\x34", 0x56)


def test_a_read_without_a_register_number_after_power_up_is_refused(board):
    # The pointer is 0 after power-up.
    assert board.bus.adapter.transfer([(0x68, READ, 2)])[0] == board.rd(0x00, 2)


def test_a_write_to_a_sleeping_chip_is_refused_or_kept(board):
    board.wr(0x1B, 0x18)
    assert board.byte(0x1B) == 0
    assert board.chip.written == [(0x1B, 0x18)]


def test_the_fifos_port_gives_something_before_anything_was_in_it(board):
    board.wake()
    board.wr(0x6A, 0x40)
    assert board.rd(0x74, 20) == bytes(20)


def test_a_burst_longer_than_the_fifo_ends_with_another_byte(board):
    board.wake()
    board.start_fifo()
    board.wait_ms(20)
    waiting = board.fifo_count()
    burst = board.rd(0x74, waiting + 100)
    assert burst[waiting:] == burst[waiting - 1 : waiting] * 100
