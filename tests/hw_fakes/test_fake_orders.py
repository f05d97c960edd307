"""Faults ordered from another thread: taken up by the next transfer, and followed to their end."""

from __future__ import annotations

import threading
import time
from contextlib import suppress

import numpy as np
import pytest

from hw_fakes import FakeBus, FakeMpu6050, RecordedCounts, Sway
from hw_fakes.faults.catalogue import CATALOGUE
from hw_fakes.faults.plan import parse
from hw_fakes.scenarios import counts_chip
from quavelet.bus.protocol import FailsOnOrder, KnowsTruth
from quavelet.core.clock import MonotonicClock, VirtualClock
from quavelet.core.errors import BusError, SettingsError
from quavelet.core.units import NS_PER_MS, NS_PER_S


def streaming(clock: VirtualClock | None = None) -> tuple[FakeBus, VirtualClock]:
    clock = clock or VirtualClock(3 * NS_PER_S)
    bus = FakeBus({0x68: FakeMpu6050(clock, motion=Sway())}, clock=clock)
    for register, value in ((0x6B, 1), (0x19, 4), (0x1A, 3), (0x23, 0xF8), (0x6A, 0x40)):
        bus.write(0x68, bytes([register, value]))
    return bus, clock


def drained(bus: FakeBus, clock: VirtualClock, s: float) -> None:
    for _ in range(round(100 * s)):
        clock.advance_ns(10 * NS_PER_MS)
        with suppress(BusError):
            n = int.from_bytes(bus.write_read(0x68, b"\x72", 2), "big")
            if n:
                bus.write_read(0x68, b"\x74", min(n, 28))


@pytest.mark.parametrize("fault", CATALOGUE, ids=lambda fault: fault.name)
def test_each_fault_that_is_offered_happens_and_ends_by_itself(fault):
    bus, clock = streaming()
    assert isinstance(bus, FailsOnOrder)
    drained(bus, clock, 0.1)
    n = bus.fail(fault.text)
    assert bus.ordered() == (), "nothing happens before a transfer"
    ordered_ns = clock.now_ns()
    drained(bus, clock, 4.0)
    (order,) = bus.ordered()
    assert (order.n, order.text) == (n, fault.text)
    assert ordered_ns <= order.began_ns <= ordered_ns + 30 * NS_PER_MS
    lasts_s = parse(fault.text).for_s or 0.0
    assert order.ended_ns - order.began_ns == pytest.approx(lasts_s * NS_PER_S, abs=130 * NS_PER_MS)
    assert not bus.adapter.faults.busy and not bus.adapter.faults.lasting


@pytest.mark.parametrize("text", ["", "nothing", "nack often", "nack every=3", "nack p=0.1", "nack at=99", "nack n=0"])
def test_what_is_no_fault_for_now_is_refused_at_once_and_the_transfers_go_on(text):
    bus, clock = streaming()
    with pytest.raises(SettingsError):
        bus.fail(text)
    drained(bus, clock, 0.1)
    assert bus.ordered() == () and not bus.adapter.faults.history


def test_a_fault_of_a_chip_that_is_not_there_is_refused_by_the_order_and_not_by_a_transfer():
    with pytest.raises(SettingsError, match="no MPU-6050 on these wires"):
        FakeBus({}, clock=VirtualClock()).fail("asleep")


def test_orders_beside_faults_made_by_hand_are_told_apart():
    bus, clock = streaming()
    bus.adapter.faults.add(parse("nack n=3"))
    bus.fail("nack n=2")
    bus.fail("nack n=1")
    drained(bus, clock, 0.2)
    first, second = bus.ordered()
    assert first.began_ns is not None and first.ended_ns is not None
    assert second.began_ns is not None and second.ended_ns is not None
    assert len([it for it in bus.adapter.faults.history if it.kind.name == "nack"]) == 6


def test_an_order_from_another_thread_in_the_midst_of_transfers_is_lost_or_breaks_them():
    bus, _ = streaming(MonotonicClock())
    stop = threading.Event()

    def transfers() -> None:
        # Whatever else it raises, pytest turns into a failure.
        while not stop.is_set():
            with suppress(BusError):
                bus.write_read(0x68, b"\x75", 1)

    thread = threading.Thread(target=transfers)
    thread.start()
    numbers = []
    for k in range(60):
        numbers.append(bus.fail(("nack", "flip", "asleep")[k % 3]))
        assert all(one.n in numbers for one in bus.ordered())
    until = time.monotonic() + 5.0
    while len([one for one in bus.ordered() if one.ended_ns]) < 60 and time.monotonic() < until:
        time.sleep(0.001)
    stop.set()
    thread.join()
    assert [one.n for one in bus.ordered()] == numbers
    assert all(one.began_ns <= one.ended_ns for one in bus.ordered())


def test_an_order_waits_for_a_transfer_that_hangs_and_who_orders_does_not():
    bus, _ = streaming(MonotonicClock())
    bus.fail("time-out takes=0.3")

    def hanging() -> None:
        with pytest.raises(BusError):
            bus.write_read(0x68, b"\x75", 1)

    thread = threading.Thread(target=hanging)
    thread.start()
    time.sleep(0.05)
    before = time.monotonic()
    bus.fail("nack")
    assert time.monotonic() - before < 0.1
    thread.join()
    (order,) = bus.ordered()
    assert order.ended_ns - order.began_ns > 0.29 * NS_PER_S


def test_the_truth_of_the_board_is_that_of_its_motion():
    bus, clock = streaming()
    assert isinstance(bus, KnowsTruth)
    chip = bus.targets[0x68]
    t_ns = clock.now_ns() + np.arange(5) * NS_PER_S // 7
    truth = chip.motion.attitude(np.array([chip.world_time_s(int(t)) for t in t_ns]))
    assert np.array_equal(bus.attitude(t_ns), truth)


def test_the_truth_of_a_board_that_plays_counts_is_not_known():
    clock = VirtualClock()
    zeros = np.zeros((10, 3), dtype=np.int16)
    recording = RecordedCounts(
        acc=zeros, gyr=zeros, temp=zeros[:, 0], acc_lsb_per_g=16384, gyr_lsb_per_dps=131, rate_hz=100.0
    )
    chip = counts_chip(recording, clock=clock)
    assert np.isnan(FakeBus({0x68: chip}, clock=clock).attitude(np.zeros(2, dtype=np.int64))).all()
