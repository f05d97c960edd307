"""What the chip and the wires can do to a running stream: it is noticed, told, mended, and the samples go on."""

from __future__ import annotations

import numpy as np
import pytest
from chip_rig import Rig, Transfer, check_honest, config

from hw_fakes import NOISE_ONLY, Tilt
from hw_fakes.faults.plan import parse
from quavelet.core.blocks import Flag
from quavelet.core.errors import DeviceLost
from quavelet.core.units import NS_PER_MS, NS_PER_S

REASONS = Flag.OVERFLOW | Flag.MISALIGNED | Flag.BUS_ERROR | Flag.CHIP_UPSET | Flag.IMPLAUSIBLE


def running(rate_hz: float = 200.0, **chip: object) -> Rig:
    rig = Rig(config(rate_hz), **chip).start()
    rig.run(3.0)
    return rig


def struck(rig: Rig, *faults: str, seconds: float = 2.0) -> int:
    """Let faults happen at once and go on for a while; how many samples there were before."""
    before = len(rig.got)
    for fault in faults:
        rig.fake_bus.adapter.faults.add(parse(fault))
    rig.run(seconds)
    return before


def hole_ms(rig: Rig, before: int) -> float:
    """The longest time without a sample since then."""
    t_ns = rig.got.t_ns[before - 1 :]
    return float(np.diff(t_ns).max() / NS_PER_MS)


@pytest.mark.parametrize(
    "fault",
    [
        "changed register=0x1b value=0x18",
        "changed register=0x1c value=0",
        "changed register=0x1a value=6",
        "changed register=0x19 value=9",
        "changed register=0x23 value=0",
        "changed register=0x38 value=0xff",
        "changed register=0x6c value=0x07",
    ],
)
def test_changed_register_goes_unnoticed_or_unmended(fault):
    rig = running()
    table = bytes(rig.chip.registers)
    before = struck(rig, fault)
    register = parse(fault).kind.register
    assert rig.chip.registers[register] == table[register]
    assert rig.health.registers_upset == 1
    assert rig.health.chip_restarts == 0
    at = before + np.flatnonzero(rig.got.flags[before:] & Flag.GAP)
    assert len(at) >= 1 and (rig.got.flags[at[0]] & (Flag.CHIP_UPSET | Flag.MISALIGNED))
    assert hole_ms(rig, before) < 250


@pytest.mark.parametrize("fault", ["brown-out", "asleep", "changed register=0x6b value=0x41"])
def test_chip_without_its_setting_is_not_back_within_half_a_second(fault):
    rig = running()
    before = struck(rig, fault)
    numbers = check_honest(rig)
    assert rig.health.chip_restarts == 1
    assert rig.health.gaps == 1
    (at,) = np.flatnonzero(rig.got.flags & Flag.GAP)
    assert rig.got.flags[at] & REASONS == Flag.CHIP_UPSET
    assert hole_ms(rig, before) < 500
    # The time goes on: the gap is as long as what is missing in it.
    assert rig.samples.run is not None
    assert rig.got.gap_ns[at] / rig.samples.run.period_ns == pytest.approx(np.diff(numbers)[at - 1] - 1, abs=2)


def test_rate_that_was_changed_turns_the_board_by_a_multiple_before_it_is_noticed():
    """Without the low-pass the chip samples eight times as fast; each sample would be taken for five milliseconds."""
    rig = running()
    struck(rig, "changed register=0x1a value=0")
    assert rig.health.counts_surprising == 1
    at = np.flatnonzero(rig.got.flags & Flag.GAP)
    assert len(at) == 1
    assert np.abs(np.diff(rig.numbers)[at[0] - 40 : at[0] - 1] - 1).max() == 0


@pytest.mark.parametrize("slip", [*range(1, 14), -1, -13])
def test_slipped_fifo_gives_a_torn_frame(slip):
    rig = running()
    struck(rig, f"slip bytes={slip}")
    check_honest(rig)
    assert rig.health.fifo_misaligned >= 1
    assert rig.health.gaps == 1
    assert rig.health.chip_restarts == 0


def test_disturbed_count_costs_the_fifo():
    """A bit of the count that flips on its way makes it no whole frames; the next look is good."""
    rig = running()
    struck(rig, "flip register=0x73 bit=0")
    assert (np.diff(check_honest(rig)) == 1).all()
    assert rig.health.fifo_resets == 0


@pytest.mark.parametrize("stall_ms", [20, 40, 60, 400])
def test_fifo_that_overflows_between_count_and_frames_gives_torn_frames(stall_ms):
    """The host was late, found room for a few frames more, and was held up once more before it read them."""
    rig = running()
    stalls: list[int] = []

    def stall(k: int, transfer: Transfer) -> bool:
        if transfer.register == 0x74 and not stalls:
            stalls.append(k)
            rig.wait_ms(stall_ms)
        return False

    rig.bus.spoil = stall
    rig.drain(330)
    rig.run(1.0)
    numbers = check_honest(rig)
    assert stalls
    assert rig.health.fifo_overflows == (stall_ms > 30)
    assert ((np.diff(numbers) - 1).sum() > 0) == (stall_ms > 30)


