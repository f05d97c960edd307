"""Each fault of the wires does to a transfer what it says, whichever way it comes about, and the history tells it."""

from __future__ import annotations

import errno

import pytest
from fault_ways import WAYS, happened, let_happen, names

from hw_fakes import FakeMpu6050, Sway
from hw_fakes.faults.of_wires import (
    AllOnes,
    AllZero,
    CutWrite,
    FlippedRead,
    FlippedWrite,
    Garbage,
    InputOutputError,
    LostArbitration,
    NotAcknowledged,
    SlowWires,
    TimedOut,
    Torn,
)
from hw_fakes.faults.plan import FaultEntry
from hw_fakes.wire.adapter import READ, Adapter
from quavelet.core.clock import MonotonicClock
from quavelet.core.errors import BusError

pytestmark = pytest.mark.parametrize("way", WAYS)
BIT_NS = 2500


@pytest.fixture
def board(board):
    board.wake(div=9)
    board.wait_ms(20)
    return board


def errno_of(call):
    with pytest.raises(BusError) as failed:
        call()
    return failed.value.errno


@pytest.mark.parametrize("n", [1, 3])
def test_a_nack_comes_more_or_less_often_than_asked_for(board, way, n):
    let_happen(board, way, NotAcknowledged(), n=n)
    assert [errno_of(lambda: board.byte(0x75)) for _ in range(n)] == n * [errno.EREMOTEIO]
    assert board.byte(0x75) == 0x68
    assert names(board) == n * ["nack"]


def test_a_nack_for_a_time_ends_early_or_late(board, way):
    let_happen(board, way, NotAcknowledged(), for_s=0.2)
    begun_ns = board.clock.now_ns()
    while board.clock.now_ns() - begun_ns < 190e6:
        assert errno_of(lambda: board.byte(0x75)) == errno.EREMOTEIO
        board.wait_ms(7)
    board.wait_ms(10)
    assert board.byte(0x75) == 0x68


def test_a_nack_for_one_address_hits_the_other(board, way):
    board.bus.adapter.attach(0x69, FakeMpu6050(board.clock))
    let_happen(board, way, NotAcknowledged(), address=0x69)
    assert board.byte(0x75) == 0x68
    assert errno_of(lambda: board.bus.write_read(0x69, b"\x75", 1)) == errno.EREMOTEIO
    assert [one.address for one in happened(board)] == [0x69]


def test_a_time_out_takes_no_time_or_spares_an_address(board, way):
    let_happen(board, way, TimedOut(takes_s=0.25), n=2)
    for address in (0x68, 0x23):
        begun_ns = board.clock.now_ns()
        assert errno_of(lambda at=address: board.bus.write_read(at, b"\x75", 1)) == errno.ETIMEDOUT
        assert board.clock.now_ns() - begun_ns == 250_000_000 + 11 * BIT_NS
    assert board.byte(0x75) == 0x68


@pytest.mark.parametrize(("kind", "code"), [(InputOutputError(), errno.EIO), (LostArbitration(), errno.EAGAIN)])
def test_an_error_of_the_wires_is_told_as_another(board, way, kind, code):
    let_happen(board, way, kind)
    assert errno_of(lambda: board.wr(0x19, 4)) == code
    assert board.byte(0x19) == 9, "what failed reached the chip"
    assert names(board) == [kind.name]


@pytest.mark.parametrize("where", [{}, {"register": 0x1B}, {"bit": 6}, {"byte": 1}, {"register": 0x1B, "bit": 3}])
def test_the_history_names_another_bit_than_the_one_flipped(board, way, where):
    right = board.rd(0x19, 4)
    let_happen(board, way, FlippedRead(**where))
    wrong = board.rd(0x19, 4)
    (touch,) = [one.touch for one in happened(board)]
    flipped = bytearray(right)
    flipped[touch.byte] ^= 1 << touch.bit
    assert (wrong, touch.register) == (bytes(flipped), 0x19 + touch.byte)
    assert all(getattr(touch, key) == value for key, value in where.items())
    assert board.rd(0x19, 4) == right, "the register itself changed"


