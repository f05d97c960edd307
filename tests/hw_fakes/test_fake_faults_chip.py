"""Each fault of the chip does what it says, seen through the bus, whichever way it comes about."""

from __future__ import annotations

import errno
from types import SimpleNamespace

import numpy as np
import pytest
from fault_ways import WAYS, happened, let_happen, names

from hw_fakes import TYPICAL, FakeBus, FakeMpu6050, Sway
from hw_fakes.boards import board as product
from hw_fakes.faults.of_chip import (
    BrownOut,
    Changed,
    FallenAsleep,
    FifoOverflow,
    FifoSlip,
    Frozen,
    NoInterrupts,
    Swapped,
    Unplugged,
    WrongTemperature,
)
from hw_fakes.faults.plan import FaultEntry
from quavelet.core.clock import VirtualClock
from quavelet.core.errors import DeviceMissing

pytestmark = pytest.mark.parametrize("way", WAYS)


@pytest.fixture
def board(make_board):
    board = make_board(motion=Sway(), imperfections=TYPICAL)
    board.wake(div=9)
    board.wait_ms(20)
    return board


def test_a_brown_out_leaves_the_chip_awake_or_set_up(board, way):
    board.start_fifo()
    board.wait_ms(50)
    let_happen(board, way, BrownOut())
    board.wait_ms(50)
    assert (board.byte(0x6B), board.byte(0x19), board.byte(0x23), board.fifo_count()) == (0x40, 0, 0, 0)
    assert board.rd(0x3B, 14) == bytes(14)
    assert names(board) == ["brown-out"]


def test_a_chip_that_fell_asleep_samples_or_lost_its_settings(board, way):
    let_happen(board, way, FallenAsleep())
    assert board.byte(0x6B) == 0x41
    taken = board.chip.samples_taken
    board.wait_ms(200)
    assert board.byte(0x19) == 9
    assert board.chip.samples_taken == taken
    board.wr(0x6B, 0x01)
    board.wait_ms(50)
    board.byte(0x75)
    assert board.chip.samples_taken > taken


@pytest.mark.parametrize(("what", "found"), [({"value": 0x18}, 0x18), ({"bit": 4}, 0x10)])
def test_a_changed_register_reads_as_before(board, way, what, found):
    let_happen(board, way, Changed(register=0x1B, **what))
    assert board.byte(0x1B) == found
    (touch,) = [one.touch for one in happened(board)]
    assert (touch.register, touch.what) == (0x1B, f"0x00 became 0x{found:02x}")


def test_a_changed_range_does_not_show_in_the_counts(make_board, way):
    board = make_board()
    board.wake()
    board.wait_ms(50)
    before = board.sensors()[2]
    let_happen(board, way, Changed(register=0x1C, value=0x18))
    board.wait_ms(50)
    assert board.sensors()[2] == pytest.approx(before / 8, abs=1)


def test_one_of_the_settings_changes_by_one_bit_unnoticed(board, way):
    registers = (0x19, 0x1A, 0x1B, 0x1C, 0x23, 0x38)
    before = [board.byte(register) for register in registers]
    let_happen(board, way, Changed(), seed=5)
    after = [board.byte(register) for register in registers]
    (touch,) = [one.touch for one in happened(board)]
    differ = {r: a ^ b for r, a, b in zip(registers, before, after, strict=True) if a != b}
    assert differ == {touch.register: 1 << touch.bit}


def test_a_reserved_bit_changes_by_itself(board, way):
    for seed in range(20):
        let_happen(board, way, Changed(register=0x1A), seed=seed)
    assert board.byte(0x1A) & 0xC0 == 0
    assert {one.touch.bit for one in happened(board)} == set(range(6))


@pytest.mark.parametrize(("n", "rest"), [(1, 13), (5, 9), (-1, 1), (-3, 3)])
def test_a_slip_leaves_whole_frames(board, way, n, rest):
    board.start_fifo()
    board.wait_ms(100)
    board.fifo_count()
    whole = bytes(board.chip.fifo.content)
    assert len(whole) > 56
    let_happen(board, way, FifoSlip(n))
    assert board.fifo_count() % 14 == rest
    expected = whole[n:] if n > 0 else whole[:-n] + whole
    assert board.rd(0x74, 50) == expected[:50]


def test_a_slip_of_an_empty_fifo_is_lost(board, way):
    let_happen(board, way, FifoSlip())
    assert names(board) == []
    board.start_fifo()
    board.wait_ms(30)
    assert board.fifo_count() % 14 == 13
    assert names(board) == ["slip"]


def test_a_doubled_byte_finds_room_in_a_full_fifo(board, way):
    board.start_fifo()
    board.wait_ms(2000)
    assert board.fifo_count() == 1024
    let_happen(board, way, FifoSlip(-5))
    assert board.fifo_count() == 1024


def test_a_provoked_overflow_of_an_empty_fifo_is_lost(board, way):
    board.start_fifo()
    let_happen(board, way, FifoOverflow())
    board.fifo_count()
    board.wait_ms(30)
    assert board.fifo_count() == 1024
    assert board.drain().shape == (73, 7)


def test_a_provoked_overflow_goes_unseen(board, way):
    board.start_fifo()
    board.wait_ms(40)
    board.byte(0x3A)
    let_happen(board, way, FifoOverflow())
    assert board.byte(0x3A) & 0x10
    assert board.fifo_count() == 1024
    board.rd(0x74, 1024)
    assert not board.byte(0x3A) & 0x10
    assert names(board) == ["overflow"]


