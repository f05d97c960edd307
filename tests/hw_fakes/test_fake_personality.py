"""Relatives and clones: what each does differently, seen through its registers."""

from __future__ import annotations

import numpy as np
import pytest

from hw_fakes import PERFECT, Imperfections, Still
from hw_fakes.personalities import ICM20689, MPU6000, MPU6050, MPU6500, MPU6515, MPU9150, MPU9250, MPU9255
from quavelet.core.units import STANDARD_GRAVITY_M_S2

# Chip, WHO_AM_I, PWR_MGMT_1 after reset, FIFO bytes as drivers run it, its size bits, LSB per degC, degC at 0.
OLD = {
    "6050": (MPU6050, 0x68, 0x40, 1024, None, 340.0, 36.53),
    "6000": (MPU6000, 0x68, 0x40, 1024, None, 340.0, 36.53),
    "9150": (MPU9150, 0x68, 0x40, 1024, None, 340.0, 36.53),
}
NEW = {
    "6500": (MPU6500, 0x70, 0x01, 512, 0x00, 333.87, 21.0),
    "9250": (MPU9250, 0x71, 0x01, 512, 0x00, 333.87, 21.0),
    "9255": (MPU9255, 0x73, 0x01, 512, 0x00, 333.87, 21.0),
    "6515": (MPU6515, 0x74, 0x01, 512, 0x00, 333.87, 21.0),
    "20689": (ICM20689, 0x98, 0x40, 4096, 0xC0, 326.8, 25.0),
}
ALL = {**OLD, **NEW}


@pytest.fixture(params=ALL)
def fact(request):
    return ALL[request.param]


@pytest.fixture(params=NEW)
def relative(request):
    return NEW[request.param][0]


def test_chip_says_who_it_is_and_wakes_as_its_data_sheet_says(make_board, fact):
    chip, who_am_i, power = fact[:3]
    board = make_board(personality=chip)
    for _ in range(2):
        assert board.byte(0x75) == who_am_i
        assert board.byte(0x6B) == power
        board.wait_ms(5)
        assert (board.sensors()[2] != 0) == (power == 0x01)
        board.wr(0x6B, 0x80)
        board.wait_ms(110)


def test_samples_of_a_chip_awake_after_reset_do_not_depend_on_who_looks(make_board):
    def taken(looks):
        board = make_board(personality=MPU6500)
        board.wr(0x6B, 0x80)
        for k in range(20 * looks):
            board.clock.sleep_until_ns(k * 10_000_000 + 1)
            board.chip.write(b"\x75")
            board.chip.stop()
        board.clock.sleep_until_ns(300_000_000)
        board.byte(0x3A)
        return board.chip.samples_taken

    assert taken(0) == taken(1) == 1600  # 8 kHz from 100 ms after the write on


