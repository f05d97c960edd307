"""The FIFO through the source: whole frames only, and every loss is told, sized and counted."""

from __future__ import annotations

import errno

import numpy as np
import pytest
from chip_rig import Rig, check_honest, config
from hypothesis import given
from hypothesis import strategies as st

from quavelet.core.blocks import Flag
from quavelet.core.errors import DeviceLost
from quavelet.core.units import NS_PER_MS
from quavelet.mpu6050.drain import Verdict, judge

PERIOD_NS = 5 * NS_PER_MS
REASONS = Flag.OVERFLOW | Flag.MISALIGNED | Flag.BUS_ERROR | Flag.CHIP_UPSET | Flag.IMPLAUSIBLE


def running(rate_hz: float = 200.0, *, warm_s: float = 3.0, every_ms: float = 10.0, **chip: object) -> Rig:
    """A source that streams for long enough to know the chip's rate."""
    rig = Rig(config(rate_hz), **chip).start()
    rig.run(warm_s, every_ms=every_ms)
    return rig


def assert_gap(rig: Rig, reason: Flag, *, gaps: int = 1) -> None:
    """There are `gaps` places where samples are missing, each flagged, and each as long as it says within 2 samples."""
    numbers, got = check_honest(rig), rig.got
    assert rig.samples.run is not None
    at = np.flatnonzero(got.flags & Flag.GAP)
    assert len(at) == gaps == rig.health.gaps
    lost = np.diff(numbers)[at - 1] - 1
    assert (got.flags[at] & REASONS == reason).all()
    assert got.gap_ns[at] / rig.samples.run.period_ns == pytest.approx(lost, abs=2)
    assert not np.delete(got.gap_ns, at).any()
    assert abs(rig.health.samples_lost - lost.sum()) <= 2
    assert rig.health.samples == len(numbers)
    rig.fake_bus.write_read(0x68, b"\x75", 1)  # the fake looks at its clock
    waiting = len(rig.chip.fifo) // 14
    first = numbers[0]  # what was taken before the FIFO was switched on does not count
    assert abs(rig.health.samples + rig.health.samples_lost + waiting - (rig.taken_now() - first)) <= 2


def test_quiet_stream_has_every_sample_once_and_no_flag():
    rig = running(every_ms=7.0)
    numbers = check_honest(rig)
    assert (np.diff(numbers) == 1).all()
    assert rig.health.gaps == rig.health.fifo_resets == rig.health.samples_lost == rig.health.bus_errors == 0
    assert not (rig.got.flags & ~np.uint32(Flag.CLOCK_UNSURE)).any()
    unsure = rig.got.flags & Flag.CLOCK_UNSURE != 0
    assert unsure[:190].all() and not unsure[220:].any()


@pytest.mark.parametrize("pause_ms", [400, 2000, 60_000])
@pytest.mark.parametrize("rate_hz", [200.0, 500.0, 1000.0])
def test_overflow_is_reset_flagged_and_sized(rate_hz, pause_ms):
    rig = running(rate_hz)
    rig.drain(pause_ms)
    rig.run(1.0)
    assert_gap(rig, Flag.OVERFLOW)
    assert rig.health.fifo_overflows == 1
    assert rig.health.fifo_resets == 1


def test_overflow_bit_with_a_small_count_is_believed():
    """The bit is set and cleared on read, the count may have been read down since by someone else."""
    rig = running()
    rig.wait_ms(20)
    rig.chip.registers[0x3A] |= 0x10
    assert len(rig.drain()) == 0
    rig.run(0.5)
    assert_gap(rig, Flag.OVERFLOW)


def test_full_fifo_whose_overflow_bit_was_eaten_by_another_reader_is_an_overflow():
    rig = running()
    rig.wait_ms(600)
    rig.fake_bus.write_read(0x68, b"\x3a", 1)
    rig.chip.registers[0x3A] = 0
    rig.drain()
    rig.run(0.5)
    assert_gap(rig, Flag.OVERFLOW)