def test_frozen_words_move_or_samples_stop(board, way):
    board.start_fifo()
    board.wait_ms(50)
    let_happen(board, way, Frozen(), for_s=0.5)
    board.drain()
    frozen = board.collect(0.4)
    assert len(frozen) == pytest.approx(40, abs=3)
    assert (frozen == frozen[0]).all()
    assert (board.sensors() == frozen[0]).all()
    board.wait_ms(200)
    board.drain()
    assert np.ptp(board.collect(0.3), axis=0).min() > 0
    assert [one.touch.what for one in happened(board)] == ["all words", "over"]


def test_a_jump_of_the_temperature_is_small_or_touches_another_word(make_board, way):
    board = make_board()
    board.wake()
    board.wait_ms(50)
    before = board.sensors()
    let_happen(board, way, WrongTemperature(25), for_s=0.1)
    board.wait_ms(50)
    assert (board.sensors() - before).tolist() == [0, 0, 0, 25 * 340, 0, 0, 0]
    board.wait_ms(60)
    assert (board.sensors() == before).all()


def test_lost_interrupts_show_at_the_pin(board, way):
    board.wr(0x38, 0x01)
    board.wait_ms(50)
    let_happen(board, way, NoInterrupts(), for_s=0.2)
    begun_ns = board.clock.now_ns()
    board.wait_ms(195)
    board.byte(0x75)
    assert board.chip.int_edges(begun_ns) == []
    board.wait_ms(100)
    board.byte(0x75)
    edges = [edge.t_ns for edge in board.chip.int_edges(begun_ns)]
    assert edges
    assert min(edges) >= happened(board)[0].t_ns + 200_000_000


def test_another_chip_answers_as_the_first(board, way):
    let_happen(board, way, Swapped("MPU-9250"), for_s=0.3)
    assert (board.byte(0x75), board.byte(0x19)) == (0x71, 0)
    assert board.chip.world_time_s(board.clock.now_ns()) == pytest.approx(board.clock.now_ns() / 1e9)
    board.wait_ms(300)
    assert (board.byte(0x75), board.byte(0x19)) == (0x68, 9)


def test_chip_put_in_its_place_lets_the_first_ones_bypass_stand_open(way):
    """Its own is closed after power-up, and opened it opens the way; the first one's is as it was when it is back."""
    clock = VirtualClock()
    master = product("gy-87").aux_master(clock, Sway())
    chip = FakeMpu6050(clock, motion=Sway(), aux=master)
    bus = FakeBus({0x68: chip, **master.outside()}, clock=clock)
    outer = SimpleNamespace(bus=bus, clock=clock, wait_ms=lambda ms: clock.advance_ns(round(ms * 1e6)))

    def magnetometer_answers():
        try:
            return bool(bus.write_read(0x0D, b"\x0d", 1))
        except DeviceMissing:
            return False

    bus.write(0x68, b"\x6b\x01")
    bus.write(0x68, b"\x37\x02")
    assert magnetometer_answers()
    let_happen(outer, way, Swapped("MPU-9250"), for_s=0.3)
    assert not magnetometer_answers()
    bus.write(0x68, b"\x37\x02")
    assert magnetometer_answers()
    bus.write(0x68, b"\x37\x00")
    assert not magnetometer_answers()
    outer.wait_ms(300)
    assert magnetometer_answers()


def test_an_unplugged_chip_answers_or_does_not_come_back(board, way):
    let_happen(board, way, Unplugged(), for_s=0.1)
    with pytest.raises(DeviceMissing) as missing:
        board.byte(0x75)
    assert missing.value.errno == errno.EREMOTEIO
    board.wait_ms(100)
    assert board.byte(0x19) == 9, "the chip itself went on"
    let_happen(board, way, Unplugged())
    board.wait_ms(1e6)
    with pytest.raises(DeviceMissing):
        board.byte(0x75)
    board.bus.adapter.faults.clear()
    assert board.byte(0x75) == 0x68


def test_two_faults_of_the_words_drive_each_other_out(make_board, way):
    board = make_board(motion=Sway())
    board.wake()
    board.wait_ms(50)
    let_happen(board, way, Frozen(), for_s=0.3)
    let_happen(board, way, WrongTemperature(10), for_s=0.1)
    board.wait_ms(20)
    hot = board.sensors()
    board.wait_ms(20)
    assert (board.sensors() == hot).all()
    board.wait_ms(100)
    cold = board.sensors()
    assert (hot - cold).tolist() == [0, 0, 0, 3400, 0, 0, 0]
    board.wait_ms(300)
    assert (board.sensors() != cold).any()
    assert board.chip.spoil_words is None


def test_a_planned_fault_waits_for_the_next_transfer(make_board, way):
    """The chip falls asleep at its time though nobody looks until 50 ms later: the FIFO holds what fell before."""
    board = make_board()
    board.wake(div=9)
    board.start_fifo()
    if way == "by hand":
        board.wait_ms(50)
    begun_ns = board.clock.now_ns()
    faults = board.bus.adapter.faults
    if way == "by hand":
        faults.now(FallenAsleep())
    else:
        faults.add(FaultEntry(FallenAsleep(), at_s=begun_ns / 1e9 + 0.05))
    board.wait_ms(100)
    assert board.fifo_count() == 5 * 14
    assert happened(board)[0].t_ns == begun_ns + (0 if way == "by hand" else 50_000_000)
