"""Wire time and errors of the fake bus."""

from __future__ import annotations

import errno

import pytest

from hw_fakes import FakeBus, FakeMpu6050
from quavelet.core.clock import MonotonicClock, VirtualClock
from quavelet.core.errors import BusError, DeviceMissing


@pytest.mark.parametrize("speed_hz", [100_000, 400_000])
@pytest.mark.parametrize(("n", "bits"), [(1, 39), (2, 48), (6, 84), (12, 138), (14, 156), (1024, 9246)])
def test_combined_read_takes_30_and_9_n_bit_times(speed_hz, n, bits):
    clock = VirtualClock()
    bus = FakeBus({0x68: FakeMpu6050(clock)}, clock=clock, speed_hz=speed_hz)
    bus.write_read(0x68, b"\x3b", n)
    assert bus.busy_ns == clock.now_ns() == bits * 10**9 // speed_hz


@pytest.mark.parametrize(("n", "bits"), [(1, 29), (2, 38)])
def test_write_takes_20_and_9_n_bit_times(n, bits):
    clock = VirtualClock()
    bus = FakeBus({0x68: FakeMpu6050(clock)}, clock=clock)
    bus.write(0x68, bytes([0x19] + n * [0]))
    assert bus.busy_ns == clock.now_ns() == bits * 2500


def test_nobody_at_the_address_is_errno_121_after_11_bit_times():
    clock = VirtualClock()
    bus = FakeBus({0x68: FakeMpu6050(clock)}, clock=clock, name="fake:desert")
    with pytest.raises(DeviceMissing, match="0x69 on fake:desert") as caught:
        bus.write_read(0x69, b"\x75", 1)
    assert caught.value.errno == errno.EREMOTEIO == 121
    assert (caught.value.address, caught.value.register) == (0x69, 0x75)
    assert bus.busy_ns == 11 * 2500


def test_time_of_the_host_is_not_touched():
    clock = MonotonicClock()
    bus = FakeBus({0x68: FakeMpu6050(clock)}, clock=clock)
    assert bus.write_read(0x68, b"\x75", 1) == b"\x68"
    assert bus.busy_ns == 39 * 2500


def test_sample_due_during_a_transaction_is_seen_by_the_next(board):
    board.wake(div=0)
    board.wait_ms(5)
    taken = board.chip.samples_taken
    board.rd(0x3B, 140)  # more than 3 ms of wire
    in_burst = board.chip.samples_taken
    board.byte(0x75)
    assert in_burst - taken <= 6
    assert board.chip.samples_taken - in_burst == 3


def test_two_chips_share_a_bus_and_ad0_is_not_reflected():
    clock = VirtualClock()
    bus = FakeBus({0x68: FakeMpu6050(clock), 0x69: FakeMpu6050(clock)}, clock=clock)
    bus.write(0x69, b"\x6b\x01")
    assert bus.write_read(0x69, b"\x75", 1) == b"\x68"
    assert bus.write_read(0x68, b"\x6b", 1) == b"\x40"


def test_closed_bus_refuses():
    clock = VirtualClock()
    with FakeBus({0x68: FakeMpu6050(clock)}, clock=clock) as bus:
        assert bus.write_read(0x68, b"\x75", 1) == b"\x68"
    bus.close()
    with pytest.raises(BusError, match="closed"):
        bus.write(0x68, b"\x6b\x01")
    assert clock.now_ns() == bus.busy_ns


@pytest.mark.parametrize(("data", "n"), [(b"", 1), (b"\x75", 0)])
def test_empty_transfers_are_refused(board, data, n):
    with pytest.raises(ValueError, match="at least one byte"):
        board.bus.write_read(0x68, data, n)
    with pytest.raises(ValueError, match="at least one byte"):
        board.bus.write(0x68, b"")
