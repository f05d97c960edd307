"""Cycle mode: the chip sleeps and wakes for single samples."""

from __future__ import annotations

import numpy as np
import pytest

from hw_fakes import Imperfections, Turntable
from hw_fakes.chip.personalities import MPU6500, MPU9250
from quavelet.core.units import STANDARD_GRAVITY_M_S2

CYCLE, TEMP_OFF, GYROSCOPES_OFF = 0x20, 0x08, 0x07
ODR_6500_HZ = (0.24, 0.49, 0.98, 1.95, 3.91, 7.81, 15.63, 31.25, 62.5, 125, 250, 500)  # RM9250 register 30


def cycling(board, wake=3, *, clksel=0):
    board.wake(clksel=clksel)
    board.wr(0x6C, wake << 6 | GYROSCOPES_OFF)
    board.wr(0x6B, CYCLE | TEMP_OFF | clksel)
    return board


def rate_hz(board, seconds):
    before, start_ns = board.chip.samples_taken, board.clock.now_ns()
    board.wait_ms(seconds * 1e3)
    board.chip.write(b"\x75")  # a look, on no wire: it takes no time
    board.chip.stop()
    return (board.chip.samples_taken - before) / ((board.clock.now_ns() - start_ns) * 1e-9)


@pytest.mark.parametrize(("wake", "hz"), [(0, 1.25), (1, 5.0), (2, 20.0), (3, 40.0)])
@pytest.mark.parametrize("error", [0.0, -0.04, 0.03])
@pytest.mark.parametrize("clksel", [0, 1])
def test_wakes_come_at_the_rate_of_lp_wake_ctrl_by_the_internal_oscillator(make_board, wake, hz, error, clksel):
    board = cycling(make_board(internal_error=error, pll_error=0.01), wake, clksel=clksel)
    got_hz = rate_hz(board, 2000)
    assert got_hz == pytest.approx(hz * (1 + error), rel=1e-3)
    assert board.chip.true_rate_hz() == pytest.approx(hz * (1 + error), rel=1e-9)


@pytest.mark.parametrize(("code", "hz"), [*enumerate(ODR_6500_HZ), (15, 500)])
def test_wakes_of_the_6500_class_come_at_the_rate_of_lp_accel_odr(make_board, code, hz):
    board = make_board(personality=MPU9250, internal_error=0.02)
    board.wake()
    board.wr(0x1E, code)
    board.wr(0x6C, GYROSCOPES_OFF)
    board.wr(0x6B, CYCLE)
    exact_hz = 500 / 2 ** max(0, 11 - code)  # the table's figures are this, rounded
    assert exact_hz == pytest.approx(hz, abs=0.006)
    assert rate_hz(board, 10_000) == pytest.approx(exact_hz * 1.02, rel=1e-3)


def test_sleep_is_stronger_than_cycle(board):
    board.wr(0x6B, 0x40 | CYCLE)
    board.wait_ms(5000)
    assert board.chip.samples_taken == 0
    assert board.rd(0x3B, 14) == bytes(14)


def test_data_ready_fifo_and_pin_follow_the_wakes(board):
    cycling(board)
    board.wr(0x37, 0x00, 0x01)
    board.start_fifo(0x08)
    since_ns = board.clock.now_ns()
    board.wait_ms(1000)
    begins = [edge.t_ns for edge in board.chip.int_edges(since_ns) if edge.high]
    assert len(begins) in (39, 40)
    assert np.diff(begins) == pytest.approx(25_000_000, abs=1)
    assert len(board.drain(3)) == len(begins)
    assert board.byte(0x3A) == 0x01
    assert board.byte(0x3A) == 0x00


def test_gyroscopes_in_standby_stand_still_while_the_accelerometer_goes_on(make_board):
    board = make_board(motion=Turntable(start_s=0.0, ramp_s=0.5, axis_tilt_deg=20.0))
    board.wake()
    board.wait_ms(2000)
    board.wr(0x6C, 0xC0 | GYROSCOPES_OFF)
    before = board.sensors()
    board.wr(0x6B, CYCLE | TEMP_OFF)
    rows = []
    for _ in range(20):
        board.wait_ms(50)
        rows.append(board.sensors())
    assert np.all(np.array(rows)[:, 3:] == before[3:])
    assert len(np.unique(np.array(rows)[:, 0])) > 10


def test_single_samples_have_the_noise_of_an_unfiltered_kilohertz(make_board):
    parts = Imperfections(accel_noise_m_s2_rthz=400e-6 * STANDARD_GRAVITY_M_S2, gyro_noise_rad_s_rthz=np.radians(0.005))
    board = make_board(imperfections=parts)
    board.wake(dlpf=6)
    board.wr(0x6C, 0xC0)
    board.wr(0x6B, CYCLE)
    board.start_fifo(0x78)
    sd = board.collect(200, step_ms=500, words=6).std(axis=0)
    assert sd[:3] / 16384 == pytest.approx(400e-6 * 500**0.5, rel=0.05)
    assert sd[3:] / 131 == pytest.approx(0.005 * 500**0.5, rel=0.05)


def test_a_chip_that_stops_cycling_samples_as_before(make_board):
    board = make_board(pll_error=0.01)
    cycling(board)
    board.wait_ms(500)
    board.wr(0x6C, 0x00)
    board.wr(0x6B, 0x01)
    assert rate_hz(board, 20) == pytest.approx(1010, rel=1e-3)


def test_cycle_of_the_6050_ignores_the_odr_register_of_the_6500(board):
    cycling(board)
    board.wr(0x1E, 0x01)
    assert board.chip.true_rate_hz() == pytest.approx(40)


def test_cycle_of_the_6500_ignores_the_wake_bits_of_the_6050(make_board):
    board = cycling(make_board(personality=MPU6500))
    assert board.chip.true_rate_hz() == pytest.approx(0.244, rel=1e-3)


def test_cycling_is_timed_by_the_internal_oscillator_with_the_clocks_gyroscope_on_too(make_board):
    board = make_board(internal_error=-0.04, pll_error=0.01)
    board.wake(clksel=1)
    board.wr(0x6C, 0xC0)
    board.wr(0x6B, CYCLE | 0x01)
    assert board.chip.true_rate_hz() == pytest.approx(40 * 0.96)
    board.start_fifo(0x70)
    board.wait_ms(1000)
    assert len(board.drain(3)) in (38, 39)  # the gyroscopes that are on are sampled with it
