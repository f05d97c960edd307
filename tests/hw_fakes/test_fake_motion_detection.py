"""Motion, zero motion, free fall and wake on motion: status, pin and times, against a detector that takes each sample
of the FIFO by itself."""

from __future__ import annotations

from dataclasses import dataclass
from math import exp, pi

import numpy as np
import pytest

from hw_fakes import TYPICAL, Still, Tilt
from hw_fakes.chip.personalities import MPU6500, MPU9250
from quavelet.core.units import STANDARD_GRAVITY_M_S2

FF, MOT, ZMOT, DATA_READY = 0x80, 0x40, 0x20, 0x01
LATCHED = 0x20
END_NS = 5_900_000_000
CUTOFF_HZ = {1: 5.0, 2: 2.5, 3: 1.25, 4: 0.63}


@dataclass(frozen=True)
class Pushed:
    """Lies still; its z is pushed by `push_g`, or falls freely where that is -1, within each of the intervals."""

    push_g: float
    intervals_s: tuple[tuple[float, float], ...]

    def rate_rad_s(self, t_s):
        return np.zeros((len(t_s), 3))

    def specific_force_m_s2(self, t_s):
        pushed = sum(((t_s >= begin) & (t_s < end)).astype(float) for begin, end in self.intervals_s)
        return np.outer(1 + self.push_g * pushed, [0, 0, STANDARD_GRAVITY_M_S2])

    def attitude(self, t_s):
        return np.tile([1.0, 0.0, 0.0, 0.0], (len(t_s), 1))


def watching(board, enable, *, dhpf=1, pin=0, fall=0, fall_ms=0, motion=0, motion_ms=0, rest=0, rest_64ms=0, down=0):
    board.wake(accel=dhpf)
    board.wr(0x1D, fall, fall_ms, motion, motion_ms, rest, rest_64ms)
    board.wr(0x69, down)
    board.wr(0x37, pin, enable)
    return board


def look(board):
    """A transaction on no wire, which takes no time."""
    board.chip.write(b"\x75")
    board.chip.stop()


def begins(board, since_ns=0):
    return [edge.t_ns for edge in board.chip.int_edges(since_ns) if edge.high]


def test_nothing_is_detected_before_anything_is_configured(make_board):
    board = make_board(motion=Pushed(-1.0, ((0.1, 5.0),)))
    board.wake()
    board.wr(0x37, 0x00, FF | MOT | ZMOT)
    board.wait_ms(2000)
    assert board.byte(0x3A) == DATA_READY
    assert board.byte(0x61) == 0
    assert begins(board) == []


def reference(x_g, *, dhpf, above_g, duration, down):
    """The samples at which motion is told of."""
    keep = exp(-2 * pi * CUTOFF_HZ[dhpf] / 1000) if dhpf in CUTOFF_HZ else 1.0
    slow, count, found = x_g[0], 0, []
    for n, x in enumerate(x_g):
        slow = keep * slow + (1 - keep) * x
        moved = x - slow
        before = count
        if max(abs(moved)) > above_g:
            count = min(count + 1, duration)
        else:
            count = max(0, count - {0: count, 1: 1, 2: 2, 3: 4}[down])
        if count == duration > before:
            found.append(n)
    return found


@pytest.mark.parametrize("down", [0, 1, 2, 3])
@pytest.mark.parametrize(
    ("dhpf", "motion", "duration"), [(1, 6, 1), (1, 5, 2), (2, 5, 3), (3, 4, 4), (4, 8, 1), (7, 9, 2)]
)
def test_motion_is_what_a_detector_that_takes_sample_by_sample_finds(make_board, dhpf, motion, duration, down):
    def begun():
        board = make_board(imperfections=TYPICAL, motion=Tilt(), seed=5, pll_error=0.004)
        watching(board, MOT, dhpf=dhpf, motion=motion, motion_ms=duration, down=down)
        board.wait_ms(40)
        board.start_fifo(0x08)
        board.chip.write(b"\x68\x02")  # the detector begins anew with the next sample
        board.chip.stop()
        return board

    board = begun()
    run, since_ns = board.chip.run, board.clock.now_ns()
    skipped = board.fifo_count() // 6
    first = run.samples_by(since_ns)
    x_g = board.collect(6, words=3)[skipped:] / 16384
    found = reference(x_g, dhpf=dhpf, above_g=motion * 0.002, duration=duration, down=down)
    expected_ns = [t_ns for n in found if (t_ns := run.time_ns(first + n + 1)) < END_NS]
    assert len(expected_ns) > 3
    for look_ms in (7.3, 900.0):
        board = begun()
        while board.clock.now_ns() < END_NS:
            board.wait_ms(look_ms)
            look(board)
        got = [t_ns for t_ns in begins(board, since_ns=since_ns) if t_ns < END_NS]
        assert len(got) == len(expected_ns)
        assert got == expected_ns


