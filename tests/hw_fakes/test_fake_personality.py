"""Relatives and clones: what each does differently, seen through its registers."""

from __future__ import annotations

import numpy as np
import pytest

from hw_fakes import PERFECT, Imperfections, Still
from hw_fakes.chip.personalities import (
    CLONE_69,
    CLONE_72,
    CLONE_75,
    ICM20689,
    MPU6000,
    MPU6050,
    MPU6050_EARLY,
    MPU6500,
    MPU6515,
    MPU9150,
    MPU9250,
    MPU9255,
    PERSONALITIES,
)
from quavelet.core.units import STANDARD_GRAVITY_M_S2

# Chip, WHO_AM_I, PWR_MGMT_1 after reset, FIFO bytes as drivers run it, its size bits, LSB per degC, degC at 0.
OLD = {
    "6050": (MPU6050, 0x68, 0x40, 1024, None, 340.0, 36.53),
    "6000": (MPU6000, 0x68, 0x40, 1024, None, 340.0, 36.53),
    "9150": (MPU9150, 0x68, 0x40, 1024, None, 340.0, 36.53),
    "6050 early": (MPU6050_EARLY, 0x68, 0x40, 1024, None, 340.0, 36.53),
    "clone 69": (CLONE_69, 0x69, 0x40, 1024, None, 340.0, 36.53),
}
NEW = {
    "6500": (MPU6500, 0x70, 0x01, 512, 0x00, 333.87, 21.0),
    "9250": (MPU9250, 0x71, 0x01, 512, 0x00, 333.87, 21.0),
    "9255": (MPU9255, 0x73, 0x01, 512, 0x00, 333.87, 21.0),
    "6515": (MPU6515, 0x74, 0x01, 512, 0x00, 333.87, 21.0),
    "20689": (ICM20689, 0x98, 0x40, 4096, 0xC0, 326.8, 25.0),
}
CLONES = {
    "clone 72": (CLONE_72, 0x72, 0x01, 512, None, 333.87, 21.0),
    "clone 75": (CLONE_75, 0x75, 0x40, 512, None, 333.87, 21.0),
}
ALL = {**OLD, **NEW, **CLONES}


@pytest.fixture(params=ALL)
def fact(request):
    return ALL[request.param]


@pytest.fixture(params=NEW)
def relative(request):
    return NEW[request.param][0]


def test_every_personality_is_looked_at_here():
    assert {fact[0] for fact in ALL.values()} == set(PERSONALITIES)


@pytest.mark.parametrize(("bits", "lsb_per_g"), [(0x00, 8192), (0x08, 4096), (0x10, 2048), (0x18, 1024)])
def test_early_silicon_gives_half_the_counts_and_says_so_in_its_trim(make_board, bits, lsb_per_g):
    board = make_board(personality=MPU6050_EARLY)
    board.wake()
    board.wr(0x1C, bits)
    board.wait_ms(5)
    assert list(board.sensors()[:3]) == [0, 0, lsb_per_g]
    trim = board.rd(0x06, 6)
    assert [byte & 1 for byte in trim[1::2]] == [1, 0, 0]
    assert [int.from_bytes(trim[k : k + 2], "big", signed=True) & ~1 for k in (0, 2, 4)] == [-2100, 800, 1200]


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