@pytest.mark.parametrize("byte", [0x00, 0xFF])
def test_frames_of_a_line_that_is_held_are_given_out(byte):
    rig = running()
    rig.bus.alter = lambda _k, t, answer: bytes([byte]) * len(answer) if t.register == 0x74 else answer
    rig.run(0.05)
    rig.bus.alter = lambda _k, _t, answer: answer
    rig.run(1.0)
    check_honest(rig)
    assert rig.health.frames_implausible >= 2
    at = np.flatnonzero(rig.got.flags & Flag.GAP)
    assert (rig.got.flags[at] & Flag.IMPLAUSIBLE).all() and len(at) >= 1


def test_temperature_that_jumps_is_believed_at_once_and_one_that_stays_wrong_stops_the_stream():
    rig = running(motion=Tilt(), imperfections=NOISE_ONLY)
    before = struck(rig, "temperature by=30 for=1.0", seconds=2.0)
    at = before + np.flatnonzero(rig.got.flags[before:] & Flag.GAP)
    assert len(at) == 2  # when it began, and when it ended
    assert (rig.got.flags[at] & Flag.IMPLAUSIBLE).all()
    assert len(rig.got) - before > 380


def test_stuck_chip_looks_like_a_very_still_one():
    rig = running(motion=Tilt(), imperfections=NOISE_ONLY)
    before = struck(rig, "frozen for=3.0", seconds=4.0)
    stuck = rig.got.flags[before:] & Flag.STUCK != 0
    first = int(np.argmax(stuck))
    assert first <= 25  # 0.1 s at 200 Hz
    assert rig.health.stuck >= 1
    assert rig.health.chip_restarts == 1
    assert 500 < stuck.sum() < 600
    assert not stuck[-150:].any()


def test_noise_of_a_real_chip_is_taken_for_stuck_at_the_narrowest_filter_and_the_widest_ranges():
    rig = Rig(config(1000.0, dlpf=6, gyro=2000, accel=16), motion=Tilt(start_s=1e9), imperfections=NOISE_ONLY).start()
    rig.run(60.0, every_ms=20.0)
    assert rig.health.stuck == 0
    assert not (rig.got.flags & Flag.STUCK).any()


def test_another_chip_is_written_to_as_if_it_were_the_first():
    rig = running()
    written = len(rig.chip.written)
    with pytest.raises(DeviceLost, match=r"0x68.*reads 0x70.*exchanged, start again"):
        struck(rig, "swapped personality=MPU-6500", seconds=5.0)
    other = rig.fake_bus.targets[0x68]
    assert other is not rig.chip
    assert other.written == []
    assert len(rig.chip.written) == written


def test_chip_that_gives_nothing_for_ten_seconds_is_waited_for_without_end():
    """It answers, and every reset succeeds, but no sample ever comes."""
    rig = running()
    rig.bus.alter = lambda _k, t, answer: bytes(len(answer)) if t.register in (0x72, 0x3A) else answer
    begin_ns = rig.clock.now_ns()
    with pytest.raises(DeviceLost, match=r"nothing for 10 s.*no sample"):
        rig.run(20.0)
    assert rig.clock.now_ns() - begin_ns == pytest.approx(10 * NS_PER_S, rel=0.05)
    assert rig.health.starved >= 5
    assert rig.health.chip_restarts >= 5


def test_time_or_numbers_jump_where_the_chip_was_brought_back():
    rig = running()
    struck(rig, "brown-out", "brown-out at=7", "unplugged at=9 for=1", seconds=12.0)
    check_honest(rig)
    late = (rig.got.t_ns - rig.samples.true_ns(rig.numbers)) / 5e6
    assert np.abs(late[-200:]).max() < 1.0
    assert rig.health.gaps == 3
    lost = np.diff(rig.numbers) - 1
    assert abs(rig.health.samples_lost - lost.sum()) <= 6


def test_register_that_is_only_misread_costs_the_fifo():
    """Two looks in a row are disturbed, the chip is well."""
    rig = running()
    struck(rig, "flip register=0x1b bit=3 n=2", seconds=0.5)
    assert rig.health.registers_upset == rig.health.gaps == 0
    assert (np.diff(check_honest(rig)) == 1).all()


def test_chip_that_took_the_others_place_with_the_same_registers_is_read_on():
    rig = running()
    rig.bus.alter = lambda _k, t, answer: b"\x70" if t.register == 0x75 and t.n == 1 else answer
    with pytest.raises(DeviceLost, match=r"reads 0x70.*exchanged"):
        rig.run(1.0)


def test_reset_of_the_fifo_that_failed_half_way_costs_a_reset_of_the_chip():
    """The sensors are off the FIFO then: it must be begun anew before the registers are looked at."""
    rig = running()
    spoilt: list[int] = []
    rig.bus.spoil = lambda k, t: (
        t.register == 0x23 and t.written == b"\xf8" and len(spoilt) < 3 and not spoilt.append(k)
    )
    rig.drain(2000)
    rig.run(1.0)
    assert len(spoilt) == 3
    check_honest(rig)
    assert rig.health.chip_restarts == rig.health.registers_upset == 0
    assert rig.health.gaps == 1