@pytest.mark.parametrize("fall_ms", [0, 1, 2, 20, 255])
@pytest.mark.parametrize("dhpf", [0, 1])
def test_free_fall_is_told_of_after_its_duration_and_not_at_rest(make_board, fall_ms, dhpf):
    board = make_board(motion=Pushed(-1.0, ((1.0, 1.4), (2.0, 2.0 + (fall_ms - 5) / 1000))), pll_error=0.01)
    watching(board, FF, dhpf=dhpf, fall=100, fall_ms=fall_ms)
    board.wait_ms(990)
    assert not board.byte(0x3A) & FF
    board.wait_ms(2000)
    (t_ns,) = begins(board)
    # The low-pass filter, 2 ms late, falls below 200 mg a little after the middle of its step.
    assert (t_ns - 1e9) * 1.01 == pytest.approx((max(1, fall_ms) + 2) * 1e6, abs=2.1e6)
    assert board.byte(0x3A) & FF
    assert not board.byte(0x3A) & FF


@pytest.mark.parametrize("down", [0, 1, 2, 3])
def test_free_fall_that_is_interrupted_counts_down_as_asked(make_board, down):
    turns = tuple((0.1 + 0.04 * k, 0.134 + 0.04 * k) for k in range(40))
    board = make_board(motion=Pushed(-1.0, turns))
    watching(board, FF, fall=100, fall_ms=100, down=down << 2)
    board.start_fifo(0x08)
    run = board.chip.run
    first = run.samples_by(board.clock.now_ns()) - board.fifo_count() // 6
    z_g = board.collect(1.8, words=3)[:, 2] / 16384
    count, expected_ns = 0, []
    for n, z in enumerate(z_g):
        before = count
        count = min(count + 1, 100) if abs(z) < 0.2 else max(0, count - {0: 100, 1: 1, 2: 2, 3: 4}[down])
        if count == 100 > before:
            expected_ns.append(run.time_ns(first + n + 1))
    assert bool(expected_ns) == (down in (1, 2))
    assert begins(board)[: len(expected_ns)] == expected_ns


@pytest.mark.parametrize(("mg_lsb", "detected"), [(2.0, True), (32.0, False)])
def test_scale_of_the_thresholds_is_the_one_asked_for(make_board, mg_lsb, detected):
    board = make_board(motion=Pushed(0.3, ((0.5, 0.7),)), motion_threshold_mg_lsb=mg_lsb)
    watching(board, MOT, motion=20, motion_ms=3)
    board.wait_ms(1000)
    assert bool(board.byte(0x3A) & MOT) == detected


@pytest.mark.parametrize("turned", [False, True])
def test_motion_says_which_axis_moved_which_way_until_it_is_read(make_board, turned):
    board = make_board(motion=Pushed(-0.5 if turned else 0.5, ((0.5, 5.0),)))
    watching(board, MOT, motion=50)
    board.wait_ms(800)
    assert board.byte(0x61) == (0x08 if turned else 0x04)
    assert board.byte(0x61) == 0


def test_motion_is_blind_while_the_high_pass_filter_is_off(make_board):
    board = make_board(motion=Pushed(0.5, ((0.5, 0.6),)))
    watching(board, MOT, dhpf=0, motion=10)
    board.wait_ms(1000)
    assert not board.byte(0x3A) & MOT


def test_hold_compares_with_the_sample_of_its_moment(make_board):
    board = make_board(motion=Tilt())
    watching(board, MOT, dhpf=1, motion=100, motion_ms=1)
    board.wait_ms(1000)
    held = board.sensors()[:3] / 16384
    board.wr(0x1C, 0x07)
    board.wr(0x37, LATCHED)
    while not board.chip.int_level():
        board.wait_ms(1)
        assert board.clock.now_ns() < 10_000_000_000
    assert np.abs(board.sensors()[:3] / 16384 - held).max() == pytest.approx(0.2, abs=0.01)