def test_a_flip_of_the_fifos_count_hits_another_read(board, way):
    board.start_fifo()
    board.wait_ms(50)
    let_happen(board, way, FlippedRead(register=0x73, bit=1))
    board.byte(0x1B)
    assert names(board) == []
    # The FIFO holds whole frames of 14 bytes, whatever time has passed.
    assert board.fifo_count() % 14 != 0
    assert board.fifo_count() % 14 == 0
    assert [(one.touch.register, one.touch.byte, one.touch.bit) for one in happened(board)] == [(0x73, 1, 1)]


def test_a_flip_in_the_fifos_port_is_taken_for_another_register(board, way):
    board.start_fifo()
    board.wait_ms(50)
    let_happen(board, way, FlippedRead(register=0x74))
    board.fifo_count()
    board.rd(0x74, 28)
    assert [one.touch.register for one in happened(board)] == [0x74]


def test_a_bit_flipped_on_its_way_leaves_the_register_right(board, way):
    let_happen(board, way, FlippedWrite(register=0x1B, bit=4))
    board.bus.write(0x68, bytes([0x19, 9, 1, 0x08, 0x10]))
    assert board.rd(0x19, 4) == bytes([9, 1, 0x18, 0x10])
    assert [(one.touch.register, one.touch.byte, one.touch.bit) for one in happened(board)] == [(0x1B, 2, 4)]


def test_one_flip_hits_both_reads_of_a_transfer(board, way):
    let_happen(board, way, FlippedRead())
    messages = [(0x68, 0, b"\x19"), (0x68, READ, 4), (0x68, 0, b"\x19"), (0x68, READ, 4)]
    first, second = board.bus.adapter.transfer(messages)[1::2]
    assert first != second
    assert names(board) == ["flip"]
    assert board.bus.adapter.transfer(messages)[1] == second


@pytest.mark.parametrize("pointer", [0x1B, 0x9B])
@pytest.mark.parametrize("written", [b"", b"\x08\x10"])
def test_a_read_of_its_own_is_told_of_another_register(board, way, pointer, written):
    next_one = 0x1B + len(written)
    let_happen(board, way, FlippedRead(register=next_one))
    board.bus.adapter.transfer([(0x68, 0, bytes([pointer]) + written)])
    board.bus.adapter.transfer([(0x68, READ, 3)])
    assert [(one.touch.register, one.touch.byte) for one in happened(board)] == [(next_one, 0)]


def test_a_pointer_is_taken_for_a_value(board, way):
    let_happen(board, way, FlippedWrite())
    assert board.byte(0x75) == 0x68
    assert names(board) == []


@pytest.mark.parametrize(("keep", "expected"), [(None, [7, 2, 0, 0]), (0, [9, 1, 0, 0]), (3, [7, 2, 0x18, 0])])
def test_a_cut_write_configures_all_or_nothing(board, way, keep, expected):
    let_happen(board, way, CutWrite(keep=keep))
    begun_ns = board.clock.now_ns()
    assert errno_of(lambda: board.bus.write(0x68, bytes([0x19, 7, 2, 0x18, 0x10]))) == errno.EREMOTEIO
    kept = 2 if keep is None else keep
    assert board.clock.now_ns() - begun_ns == (1 + 9 + 9 + 9 * kept + 9 + 1) * BIT_NS
    assert board.rd(0x19, 4) == bytes(expected)
    assert names(board) == ["cut-write"]


def test_a_write_too_short_to_cut_is_cut(board, way):
    let_happen(board, way, CutWrite(keep=1))
    board.wr(0x19, 7)
    assert board.byte(0x19) == 7
    assert names(board) == []


