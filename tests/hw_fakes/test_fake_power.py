"""Power, reset, and what a write may change."""

from __future__ import annotations

import pytest

from quavelet.core.errors import DeviceMissing


def test_chip_that_answers_before_it_is_woken_is_caught_by_zeros(board):
    board.wait_ms(500)
    assert board.byte(0x6B) == 0x40
    assert board.byte(0x75) == 0x68
    assert board.rd(0x3B, 14) == bytes(14)
    assert board.byte(0x3A) == 0
    assert board.chip.samples_taken == 0


def test_all_registers_reset_to_zero_except_those_of_the_factory(board):
    nonzero = {i for i, value in enumerate(board.rd(0x00, 0x72)) if value}
    assert nonzero <= {0x00, *range(0x06, 0x0C), *range(0x0D, 0x11), 0x6B}
    assert board.rd(0x0D, 4) == bytes([0x51, 0x4F, 0xB8, 0xA5])
    assert board.byte(0x00) & 1  # OTP_BNK_VLD: a Linux 6.1 driver drops all data where it is 0


def test_half_scale_silicon_is_not_what_the_revision_bits_say(board):
    offsets = board.rd(0x06, 6)
    revision = (offsets[5] & 1) << 2 | (offsets[3] & 1) << 1 | offsets[1] & 1
    assert revision == 2


def test_configuration_written_while_asleep_is_lost(board):
    for register in (0x19, 0x1A, 0x1B, 0x1C, 0x23, 0x37, 0x38, 0x06, 0x13):
        before = board.byte(register)
        board.wr(register, 0x09)
        assert board.byte(register) == before
    board.wr(0x6C, 0x07)
    assert board.byte(0x6C) == 0x07
    board.wr(0x6B, 0x01)
    board.wr(0x1B, 0x18)
    assert board.byte(0x1B) == 0x18


def test_reset_takes_100_ms_and_what_is_written_meanwhile_is_lost(board):
    board.wake(div=4)
    board.wr(0x6B, 0x80)
    board.wait_ms(50)
    assert board.byte(0x6B) == 0xC0
    board.wr(0x6B, 0x01)
    board.wr(0x19, 7)
    board.wait_ms(49)
    assert board.byte(0x6B) == 0xC0
    board.wait_ms(2)
    assert board.byte(0x6B) == 0x40
    assert board.byte(0x19) == 0
    assert board.rd(0x0D, 4) == bytes([0x51, 0x4F, 0xB8, 0xA5])


def test_reset_that_nacks_nacks_for_100_ms(make_board):
    board = make_board(nack_in_reset=True)
    board.wr(0x6B, 0x80)
    board.wait_ms(99)
    with pytest.raises(DeviceMissing) as caught:
        board.byte(0x75)
    assert caught.value.errno == 121
    board.wait_ms(1)
    assert board.byte(0x75) == 0x68


def test_reset_empties_the_fifo_and_puts_the_chip_to_sleep(board):
    board.wake()
    board.start_fifo()
    board.wait_ms(20)
    assert board.fifo_count() > 0
    board.wr(0x6B, 0x80)
    board.wait_ms(120)
    assert board.fifo_count() == 0
    assert board.rd(0x3B, 14) == bytes(14)


def test_power_cut_forgets_all_and_sleeps(board):
    board.wake(div=9)
    board.start_fifo()
    board.wait_ms(100)
    board.chip.power_cut()
    assert board.byte(0x6B) == 0x40
    assert board.byte(0x19) == 0
    assert board.fifo_count() == 0
    taken = board.chip.samples_taken
    board.wait_ms(100)
    assert board.rd(0x3B, 14) == bytes(14)
    assert board.chip.samples_taken == taken


def test_unplugged_chip_does_not_answer_and_keeps_its_configuration(board):
    board.wake(div=9)
    board.chip.unplug()
    with pytest.raises(DeviceMissing):
        board.byte(0x75)
    with pytest.raises(DeviceMissing):
        board.wr(0x19, 1)
    board.chip.plug()
    assert board.byte(0x19) == 9


def test_read_only_registers_ignore_writes_but_the_write_is_on_record(board):
    board.wake()
    board.wr(0x75, 0x12)
    board.wr(0x72, 0x01, 0x02)
    assert board.byte(0x75) == 0x68
    assert board.fifo_count() == 0
    assert (0x75, 0x12) in board.chip.written
    assert board.chip.written[-2:] == [(0x72, 0x01), (0x73, 0x02)]


@pytest.mark.parametrize(
    ("register", "reads"),
    [(0x1A, 0x3F), (0x1B, 0xF8), (0x37, 0xFE), (0x68, 0x00), (0x6B, 0x6F & ~0x40), (0x19, 0xFF), (0x23, 0xFF)],
)
def test_reserved_and_self_clearing_bits_do_not_stick(board, register, reads):
    board.wake()
    board.wr(register, 0xFF if register != 0x6B else 0x3F)
    assert board.byte(register) == (reads if register != 0x6B else 0x2F)


def test_burst_write_goes_on_to_the_next_register(board):
    board.wr(0x6B, 0x01, 0x07)
    board.wr(0x19, 9, 3, 0x18, 0x10)
    assert board.rd(0x19, 4) == bytes([9, 3, 0x18, 0x10])
    assert board.byte(0x6C) == 0x07


def test_pointer_of_the_last_write_serves_a_read_without_one(board):
    board.chip.write(b"\x75")
    board.chip.stop()
    assert board.chip.read(1) == b"\x68"
    board.chip.stop()


def test_sleep_set_again_stops_samples_and_zeroes_the_registers(board):
    board.wake()
    board.wait_ms(10)
    assert board.sensors()[2] == 16384
    board.wr(0x6B, 0x41)
    taken = board.chip.samples_taken
    board.wait_ms(100)
    assert board.rd(0x3B, 14) == bytes(14)
    assert board.chip.samples_taken == taken


def test_kernel_driver_probe_and_start_work(board):
    # The register writes of Linux's inv_mpu6050 as logged from a guest.
    board.wr(0x6B, 0x80)
    board.wait_ms(100)
    probe = "6B00 6B08 6C3F 1B18 1A04 1913 1C00 3700 3702 6B48"
    start = "6B08 6C00 6B09 6A04 2378 6A40 3801"
    for pair in f"{probe} {start}".split():
        board.wr(*bytes.fromhex(pair))
    board.wait_ms(101)
    assert board.byte(0x00) & 1
    assert board.fifo_count() == 5 * 12  # 50 Hz
    assert list(board.drain(6)[0]) == [0, 0, 16384, 0, 0, 0]


def test_a_register_flipped_from_outside_is_obeyed(board):
    board.wake()
    board.chip.registers[0x1C] = 0x18
    board.byte(0x75)
    board.wait_ms(10)
    assert board.sensors()[2] == 2048