def test_hold_takes_the_sample_and_not_what_the_filter_had_got_to(make_board):
    board = make_board(motion=Pushed(0.5, ((1.0, 3.0),)))
    watching(board, MOT, dhpf=4, motion=100)
    board.wait_ms(1050)
    board.wr(0x1C, 0x07)
    assert board.byte(0x3A) & MOT
    board.wait_ms(1500)
    assert not board.byte(0x3A) & MOT
    board.wait_ms(500)
    assert board.byte(0x61) & 0x08


def test_zero_motion_is_told_of_when_it_begins_and_when_it_ends_and_its_status_stays(make_board):
    board = make_board(motion=Pushed(0.5, ((3.0, 3.01),)))
    watching(board, ZMOT, motion=255, rest=50, rest_64ms=10)
    board.wait_ms(600)
    assert (board.byte(0x3A) & ZMOT, board.byte(0x61)) == (0, 0)
    board.wait_ms(100)
    assert board.byte(0x3A) & ZMOT
    assert [board.byte(0x61) for _ in range(2)] == [1, 1]
    board.wait_ms(4000)
    begun = begins(board)
    assert len(begun) == 3
    assert np.array(begun[:2]) * 1e-6 == pytest.approx([644, 3002], abs=3)
    assert (begun[2] - begun[1]) * 1e-6 >= 640
    assert board.byte(0x61) == 1


def test_detectors_see_nothing_for_some_milliseconds_after_waking(make_board):
    first = []
    for delay in range(4):
        board = make_board(motion=Pushed(-1.0, ((0.0, 9.0),)))
        board.wr(0x6B, 0x01)
        board.wr(0x1A, 0x01, 0x00, 0x00, 100, 1)
        board.wr(0x69, delay << 4)
        board.wr(0x38, FF)
        board.wait_ms(100)
        first.append(begins(board)[0] * 1e-6)
    assert np.diff(first) == pytest.approx(1, abs=0.01)
    assert first[0] == pytest.approx(5, abs=1)


def test_axis_in_standby_detects_nothing(make_board):
    board = make_board(motion=Pushed(0.5, ((0.5, 0.6),)))
    board.wr(0x6B, 0x01)
    board.wr(0x6C, 0x08)  # z
    watching(board, MOT, motion=20)
    board.wait_ms(1000)
    assert not board.byte(0x3A) & MOT
    board.wr(0x6C, 0x38)
    watching(board, FF | ZMOT, fall=255, rest=255)
    board.wait_ms(1000)
    assert not board.byte(0x3A) & (FF | ZMOT)


@pytest.mark.parametrize("wake", [1, 2, 3])
def test_cycling_chip_wakes_its_host_by_motion(make_board, wake):
    board = make_board(motion=Tilt())
    watching(board, MOT, dhpf=1, motion=50, motion_ms=1, pin=LATCHED)
    board.wr(0x6C, wake << 6 | 0x07)
    board.wr(0x6B, 0x28)
    board.wr(0x1C, 0x07)
    board.wait_ms(500)
    board.byte(0x3A)
    board.wait_ms(10_000)
    assert board.chip.int_level()
    (t_ns,) = begins(board)[-1:]
    at = board.chip.run
    assert (t_ns - at.start_ns) % round(at.period_ns) in (0, 1)
    assert board.byte(0x3A) & MOT


def test_pulses_of_motion_and_of_data_ready_come_in_the_order_of_time(make_board):
    def edges(look_ms):
        board = make_board(imperfections=TYPICAL, motion=Tilt(), pll_error=0.01)
        watching(board, MOT | DATA_READY, motion=4, motion_ms=1)
        board.wr(0x19, 6)
        board.start_fifo()
        for _ in range(round(600 / look_ms)):
            board.wait_ms(look_ms)
            look(board)
        return board.chip.int_edges(0)

    at_once = edges(600)
    assert at_once == edges(1.7)[: len(at_once)] or at_once == edges(1.5)
    times = [edge.t_ns for edge in at_once]
    assert times == sorted(times)
    # Samples are 7 ms apart, so pulses between them are motion's.
    assert len(times) / 2 > 600 / 7 + 10


def test_status_does_not_depend_on_how_often_one_looks(make_board):
    def seen(look_ms):
        board = make_board(motion=Tilt(), imperfections=TYPICAL)
        watching(board, 0, fall=10, motion=10, motion_ms=2, rest=20, rest_64ms=5)
        for _ in range(round(20_000 / look_ms)):
            board.wait_ms(look_ms)
            look(board)
        return board.rd(0x3A), board.rd(0x61)

    assert seen(20_000) == seen(40)
    status, axes = seen(500)
    assert status[0] == MOT | ZMOT | DATA_READY
    assert axes[0] & 0xFE