def test_fifo_is_read_up_to_70_frames_and_reset_at_71():
    for frames, verdict in ((70, Verdict.FRAMES), (71, Verdict.NEAR_FULL)):
        rig = running(1000.0, pll_error=0.0)
        while len(rig.chip.fifo) < frames * 14:
            rig.wait_ms(0.05)
            rig.fake_bus.write_read(0x68, b"\x75", 1)
        rows = len(rig.drain())
        assert rows == (frames if verdict is Verdict.FRAMES else 0)
        rig.run(0.5)
        if verdict is Verdict.FRAMES:
            assert (np.diff(check_honest(rig)) == 1).all()
        else:
            assert_gap(rig, Flag.OVERFLOW)
            assert rig.health.fifo_near_full == 1


@given(
    status=st.integers(0, 255),
    count=st.one_of(st.integers(0, 0xFFFF), st.integers(0, 80).map(lambda n: 14 * n), st.integers(960, 1030)),
)
def test_verdict_is_frames_only_where_the_fifo_can_hold_nothing_else(status, count):
    verdict = judge(status, count, fifo_bytes=1024)
    allowed = not status & 0x10 and count % 14 == 0 and 0 < count < 1024 - 42
    assert (verdict is Verdict.FRAMES) == allowed
    assert (verdict is Verdict.EMPTY) == (count == 0 and not status & 0x10)
    assert verdict.must_reset == (verdict not in (Verdict.FRAMES, Verdict.EMPTY))


@pytest.mark.parametrize("odd", [1, 2, 3, 7, 13])
def test_odd_bytes_in_the_fifo_cost_a_gap_and_never_a_wrong_frame(odd):
    rig = running()
    for byte in range(odd):
        rig.wr(0x74, byte)
    rig.run(0.5)
    assert_gap(rig, Flag.MISALIGNED)
    assert rig.health.fifo_misaligned == 1


@pytest.mark.parametrize("enabled", [0x78, 0xF0, 0x88, 0x08, 0xB8])
def test_sensor_switched_off_behind_the_drivers_back_is_found_and_switched_on_again(enabled):
    rig = running()
    rig.wr(0x23, enabled)
    rig.run(0.5)
    at = np.flatnonzero(rig.got.flags & Flag.GAP)
    assert (rig.got.flags[at] & (Flag.MISALIGNED | Flag.CHIP_UPSET)).all() and len(at) >= 1
    check_honest(rig)
    assert rig.chip.registers[0x23] == 0xF8


@pytest.mark.parametrize("late", [False, True])
@pytest.mark.parametrize("k", range(2))
def test_failed_look_at_the_fifo_costs_a_sample(k, late):
    """Status and count may be read again: what waits in the FIFO waits on."""
    rig = running()
    begin = len(rig.bus.trace)
    rig.bus.spoil = lambda at, _t: at == begin + k
    rig.bus.late = late
    rig.drain(10)
    rig.run(0.5)
    assert (np.diff(check_honest(rig)) == 1).all()
    assert rig.health.bus_errors == rig.health.bus_retries == 1
    assert rig.health.gaps == rig.health.fifo_resets == 0


@pytest.mark.parametrize("late", [False, True])
def test_failed_reading_of_frames_is_a_gap_and_the_stream_stays_aligned(late):
    rig = running()
    rig.bus.late = late
    rig.bus.spoil = lambda _at, t: t.register == 0x74
    rig.drain(10)
    rig.bus.spoil = lambda _at, _t: False
    rig.run(0.5)
    assert_gap(rig, Flag.BUS_ERROR)
    assert rig.health.bus_errors == 1
    assert rig.health.bus_retries == 0


def test_chip_that_does_not_acknowledge_the_reading_of_frames_is_asked_again():
    """Nothing has left the FIFO then."""
    rig = running()
    spoilt: list[int] = []
    rig.bus.errno = errno.EREMOTEIO
    rig.bus.spoil = lambda at, t: t.register == 0x74 and len(spoilt) < 2 and not spoilt.append(at)
    rig.drain(10)
    rig.run(0.5)
    assert (np.diff(check_honest(rig)) == 1).all()
    assert rig.health.bus_retries == rig.health.bus_errors == 2


@pytest.mark.parametrize("late", [False, True])
@pytest.mark.parametrize("k", range(8))
def test_failed_transfer_anywhere_in_the_restart_of_the_fifo_is_survived_and_counted(k, late):
    rig = running()
    begin = len(rig.bus.trace)
    rig.bus.spoil = lambda at, _t: at == begin + k
    rig.bus.late = late
    rig.drain(2000)
    assert len(rig.bus.trace) > begin + k
    rig.run(0.5)
    assert_gap(rig, Flag.OVERFLOW)
    assert rig.health.bus_errors == 1