def test_a_torn_read_is_of_one_sample(make_board, way):
    board, twin = make_board(motion=Sway()), make_board(motion=Sway())
    for one in (board, twin):
        one.wake(div=0)
        one.wait_ms(20)
    let_happen(board, way, Torn(byte=9, later_s=0.05))
    torn = board.rd(0x3B, 14)
    # The same chip, read whole at the two moments.
    twin.clock.sleep_until_ns(board.clock.now_ns() - round(50e6) - (30 + 9 * 14) * BIT_NS)
    early = twin.rd(0x3B, 14)
    twin.clock.sleep_until_ns(board.clock.now_ns() - (30 + 9 * 14) * BIT_NS)
    assert early[:9] == torn[:9]
    assert torn[9:] != early[9:]
    assert torn[9:] == twin.rd(0x3B, 14)[9:]
    assert [(one.touch.register, one.touch.byte) for one in happened(board)] == [(0x44, 9)]


def test_a_torn_burst_of_the_fifo_keeps_all_its_bytes(make_board, way):
    board, twin = make_board(), make_board()
    for one in (board, twin):
        one.wake(div=0)
        one.start_fifo()
        one.wait_ms(10)
    whole = twin.rd(0x74, 64)
    let_happen(board, way, Torn(byte=5, lost=3))
    assert board.rd(0x74, 42) == whole[:5] + whole[8:45]
    assert board.rd(0x74, 3) == whole[45:48]


def test_noise_begins_before_its_byte(board, way):
    right = board.rd(0x0D, 60)
    let_happen(board, way, Garbage(byte=8))
    wrong = board.rd(0x0D, 60)
    assert wrong[:8] == right[:8]
    assert sum(a != b for a, b in zip(wrong[8:], right[8:], strict=True)) > 40
    assert [(one.touch.register, one.touch.byte) for one in happened(board)] == [(0x15, 8)]


@pytest.mark.parametrize(("kind", "value"), [(AllZero(), 0x00), (AllOnes(), 0xFF)])
def test_a_byte_of_a_spoilt_read_is_right(board, way, kind, value):
    let_happen(board, way, kind, n=2)
    assert board.rd(0x3B, 14) == bytes([value]) * 14
    messages = [(0x68, 0, b"\x75"), (0x68, READ, 2), (0x68, 0, b"\x19"), (0x68, READ, 3)]
    assert b"".join(board.bus.adapter.transfer(messages)) == bytes([value]) * 5
    assert board.byte(0x75) == 0x68
    assert set(names(board)) == {kind.name}


def test_slow_wires_are_as_fast_as_others(board, way):
    let_happen(board, way, SlowWires(factor=10), n=2)
    took_ns = []
    for _ in range(3):
        begun_ns = board.clock.now_ns()
        assert board.byte(0x75) == 0x68
        took_ns.append(board.clock.now_ns() - begun_ns)
    assert took_ns == [390 * BIT_NS, 390 * BIT_NS, 39 * BIT_NS]
    assert names(board) == ["slow", "slow"]


def test_single_messages_go_round_the_faults(board, way):
    adapter = board.bus.adapter
    let_happen(board, way, NotAcknowledged(), n=1)
    with pytest.raises(OSError) as failed:
        adapter.message(0x68, 0, b"\x75")
    adapter.stop()
    assert failed.value.errno == errno.EREMOTEIO
    adapter.message(0x68, 0, b"\x75")
    assert adapter.message(0x68, READ, 1) == b"\x68"
    adapter.stop()


def test_a_time_out_takes_no_time_of_a_real_clock(way):
    clock = MonotonicClock()
    adapter = Adapter({0x68: FakeMpu6050(clock)}, clock=clock)
    at_s = {} if way == "by hand" else {"at_s": 0.0}
    adapter.faults.add(FaultEntry(TimedOut(takes_s=0.05), **at_s))
    begun_ns = clock.now_ns()
    with pytest.raises(TimeoutError):
        adapter.transfer([(0x68, READ, 1)])
    assert clock.now_ns() - begun_ns >= 50_000_000
    assert adapter.busy_ns == 50_000_000 + 11 * BIT_NS
