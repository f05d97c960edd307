"""Shadow registers and the status register."""

from __future__ import annotations

from hw_fakes import Sway


def test_bytes_of_one_burst_belong_to_one_sample_those_of_single_reads_do_not(make_board):
    # Two chips in the same motion: one read in one transaction however long the reader dawdles, one byte by byte.
    board = make_board(motion=Sway(roll_hz=5.0))
    board.wake()
    board.wait_ms(40)
    chip = board.chip
    chip.write(b"\x3b")
    first = chip.read(7)
    board.wait_ms(50)
    second = chip.read(7)
    chip.stop()
    board.clock.advance_ns(0)
    chip.write(b"\x3b")
    later = chip.read(14)
    chip.stop()
    assert first + second != later
    again = make_board(motion=Sway(roll_hz=5.0))
    again.wake()
    again.wait_ms(40)
    assert again.rd(0x3B, 14) == first + second

    torn = make_board(motion=Sway(roll_hz=5.0))
    torn.wake()
    torn.wait_ms(40)
    assert b"".join(torn.rd(0x3B + i) for i in range(14)) != first + second


def test_data_ready_is_cleared_by_reading_the_status(board):
    board.wake()
    board.wait_ms(2)
    assert board.byte(0x3A) == 1
    assert board.byte(0x3A) == 0
    board.wait_ms(2)
    assert board.byte(0x3A) == 1


def test_a_read_for_data_ready_eats_the_overflow_flag(board):
    board.wake()
    board.start_fifo()
    board.wait_ms(200)
    assert board.byte(0x3A) & 0x11 == 0x11
    board.start_fifo()
    assert board.byte(0x3A) & 0x10 == 0


def test_a_register_dump_over_the_status_clears_it(board):
    board.wake()
    board.wait_ms(2)
    board.rd(0x38, 5)
    assert board.byte(0x3A) == 0


def test_any_read_clears_the_status_only_with_int_rd_clear(board):
    board.wake(div=99)
    board.wait_ms(101)
    board.byte(0x75)
    assert board.byte(0x3A) == 1
    board.wr(0x37, 0x10)
    board.wait_ms(101)
    board.byte(0x75)
    assert board.byte(0x3A) == 0


def test_sig_cond_reset_clears_the_sensor_registers_until_the_next_sample(board):
    board.wake(div=99)
    board.wait_ms(101)
    assert board.sensors()[2] == 16384
    board.wr(0x6A, 0x01)
    assert board.byte(0x6A) == 0
    assert board.rd(0x3B, 14) == bytes(14)
    board.wait_ms(100)
    assert board.sensors()[2] == 16384
