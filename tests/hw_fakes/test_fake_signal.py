"""What the words hold: filter, noise, ranges, offsets, self-test."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest

from hw_fakes import PERFECT, TYPICAL, Imperfections, Still, Turntable
from quavelet.core.units import DEG_PER_RAD, RAD_PER_DEG, STANDARD_GRAVITY_M_S2

# RM register 26: accelerometer bandwidth Hz and delay ms, gyroscope bandwidth Hz and delay ms.
DLPF = {
    0: (260, 0.0, 256, 0.98),
    1: (184, 2.0, 188, 1.9),
    2: (94, 3.0, 98, 2.8),
    3: (44, 4.9, 42, 4.8),
    4: (21, 8.5, 20, 8.3),
    5: (10, 13.8, 10, 13.4),
    6: (5, 19.0, 5, 18.6),
}
NAMES = {0: "accelerometer", 4: "gyroscope"}


@dataclass(frozen=True)
class Shaken:
    """A pure tone in gyroscope x and accelerometer x; only its response is asked for."""

    hz: float

    def rate_rad_s(self, t_s):
        return np.outer(np.sin(2 * np.pi * self.hz * t_s), [200 * RAD_PER_DEG, 0, 0])

    def specific_force_m_s2(self, t_s):
        return np.outer(np.sin(2 * np.pi * self.hz * t_s), [1.5 * STANDARD_GRAVITY_M_S2, 0, 0])

    def attitude(self, t_s):
        return np.tile([1.0, 0.0, 0.0, 0.0], (len(t_s), 1))


def response(make_board, dlpf, hz, word):
    """Gain, and delay in s, of one word at a frequency, measured through the FIFO."""
    board = make_board(motion=Shaken(hz))
    fast = dlpf in (0, 7)
    div = 7 if fast and word == 0 else 0  # above 1 kHz the accelerometer is held, which is a filter of its own
    board.wake(dlpf=dlpf, div=div)
    start_ns = board.clock.now_ns()
    board.start_fifo({0: 0x08, 4: 0x40}[word])
    words = {0: 3, 4: 1}[word]
    counts = board.collect(max(1.0, 20 / hz), step_ms=2 if fast else 20, words=words)[:, 0]
    run = board.chip.run
    period_s = (1 + div) / (8000 if fast else 1000)
    # The FIFO's first sample is the first after it was switched on, three writes after the start.
    before = run.samples_by(start_ns + 3 * 72_500)
    t_s = run.start_ns * 1e-9 + period_s * (before + 1 + np.arange(len(counts)))
    basis = np.column_stack([np.sin(2 * np.pi * hz * t_s), np.cos(2 * np.pi * hz * t_s)])
    (a, b), *_ = np.linalg.lstsq(basis, counts, rcond=None)
    full = {0: 1.5 * 16384, 4: 200 * 131.0}[word]
    return np.hypot(a, b) / full, -np.arctan2(b, a) / (2 * np.pi * hz)


@pytest.mark.parametrize("word", [0, 4])
@pytest.mark.parametrize("dlpf", DLPF)
def test_dlpf_is_3_db_down_at_its_bandwidth(make_board, dlpf, word):
    bandwidth_hz = DLPF[dlpf][0 if word == 0 else 2]
    # Gain is 0.7071 between 5 % below and 5 % above the data sheet's frequency.
    low, high = (response(make_board, dlpf, bandwidth_hz * part, word)[0] for part in (0.95, 1.05))
    measured_hz = bandwidth_hz * np.interp(-(0.5**0.5), [-low, -high], [0.95, 1.05])
    print(f"\nDLPF {dlpf}, {NAMES[word]}: -3 dB at {measured_hz:.1f} Hz (data sheet {bandwidth_hz})")
    assert low > 0.5**0.5 > high


@pytest.mark.parametrize(
    ("dlpf", "word"), [(0, 4), *((dlpf, word) for dlpf in (1, 2, 3, 4) for word in (0, 4))]
)  # a delay of 0 ms, the accelerometer's at 0, is not one a filter can have
def test_dlpf_delays_as_the_data_sheet_says(make_board, dlpf, word):
    hz = 1.0 if dlpf > 2 else 5.0
    delay_ms, printed_ms = response(make_board, dlpf, hz, word)[1] * 1e3, DLPF[dlpf][1 if word == 0 else 3]
    print(f"\nDLPF {dlpf}, {NAMES[word]}: {delay_ms:.2f} ms late (data sheet {printed_ms})")
    assert delay_ms == pytest.approx(printed_ms, rel=0.05)


@pytest.mark.parametrize("dlpf", [5, 6])
def test_dlpf_of_the_lowest_settings_has_the_delay_of_one_pole(make_board, dlpf):
    # The printed 13.4 and 18.6 ms do not go with 10 and 5 Hz; see hw_fakes/dlpf.py.
    delay_ms = response(make_board, dlpf, 0.2, 4)[1] * 1e3
    assert delay_ms == pytest.approx({5: 15.4, 6: 31.3}[dlpf], rel=0.02)


def test_noise_has_the_density_asked_for(make_board):
    density = 0.005 * RAD_PER_DEG
    parts = Imperfections(gyro_noise_rad_s_rthz=density, accel_noise_m_s2_rthz=400e-6 * STANDARD_GRAVITY_M_S2)
    board = make_board(imperfections=parts)
    board.wake(dlpf=1)
    board.start_fifo()
    counts = board.collect(120).astype(float)
    # One-sided power density, averaged over 0.5 to 20 Hz, far below where the filter begins: 1 % of chance.
    spectrum = 2 * np.abs(np.fft.rfft(counts - counts.mean(axis=0), axis=0)) ** 2 / (1000 * len(counts))
    hz = np.fft.rfftfreq(len(counts), 1e-3)
    level = np.sqrt(spectrum[(hz > 0.5) & (hz < 20)].mean(axis=0))
    gyro_dps, accel_g = np.sqrt(np.mean(level[4:] ** 2)) / 131, np.sqrt(np.mean(level[:3] ** 2)) / 16384
    print(f"\nnoise: {gyro_dps:.5f} deg/s/rtHz (asked 0.00500), {accel_g * 1e6:.1f} ug/rtHz (asked 400)")
    assert gyro_dps == pytest.approx(0.005, rel=0.05)
    assert accel_g == pytest.approx(400e-6, rel=0.05)


@pytest.mark.parametrize(("dlpf", "gain"), [(1, 0.6319), (2, 0.4658), (3, 0.3147), (4, 0.2315), (6, 0.1255)])
def test_noise_of_a_sample_falls_with_the_bandwidth(make_board, dlpf, gain):
    board = make_board(imperfections=Imperfections(gyro_noise_rad_s_rthz=0.05 * RAD_PER_DEG))
    board.wake(dlpf=dlpf)
    board.start_fifo(0x70)
    sd_dps = board.collect(60, words=3).std() / 131
    assert sd_dps == pytest.approx(0.05 * 500**0.5 * gain, rel=0.05)


def test_noise_is_as_large_as_the_data_sheet_says_at_dlpf_2(make_board):
    board = make_board(imperfections=Imperfections(gyro_noise_rad_s_rthz=0.005 * RAD_PER_DEG))
    board.wake(dlpf=2)
    board.start_fifo(0x70)
    assert board.collect(10, words=3).std() / 131 == pytest.approx(0.05, rel=0.08)  # PS 6.1: 0.05 deg/s rms


def test_same_seed_same_samples_other_seed_others(make_board):
    def samples(seed):
        board = make_board(imperfections=TYPICAL, seed=seed)
        board.wake()
        board.start_fifo()
        return board.collect(1).tobytes()

    assert samples(1) == samples(1)
    assert samples(1) != samples(2)


@pytest.mark.parametrize(("bits", "lsb"), [(0x00, 131.0), (0x08, 65.5), (0x10, 32.8), (0x18, 16.4)])
def test_gyro_range_is_the_data_sheets_and_not_a_power_of_two(make_board, bits, lsb):
    parts = Imperfections(gyro_bias_rad_s=(200 * RAD_PER_DEG, -200 * RAD_PER_DEG, 0))
    board = make_board(imperfections=parts)
    board.wake(gyro=bits)
    board.wait_ms(5)
    assert list(board.sensors()[4:]) == [round(200 * lsb), -round(200 * lsb), 0]


@pytest.mark.parametrize(("bits", "lsb"), [(0x00, 16384), (0x08, 8192), (0x10, 4096), (0x18, 2048)])
def test_accel_range_gives_1_g(board, bits, lsb):
    board.wake(accel=bits)
    board.wait_ms(5)
    assert list(board.sensors()[:3]) == [0, 0, lsb]


def test_counts_clip_and_do_not_wrap(make_board):
    board = make_board(imperfections=Imperfections(gyro_bias_rad_s=(9.0, -9.0, 0.0), accel_scale=(1, 1, 5)))
    board.wake()
    board.wait_ms(5)
    assert list(board.sensors()) == [0, 0, 32767, -3920, 32767, -32768, 0]


@pytest.mark.parametrize("temp_degc", [-10.0, 25.0, 36.53, 60.0])
def test_temperature_follows_the_formula_of_this_chip(make_board, temp_degc):
    board = make_board(imperfections=Imperfections(temp_degc=temp_degc, warm_temp_degc=temp_degc))
    board.wake()
    board.wait_ms(5)
    assert board.sensors()[3] / 340 + 36.53 == pytest.approx(temp_degc, abs=0.5 / 340 + 1e-9)


def test_die_warms_up_and_the_bias_follows(make_board):
    parts = Imperfections(gyro_bias_rad_s_degc=(0.1 * RAD_PER_DEG, 0, 0), warm_temp_degc=35.0, warm_up_s=100.0)
    board = make_board(imperfections=parts)
    board.wake()
    board.wait_ms(100e3)
    words = board.sensors()
    risen_degc = 10 * (1 - np.exp(-1))
    assert words[3] / 340 + 36.53 == pytest.approx(25 + risen_degc, abs=0.01)
    assert words[4] / 131 == pytest.approx(0.1 * risen_degc, abs=0.01)


def test_gyroscope_settles_within_1_dps_30_ms_after_waking(make_board):
    board = make_board(imperfections=Imperfections(gyro_settling_rad_s=20 * RAD_PER_DEG))
    board.wait_ms(1000)
    board.wake()
    board.wait_ms(10)
    assert board.sensors()[4] / 131 > 5
    board.wait_ms(25)
    assert 0 <= board.sensors()[4] / 131 < 1
    board.wait_ms(100)
    assert board.sensors()[4] == 0


def test_settling_does_not_begin_again_with_another_rate(make_board):
    board = make_board(imperfections=Imperfections(gyro_settling_rad_s=20 * RAD_PER_DEG))
    board.wake()
    board.wait_ms(100)
    board.wr(0x19, 1)
    board.wait_ms(5)
    assert board.sensors()[4] == 0


def test_bias_wanders_as_the_truth_says(make_board):
    board = make_board(imperfections=Imperfections(gyro_drift_rad_s=0.5 * RAD_PER_DEG), seed=4)
    board.wake(dlpf=6)
    seen = []
    for _ in range(50):
        board.wait_ms(10_000)
        truth = board.chip.source.gyro_bias_rad_s(np.array([board.chip.world_time_s(board.clock.now_ns())]))[0]
        seen.append(truth * DEG_PER_RAD)
        assert board.sensors()[4:] / 131 == pytest.approx(seen[-1], abs=0.01)
    assert 0.2 < np.std(seen) < 0.9


def test_another_range_shows_with_the_next_sample_not_before(board):
    board.wake(div=99)
    board.wait_ms(105)
    board.wr(0x1C, 0x18)
    assert board.sensors()[2] == 16384
    board.wait_ms(100)
    assert board.sensors()[2] == 2048


def test_self_test_adds_the_factory_response_of_a_real_chip(board):
    # Registers 51 4F B8 A5 of a published chip; accelerometer at +-8 g, gyroscope at +-250 deg/s.
    board.wake(accel=0x10)
    board.wait_ms(5)
    off = board.sensors().astype(int)
    board.wr(0x1B, 0xE0)
    board.wr(0x1C, 0xF0)
    board.wait_ms(5)
    shift = board.sensors() - off
    assert np.allclose(shift[:3], [1877.29, 1816.02, 2704.24], atol=1)
    assert np.allclose(shift[4:], [6725.40, -6146.88, 9213.83], atol=1)


@pytest.mark.parametrize("seed", [0, 1])
def test_self_test_as_the_vendor_does_it_is_within_1_percent_of_factory_trim(make_board, seed):
    """Averages of the FIFO at 1 kHz with and without, on a part with noise and bias; RM registers 13 to 16."""
    board = make_board(imperfections=TYPICAL, seed=seed)
    codes = board.rd(0x0D, 4)

    def mean(bits):
        board.wake(gyro=bits, accel=0x10 | bits)
        board.wait_ms(200)
        board.start_fifo(0x78)
        return board.collect(1, words=6).mean(axis=0)

    response = mean(0xE0) - mean(0x00)
    accel = [(code >> 3 & 0x1C) | (codes[3] >> shift & 3) for code, shift in zip(codes, (4, 2, 0), strict=False)]
    trim = [4096 * 0.34 * (0.92 / 0.34) ** ((n - 1) / 30) for n in accel]
    trim += [sign * 25 * 131 * 1.046 ** ((code & 31) - 1) for sign, code in zip((1, -1, 1), codes, strict=False)]
    off = response / trim - 1
    print(f"\nself-test response over factory trim, off by {np.array2string(100 * off, precision=2)} %")
    assert np.abs(off).max() < 0.01


@pytest.mark.parametrize(
    ("codes", "accel", "gyro"), [((0, 0, 0, 0), 0, 0), ((0xFF, 0xFF, 0xFF, 0xFF), 3768.32, 12622.98)]
)
def test_self_test_codes_at_their_ends(make_board, codes, accel, gyro):
    board = make_board(self_test_codes=codes, motion=Still(roll_deg=90.0))
    board.wake(accel=0xF0, gyro=0xE0)
    board.wait_ms(5)
    words = board.sensors()
    assert words[0] == pytest.approx(accel, abs=1)
    assert words[4] == pytest.approx(gyro, abs=1)


def test_one_axis_of_self_test_moves_that_axis_only(board):
    board.wake(gyro=0x40, accel=0x20)
    board.wait_ms(5)
    words = board.sensors()
    assert words[0] == words[1] == words[4] == words[6] == 0
    assert words[5] < 0 and words[2] > 16384


def test_accel_offset_registers_add_to_the_factory_trim_and_spare_bit_0(board):
    board.wake()
    factory = [int.from_bytes(board.rd(r, 2), "big", signed=True) for r in (0x06, 0x08, 0x0A)]
    for register, value, delta in zip((0x06, 0x08, 0x0A), factory, (204, -102, 0), strict=True):
        board.wr(register, *(((value + delta) & ~1) | (value & 1)).to_bytes(2, "big", signed=True))
    board.wait_ms(5)
    assert list(board.sensors()[:3]) == [204 * 8, -102 * 8, 16384]
    board.wr(0x0A, *((factory[2] & ~1) | 1).to_bytes(2, "big", signed=True))
    board.wait_ms(5)
    assert board.sensors()[2] == 16384


def test_zeroed_accel_offset_registers_show_the_missing_trim(board):
    board.wake()
    trim = int.from_bytes(board.rd(0x08, 2), "big", signed=True) & ~1
    board.wr(0x08, 0, 0)
    board.wait_ms(5)
    assert board.sensors()[1] == -8 * trim


def test_gyro_offset_registers_are_added_at_32_8_lsb_per_dps_in_every_range(make_board):
    board = make_board(imperfections=Imperfections(gyro_bias_rad_s=(10 * RAD_PER_DEG, 0, 0)))
    for bits, lsb in ((0x00, 131), (0x18, 16.4)):
        board.wake(gyro=bits)
        board.wr(0x13, *(-328).to_bytes(2, "big", signed=True), 0, 0, 0x01, 0x48)
        board.wait_ms(5)
        assert list(board.sensors()[4:]) == [0, 0, round(10 * lsb)]


def test_axis_in_standby_goes_on_showing_its_last_value(make_board):
    board = make_board(motion=Turntable(start_s=0.1, ramp_s=0.5), imperfections=PERFECT)
    board.wake(clksel=1)
    board.wait_ms(300)
    before = board.sensors()
    board.wr(0x6C, 0x01)
    board.start_fifo()
    board.wait_ms(40)
    held = board.drain()
    assert before[6] != 0
    assert np.all(held[:, 6] == held[0, 6])
    board.wr(0x6C, 0x00)
    board.wait_ms(40)
    assert board.sensors()[6] > held[0, 6]


def test_switched_off_temperature_stands_still(make_board):
    board = make_board(imperfections=Imperfections(temp_degc=20, warm_temp_degc=40, warm_up_s=1.0))
    board.wake()
    board.wait_ms(100)
    board.wr(0x6B, 0x09)
    first = board.sensors()
    board.wait_ms(1000)
    assert board.sensors()[3] == first[3]
    assert board.sensors()[2] == 16384


def test_rate_comes_in_the_right_unit_and_sign(make_board):
    board = make_board(motion=Turntable(start_s=0.0, ramp_s=0.5, rate_deg_s=90.0))
    board.wake()
    board.wait_ms(2000)
    rate = board.chip.motion.rate_rad_s(np.array([board.chip.world_time_s(board.clock.now_ns())]))[0]
    assert rate[2] * DEG_PER_RAD == pytest.approx(90)
    assert board.sensors()[6] == 90 * 131