def test_one_knock_in_an_hour_without_a_look_is_not_missed(make_board):
    board = make_board(motion=Pushed(0.5, ((2000.0, 2000.02),)))
    watching(board, MOT, motion=50, pin=LATCHED)
    board.wait_ms(3_600_000)
    assert board.chip.int_level()
    (t_ns,) = begins(board)
    assert t_ns * 1e-9 == pytest.approx(2000.003, abs=0.003)
    assert board.byte(0x3A) & MOT


def wake_on_motion(board, *, above, mode=0xC0, enable=MOT):
    board.wake()
    board.wr(0x1F, above)
    board.wr(0x69, mode)
    board.wr(0x37, 0x00, enable)
    return board


@pytest.mark.parametrize(("above", "detected"), [(1, True), (20, True), (30, False), (255, False)])
def test_wake_on_motion_compares_with_the_sample_before_at_4_mg(make_board, above, detected):
    # 100 mg within one sample: the low-pass filter is passed by.
    board = make_board(motion=Pushed(0.1, ((1.0, 2.0),)), personality=MPU9250)
    wake_on_motion(board, above=above)
    board.wr(0x1D, 0x08)
    board.wait_ms(500)
    assert not board.byte(0x3A) & MOT
    board.wait_ms(2500)
    assert bool(board.byte(0x3A) & MOT) == detected
    assert len(begins(board)) == (2 if detected else 0)


def test_wake_on_motion_sees_a_step_between_two_looks(make_board):
    board = make_board(motion=Pushed(0.1, ((0.05, 2.0),)), personality=MPU9250)
    wake_on_motion(board, above=20)
    board.wr(0x1D, 0x08)
    while board.clock.now_ns() < 100_000_000:
        board.wait_ms(0.5)
        look(board)
    assert len(begins(board)) == 1


@pytest.mark.parametrize("mode", [0x00, 0x40, 0x80])
def test_wake_on_motion_needs_both_of_its_bits(make_board, mode):
    board = make_board(motion=Pushed(0.5, ((1.0, 2.0),)), personality=MPU6500)
    wake_on_motion(board, above=5, mode=mode)
    board.wait_ms(3000)
    assert not board.byte(0x3A) & MOT


def test_wake_on_motion_works_while_cycling_as_its_data_sheet_describes(make_board):
    board = make_board(motion=Pushed(0.5, ((1.0, 2.0),)), personality=MPU9250)
    # RM9250, wake on motion: accelerometer on, own filter, interrupt, comparison, threshold, rate, cycle.
    for register, value in ((0x6C, 0x07), (0x1D, 0x01), (0x38, 0x40), (0x69, 0xC0), (0x1F, 0x20), (0x1E, 6)):
        board.wr(register, value)
    board.wr(0x6B, 0x20)
    board.wait_ms(900)
    assert begins(board) == []
    board.wait_ms(2000)
    assert len(begins(board)) == 2
    assert (begins(board)[1] - begins(board)[0]) * 1e-6 == pytest.approx(1000, abs=64)


def test_detectors_of_the_6050_are_not_in_the_6500(make_board):
    board = make_board(motion=Pushed(-1.0, ((0.5, 2.0),)), personality=MPU6500)
    watching(board, 0xFF, fall=100, motion=10, rest=100)
    assert board.byte(0x38) == 0x59
    board.wait_ms(3000)
    assert not board.byte(0x3A) & (FF | MOT | ZMOT)


def test_looking_for_motion_does_not_change_the_samples(make_board):
    def stream(dhpf):
        board = make_board(imperfections=TYPICAL, motion=Still())
        watching(board, MOT, dhpf=dhpf, motion=3)
        board.start_fifo()
        return board.collect(5).tobytes()

    assert stream(0) == stream(1)


def test_detectors_see_a_motion_that_is_changed_while_the_chip_runs(make_board):
    pushed = Pushed(0.0, ((0.5, 9.0),))
    board = make_board(motion=pushed)
    watching(board, MOT, motion=50)
    board.wait_ms(200)
    look(board)
    object.__setattr__(pushed, "push_g", 0.5)
    board.chip.recompute()
    board.wait_ms(500)
    assert board.byte(0x3A) & MOT