def test_fifo_overflows_at_its_size_and_slips_by_what_is_left(make_board, fact):
    chip, _, _, size, bits, *_ = fact
    board = make_board(personality=chip, motion=Still(roll_deg=30, pitch_deg=-20))
    board.wake()
    if bits is not None:
        board.wr(0x1D, bits)
    board.start_fifo()
    board.wait_ms(size // 14 - 1)
    assert not board.byte(0x3A) & 0x10
    board.wait_ms(3)
    assert board.byte(0x3A) & 0x10
    assert board.fifo_count() == size
    data, slip = board.rd(0x74, size), size % 14
    frame = data[slip : slip + 14]
    assert data == frame[14 - slip :] + frame * (size // 14)


@pytest.mark.parametrize(("bits", "size"), [(0x00, 512), (0x40, 1024), (0x80, 2048), (0xC0, 4096)])
def test_fifo_of_the_6500_class_is_as_large_as_asked_for(make_board, relative, bits, size):
    board = make_board(personality=relative)
    board.wake()
    board.wr(0x1D, bits)
    board.start_fifo()
    board.wait_ms(400)
    assert board.fifo_count() == size
    board.wr(0x1D, 0x00)
    assert board.fifo_count() == 512


def test_fifo_of_the_6050_has_one_size(board):
    board.wake()
    board.wr(0x1D, 0xC0)
    board.start_fifo()
    board.wait_ms(400)
    assert board.fifo_count() == 1024


@pytest.mark.parametrize("temp_degc", [-20.0, 25.0, 70.0])
def test_temperature_follows_the_formula_of_the_chip(make_board, fact, temp_degc):
    lsb_per_degc, zero_degc = fact[5:]
    parts = Imperfections(temp_degc=temp_degc, warm_temp_degc=temp_degc)
    board = make_board(personality=fact[0], imperfections=parts)
    board.wake()
    board.wait_ms(5)
    assert board.sensors()[3] / lsb_per_degc + zero_degc == pytest.approx(temp_degc, abs=0.51 / lsb_per_degc)


def test_self_test_of_the_6500_class_gives_the_response_of_its_own_formula(make_board, relative):
    board = make_board(personality=relative, motion=Still(roll_deg=180.0))
    board.wake()
    codes = [*board.rd(0x00, 3), *board.rd(0x0D, 3)]
    assert all(codes)
    board.wait_ms(5)
    off = board.sensors().astype(int)
    board.wr(0x1B, 0xE0, 0xE0)
    board.wait_ms(5)
    shift = board.sensors() - off
    trim = [2620 * 1.01 ** (code - 1) for code in codes]
    assert shift[4:] / trim[:3] == pytest.approx(1, abs=0.01)
    assert shift[:3] / trim[3:] == pytest.approx(1, abs=0.01)


class Shaken:
    """A pure tone of 1 g in accelerometer x."""

    def __init__(self, hz):
        self.hz = hz

    def rate_rad_s(self, t_s):
        return np.zeros((len(t_s), 3))

    def specific_force_m_s2(self, t_s):
        return np.outer(np.sin(2 * np.pi * self.hz * t_s), [STANDARD_GRAVITY_M_S2, 0, 0])

    def attitude(self, t_s):
        return np.tile([1.0, 0.0, 0.0, 0.0], (len(t_s), 1))


def gain(make_board, chip, hz, *, config, own):
    board = make_board(personality=chip, motion=Shaken(hz), imperfections=PERFECT)
    board.wake(dlpf=config)
    board.wr(0x1D, own)
    board.start_fifo(0x08)
    x = board.collect(4, words=3)[500:, 0]
    t_s = np.arange(len(x)) * 1e-3
    basis = np.column_stack([np.sin(2 * np.pi * hz * t_s), np.cos(2 * np.pi * hz * t_s)])
    return np.hypot(*np.linalg.lstsq(basis, x, rcond=None)[0]) / 16384


# RM9250 register 29: A_DLPF_CFG and its 3 dB bandwidth.
@pytest.mark.parametrize(("own", "hz"), [(0, 218.1), (1, 218.1), (2, 99), (3, 44.8), (4, 21.2), (5, 10.2), (6, 5.05)])
def test_accelerometer_of_the_6500_class_is_filtered_by_its_own_register(make_board, own, hz):
    assert gain(make_board, MPU6500, hz * 0.95, config=1, own=own) > 0.5**0.5
    assert gain(make_board, MPU6500, hz * 1.05, config=6, own=own) < 0.5**0.5


@pytest.mark.parametrize("own", [7, 8, 0x0E])
def test_accelerometer_filter_of_the_6500_class_can_be_passed_by(make_board, own):
    assert gain(make_board, MPU6500, 200, config=6, own=own) == pytest.approx(1, abs=0.02)


def test_accelerometer_of_the_6050_ignores_the_filter_register_of_the_6500(make_board):
    assert gain(make_board, MPU6050, 44, config=3, own=0x06) == pytest.approx(0.5**0.5, rel=0.05)


def test_offset_registers_of_the_6500_class_are_elsewhere_and_offset(make_board, relative):
    board = make_board(personality=relative)
    board.wake()
    board.wait_ms(5)
    assert list(board.sensors()[:3]) == [0, 0, 16384]
    for register, steps in ((0x77, 102), (0x7A, -51), (0x7D, 0)):  # of 1/1024 g
        high, low = board.rd(register, 2)
        value = ((high << 8 | low) + 2 * steps) & 0xFFFF
        board.wr(register, value >> 8, value & 0xFF)
    board.wr(0x06, 0x10, 0, 0x10, 0, 0x10, 0)
    board.wait_ms(5)
    assert list(board.sensors()[:3]) == [102 * 16, -51 * 16, 16384]


@pytest.mark.parametrize("name", OLD)
def test_offset_registers_of_the_6500_class_do_nothing_in_the_older_chips(make_board, name):
    board = make_board(personality=OLD[name][0])
    board.wake()
    board.wr(0x77, 0x10, 0)
    board.wait_ms(5)
    assert board.sensors()[0] == 0