@pytest.mark.parametrize("step_ms", [700, 1])
@pytest.mark.parametrize(("mode", "first_ms"), [(0x40, 1), (0x00, 700 - 36)])
def test_fifo_mode_keeps_the_oldest_samples_or_the_newest(make_board, mode, first_ms, step_ms):
    parts = Imperfections(temp_degc=-40.0, warm_temp_degc=85.0, warm_up_s=1.0)
    board = make_board(personality=MPU6500, imperfections=parts)
    board.wake()
    board.wr(0x1A, 0x01 | mode)
    board.start_fifo(0xF8)
    before = board.chip.samples_taken
    for _ in range(700 // step_ms):
        board.wait_ms(step_ms)
        board.chip.write(b"\x75")
        board.chip.stop()
    assert board.fifo_count() == 512
    assert board.byte(0x3A) & 0x10
    data = board.rd(0x74, 512)
    slip = 0 if mode else 512 % 14
    words = np.frombuffer(data[slip : slip + 14 * 36], dtype=">i2").reshape(-1, 7)
    degc = words[:, 3] / 333.87 + 21
    since_ms = (board.chip.run.start_ns + (before + 1) * 1e6) * 1e-6
    taken_ms = -1000 * np.log((degc - 85) / -125)
    assert taken_ms[0] == pytest.approx(since_ms + first_ms, abs=4 if mode else 6)
    assert np.diff(taken_ms) == pytest.approx(1, abs=0.2)


def test_fifo_that_stops_goes_on_when_there_is_room_again(make_board):
    board = make_board(personality=MPU6500)
    board.wake()
    board.wr(0x1A, 0x41)
    board.start_fifo(0x08)
    board.wait_ms(200)
    assert board.byte(0x3A) & 0x10
    assert board.rd(0x74, 512)[:510] == bytes([0, 0, 0, 0, 0x40, 0]) * 85
    board.wait_ms(20)
    assert not board.byte(0x3A) & 0x10
    assert board.fifo_count() // 6 >= 19


def test_fifo_mode_is_reserved_in_the_older_chips(board):
    board.wake()
    board.wr(0x1A, 0x41)
    assert board.byte(0x1A) == 0x01


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
    """A pure tone of 1 g in accelerometer x and of 200 deg/s in gyroscope x."""

    def __init__(self, hz):
        self.hz = hz

    def rate_rad_s(self, t_s):
        return np.outer(np.sin(2 * np.pi * self.hz * t_s), [np.radians(200), 0, 0])

    def specific_force_m_s2(self, t_s):
        return np.outer(np.sin(2 * np.pi * self.hz * t_s), [STANDARD_GRAVITY_M_S2, 0, 0])

    def attitude(self, t_s):
        return np.tile([1.0, 0.0, 0.0, 0.0], (len(t_s), 1))


def gain(make_board, chip, hz, *, config, own):
    return response(make_board, chip, hz, config=config, own=own, mask=0x08)[0]


def response(make_board, chip, hz, *, mask, config=0, own=0, gyro=0, seconds=4.0):
    """Gain, and delay in ms, of the first word in the FIFO at a frequency."""
    board = make_board(personality=chip, motion=Shaken(hz), imperfections=PERFECT)
    board.wake(dlpf=config, gyro=gyro)
    board.wr(0x1D, own)
    board.start_fifo(mask)
    run = board.chip.run
    taken = run.samples_by(board.clock.now_ns())
    first = taken - board.fifo_count() // (6 if mask == 0x08 else 2)
    # 32 kHz is more than the bus carries, so the FIFO is read on no wire, in no time.
    data = b""
    for _ in range(round(seconds * 1e9 / (60 * run.period_ns))):
        board.wait_ms(60 * run.period_ns * 1e-6)
        board.chip.write(b"\x74")
        data += board.chip.read(len(board.chip.fifo))
        board.chip.stop()
    x = np.frombuffer(data, dtype=">i2")[:: 3 if mask == 0x08 else 1].astype(float)
    t_s = (run.start_ns + (first + 1 + np.arange(len(x))) * run.period_ns) * 1e-9
    settled = min(500, len(x) // 4)
    basis = np.column_stack([np.sin(2 * np.pi * hz * t_s), np.cos(2 * np.pi * hz * t_s)])
    a, b = np.linalg.lstsq(basis[settled:], x[settled:], rcond=None)[0]
    full = 16384 if mask == 0x08 else 200 * 131
    return np.hypot(a, b) / full, -np.arctan2(b, a) / (2 * np.pi * hz) * 1e3


# RM9250 registers 26 and 27: DLPF_CFG, FCHOICE_B, 3 dB bandwidth of the gyroscope, its delay ms and rate Hz.
GYRO_6500 = [
    (0, 0, 250, 0.97, 8000),
    (1, 0, 184, 2.9, 1000),
    (2, 0, 92, 3.9, 1000),
    (3, 0, 41, 5.9, 1000),
    (4, 0, 20, 9.9, 1000),
    (5, 0, 10, 17.85, 1000),
    (6, 0, 5, 33.48, 1000),
    (7, 0, 3600, 0.17, 8000),
    (3, 1, 8800, 0.064, 32000),
    (3, 2, 3600, 0.11, 32000),
    (3, 3, 8800, 0.064, 32000),
]


@pytest.mark.parametrize(("config", "fchoice_b", "hz", "delay_ms", "rate_hz"), GYRO_6500)
def test_gyroscope_of_the_6500_class_has_the_bandwidth_delay_and_rate_of_its_own_table(
    make_board, config, fchoice_b, hz, delay_ms, rate_hz
):
    def at(tone_hz):
        how = {"mask": 0x40, "config": config, "own": 0x40, "gyro": fchoice_b}
        return response(make_board, MPU9250, tone_hz, seconds=max(0.05, min(4.0, 20 / tone_hz)), **how)

    low, high = at(hz * 0.95)[0], at(min(hz * 1.05, 0.49 * rate_hz))[0]
    delay = at(hz / 20)[1]
    print(
        f"\n6500 class, CONFIG {config}, FCHOICE_B {fchoice_b}: gain {low:.3f} to {high:.3f} 5 % about {hz} Hz, ",
        end="",
    )
    print(f"{delay:.3f} ms (data sheet {delay_ms})")
    assert low > 0.5**0.5 > high
    assert delay == pytest.approx(delay_ms, rel=0.05)


@pytest.mark.parametrize(
    ("config", "gyro", "rate_hz"), [(1, 0, 100), (6, 0, 100), (0, 0, 8000), (7, 0, 8000), (1, 1, 32e3)]
)
def test_divider_of_the_6500_class_divides_1_khz_only(make_board, config, gyro, rate_hz):
    board = make_board(personality=MPU6500)
    board.wake(dlpf=config, div=9, gyro=gyro)
    assert board.chip.true_rate_hz() == pytest.approx(rate_hz)


def test_fchoice_b_is_reserved_in_the_older_chips(board):
    board.wake(gyro=3)
    assert board.byte(0x1B) == 0
    assert board.chip.true_rate_hz() == pytest.approx(1000)


@pytest.mark.parametrize("config", [0, 7])
def test_slowest_accelerometer_filter_goes_with_the_fastest_gyroscope(make_board, config):
    board = make_board(personality=MPU6500)
    board.wake(dlpf=config, gyro=0x01 if config else 0)
    board.wr(0x1D, 0x06)
    board.wait_ms(50)
    assert board.sensors()[2] == 16384


def test_gyroscopes_of_the_6500_class_stand_by_together(make_board):
    board = make_board(personality=MPU6500, imperfections=Imperfections(warm_temp_degc=60.0, warm_up_s=1.0))
    board.wake(gyro=0xE0)
    board.wait_ms(20)
    held = board.sensors()[4:]
    board.wr(0x6B, 0x11)
    board.wr(0x1B, 0x00)
    board.wait_ms(20)
    assert held.all() and np.array_equal(board.sensors()[4:], held)


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
