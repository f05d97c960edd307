"""The motion processor's memory, as the drivers that load a program into it use it."""

from __future__ import annotations

import random

import pytest

from hw_fakes.chip.personalities import MPU9250

BANK, START, DATA = 0x6D, 0x6E, 0x6F
PROGRAM = bytes(random.Random(7).randrange(256) for _ in range(3062))  # as long as the vendor's


def at(board, bank, start):
    board.wr(BANK, bank, start)


@pytest.mark.parametrize("block", [16, 8, 13, 64])
@pytest.mark.parametrize("chip", [{}, {"personality": MPU9250}])
def test_program_that_is_loaded_in_blocks_reads_back(make_board, block, chip):
    board = make_board(**chip)
    board.wake()
    cuts = [
        (bank, start, PROGRAM[256 * bank + start : 256 * bank + min(start + block, 256)])
        for bank in range(12)
        for start in range(0, 256, block)
    ]
    for bank, start, data in cuts:
        if data:
            at(board, bank, start)
            board.wr(DATA, *data)
    for bank, start, data in cuts:
        if data:
            at(board, bank, start)
            assert board.rd(DATA, len(data)) == data


def test_address_goes_on_byte_by_byte_and_stays_in_its_bank(board):
    board.wake()
    at(board, 3, 254)
    for value in (1, 2, 3):
        board.wr(DATA, value)
    assert board.byte(START) == 1
    at(board, 3, 254)
    assert [board.byte(DATA) for _ in range(3)] == [1, 2, 3]
    at(board, 4, 0)
    assert board.byte(DATA) == 0
    at(board, 3, 0)
    assert board.byte(DATA) == 3


def test_look_for_the_revision_in_the_user_bank_finds_nothing(board):
    board.wake()
    at(board, 0x70, 6)  # prefetch, user bank, bank 16
    board.wr(DATA, 0x55)
    at(board, 0x70, 6)
    assert board.byte(DATA) == 0


def test_memory_is_lost_with_a_reset(board):
    board.wake()
    at(board, 0, 0)
    board.wr(DATA, 0x55)
    board.wr(0x6B, 0x80)
    board.wait_ms(101)
    board.wake()
    at(board, 0, 0)
    assert board.byte(DATA) == 0


def test_loaded_program_does_not_run(board):
    board.wake()
    at(board, 0, 0)
    board.wr(DATA, *PROGRAM[:256])
    board.wr(0x70, 0x04, 0x00)
    board.wr(0x6A, 0xC4)
    board.wait_ms(200)
    assert board.fifo_count() == 0
    assert board.byte(0x39) == 0