@pytest.mark.parametrize("length", [2, 3, 4, 6])
@pytest.mark.parametrize("k", range(8))
def test_failures_in_a_row_are_survived(k, length):
    rig = running()
    begin = len(rig.bus.trace)
    rig.bus.spoil = lambda at, _t: begin + k <= at < begin + k + length
    rig.drain(10)
    rig.run(0.5)
    numbers = check_honest(rig)
    assert len(numbers) + rig.health.samples_lost == pytest.approx(rig.taken_now() - numbers[0], abs=3)
    assert rig.health.bus_errors == length


def test_lines_that_come_off_for_less_than_the_fifo_holds_cost_a_sample():
    rig = running()
    rig.chip.unplug()
    rig.run(0.08)
    rig.chip.plug()
    rig.run(0.5)
    assert (np.diff(check_honest(rig)) == 1).all()
    assert rig.health.bus_errors > 10


@pytest.mark.parametrize("off_s", [0.3, 1.5, 5.0, 9.0])
def test_lines_disturbed_for_seconds_are_a_gap_and_not_a_lost_device(off_s):
    """A motor that starts: with most libraries it is errno 121 and the end of the program."""
    rig = running()
    rig.chip.unplug()
    rig.run(off_s)
    rig.chip.plug()
    begin_ns = rig.clock.now_ns()
    rig.run(0.7)
    assert_gap(rig, Flag.CHIP_UPSET)
    assert rig.health.outages == rig.health.chip_restarts == 1
    back_ns = rig.got.t_ns[rig.got.t_ns > begin_ns][0] - begin_ns
    assert back_ns < 500 * NS_PER_MS


def test_lines_that_stay_off_are_a_lost_device_after_ten_seconds():
    rig = running()
    rig.chip.unplug()
    begin_ns = rig.clock.now_ns()
    with pytest.raises(DeviceLost, match=r"0x68.*fake:rig.*nothing for 10 s.*wiring") as caught:
        rig.run(13.0)
    assert isinstance(caught.value.__cause__, OSError) and caught.value.__cause__.errno == errno.EREMOTEIO
    assert rig.clock.now_ns() - begin_ns < 10_100 * NS_PER_MS


def test_one_good_drain_in_two_keeps_the_chip():
    rig = running()
    rig.bus.spoil = lambda _k, transfer: transfer.register == 0x72 and len(rig.blocks) % 2 == 0
    rig.run(3.0)
    assert (np.diff(check_honest(rig)) == 1).all()
    assert rig.health.bus_errors > 100
    assert rig.health.chip_restarts == 0


@pytest.mark.parametrize(("rate_hz", "every_ms"), [(1000 / 256, 5.0), (1000 / 256, 1500.0), (50.0, 2.0)])
def test_slow_stream_is_not_taken_for_a_dead_chip(rate_hz, every_ms):
    rig = Rig(config(rate_hz, dlpf=6)).start()
    rig.run(12.0, every_ms=every_ms)
    assert (np.diff(check_honest(rig)) == 1).all()
    assert len(rig.got) == pytest.approx(12 * rate_hz, abs=7)


@pytest.mark.parametrize("frames", [1, 10, 40])
def test_one_transaction_takes_all_frames(frames):
    rig = running(1000.0, warm_s=0.2, pll_error=0.0)
    begin = len(rig.bus.trace)
    block = rig.drain(frames)
    assert frames <= len(block) <= frames + 5  # the chip goes on while the registers are looked at
    drain = [(t.register, t.n) for t in rig.bus.trace[begin:] if t.register in (0x3A, 0x72, 0x74)]
    assert drain == [(0x3A, 1), (0x72, 2), (0x74, 14 * len(block))]


def test_empty_drain_reads_no_frames():
    """An empty FIFO repeats its last byte: reading it would invent a frame."""
    rig = running()
    rig.drain(10)
    begin = len(rig.bus.trace)
    assert len(rig.drain()) == 0
    assert 0x74 not in [t.register for t in rig.bus.trace[begin:]]
    assert rig.health.fifo_empty >= 1
