"""The HMC5883L and the QMC5883L that is sold in its place, each through its messages."""

from __future__ import annotations

import numpy as np
import pytest
from magnetometer_bench import Bench, body_field_ut

from hw_fakes.magnetometers.base import MagnetometerImperfections
from hw_fakes.magnetometers.hmc5883l import Hmc5883l
from hw_fakes.magnetometers.qmc5883l import Qmc5883l
from hw_fakes.world.motion import Turntable


def hmc_in_continuous_mode(*, config_a=0x18, config_b=0x20, **options):
    bench = Bench(Hmc5883l, **options)
    bench.wait_ms(60)
    bench.wr(0x00, config_a, config_b, 0x00)
    bench.wait_ms(6)
    bench.rd(0x03, 6)  # still with the gain before
    return bench


@pytest.mark.parametrize("gain", range(8))
def test_hmc5883l_words_are_x_z_y_at_the_printed_gain(gain):
    lsb_per_gauss = [1370, 1090, 820, 660, 440, 390, 330, 230][gain]
    bench = hmc_in_continuous_mode(config_b=gain << 5)
    bench.wait_ms(300)
    x, y, z = body_field_ut() / 100 * lsb_per_gauss
    assert np.all(np.abs(bench.words(0x03, ">i2") - [x, z, y]) <= 0.5)


def test_hmc5883l_is_told_from_other_chips_by_h43():
    bench = Bench(Hmc5883l)
    assert bench.rd(0x0A, 3) == b"H43"
    assert bench.rd(0x00, 3) == b"\x10\x20\x01"


def test_hmc5883l_overflow_reads_minus_4096_on_the_axis_alone():
    # 120 uT is 1644 LSB at 1370 LSB/G and fits; 200 uT does not, on the axis that sees most of it.
    bench = hmc_in_continuous_mode(config_b=0x00, strength_ut=200.0)
    bench.wait_ms(300)
    x, y, z = np.rint(body_field_ut(200.0) / 100 * 1370)
    truth = np.array([x, z, y])
    assert (np.abs(truth) > 2048).any()
    assert (np.abs(truth) < 2047).any()
    assert list(bench.words(0x03, ">i2")) == [-4096 if abs(t) > 2048 else t for t in truth]


@pytest.mark.parametrize(("config_a", "sign"), [(0x19, 1), (0x1A, -1)])
def test_hmc5883l_self_test_shows_the_strap_alone(config_a, sign):
    # Data sheet page 19: about 452 in x and y and 421 in z at 390 LSB per gauss.
    bench = hmc_in_continuous_mode(config_a=config_a, config_b=0xA0)
    bench.wait_ms(300)
    assert list(sign * bench.words(0x03, ">i2")) == [452, 421, 452]


def test_hmc5883l_self_test_at_the_highest_gain_overflows():
    # Data sheet page 19: the strap's field comes on top of the world's.
    bench = hmc_in_continuous_mode(config_a=0x1A, config_b=0x00, strength_ut=60.0)
    bench.wait_ms(300)
    x, y, z = (body_field_ut(60.0) / 100 - [1.16, 1.16, 1.08]) * 1370 < -2048
    assert list(bench.words(0x03, ">i2") == -4096) == [x, z, y]
    assert any([x, y, z])
    assert not all([x, y, z])


def test_hmc5883l_first_measurement_after_a_change_of_gain_has_the_gain_before():
    bench = hmc_in_continuous_mode(config_a=0x18, config_b=0x20)
    bench.wait_ms(200)
    old = bench.words(0x03, ">i2")
    bench.wr(0x01, 0xE0)
    bench.wait_ms(14)
    first = bench.words(0x03, ">i2")
    bench.wait_ms(200)
    later = bench.words(0x03, ">i2")
    assert list(first) == list(old)
    assert np.all(np.abs(later - old * 230 / 1090) <= 1)


def test_hmc5883l_gain_changed_twice_before_a_measurement_is_still_the_old_one_at_first():
    bench = hmc_in_continuous_mode(config_a=0x18, config_b=0x20)
    bench.wait_ms(200)
    old = bench.words(0x03, ">i2")
    bench.wr(0x01, 0xE0)
    bench.wr(0x01, 0x60)
    bench.wait_ms(14)
    assert list(bench.words(0x03, ">i2")) == list(old)
    bench.wait_ms(14)
    assert np.all(np.abs(bench.words(0x03, ">i2") - old * 660 / 1090) <= 1)


@pytest.mark.parametrize(("bits", "rate_hz"), [(0, 0.75), (1, 1.5), (2, 3), (3, 7.5), (4, 15), (5, 30), (6, 75)])
def test_hmc5883l_measures_at_the_rate_that_is_set(bits, rate_hz):
    bench = hmc_in_continuous_mode(config_a=bits << 2)
    before = bench.chip.measurements
    bench.wait_ms(20_000)
    bench.byte(0x09)
    assert bench.chip.measurements - before == pytest.approx(20 * rate_hz, abs=1)


def test_hmc5883l_single_measurement_ends_in_idle_after_6_ms():
    bench = Bench(Hmc5883l)
    bench.wait_ms(60)
    bench.rd(0x03, 6)
    bench.wr(0x02, 0x01)
    bench.wait_ms(5.9)
    assert bench.byte(0x09) & 1 == 0
    bench.wait_ms(0.2)
    assert bench.byte(0x09) == 1
    assert bench.byte(0x02) & 0x02
    count = bench.chip.measurements
    bench.wait_ms(1000)
    bench.rd(0x03, 6)
    assert bench.chip.measurements == count
    assert bench.byte(0x09) & 1 == 0


def test_hmc5883l_is_not_ready_again_before_a_second_single_measurement_has_ended():
    bench = Bench(Hmc5883l)
    bench.wait_ms(60)
    assert bench.byte(0x09) == 1
    bench.wr(0x02, 0x01)
    assert bench.byte(0x09) == 0
    bench.wait_ms(7)
    assert bench.byte(0x09) == 1


@pytest.mark.parametrize(("register", "value"), [(0x00, 0x18), (0x02, 0x00)])
def test_hmc5883l_data_are_released_by_writing_configuration_a_or_the_mode(register, value):
    bench = hmc_in_continuous_mode()
    bench.byte(0x03)
    assert bench.byte(0x09) & 2
    bench.wr(register, value)
    assert bench.byte(0x09) & 2 == 0


def test_hmc5883l_has_a_first_measurement_56_ms_after_power_up_and_zeros_before():
    bench = Bench(Hmc5883l)
    bench.wait_ms(55)
    assert bench.rd(0x03, 6) == bytes(6)
    bench.wait_ms(2)
    assert bench.byte(0x09) == 1
    assert bench.rd(0x03, 6) != bytes(6)


def test_hmc5883l_data_stay_until_all_six_are_read():
    bench = hmc_in_continuous_mode(motion=Turntable(start_s=0))
    bench.wait_ms(2000)
    first = bench.rd(0x03, 5)
    assert bench.byte(0x09) & 2
    bench.wait_ms(500)
    assert bench.rd(0x03, 5) == first
    bench.rd(0x03, 6)
    assert bench.byte(0x09) & 2 == 0
    bench.wait_ms(500)
    assert bench.rd(0x03, 5) != first


def test_hmc5883l_data_freeze_where_the_mode_register_is_read():
    def read(*, mode_first):
        bench = hmc_in_continuous_mode(motion=Turntable(start_s=0))
        bench.wait_ms(2000)
        if mode_first:
            bench.byte(0x02)
            assert bench.byte(0x09) & 2
            bench.wait_ms(500)
        data = bench.rd(0x03, 6)
        assert bench.byte(0x09) & 2 == 0
        bench.wait_ms(500)
        return data, bench.rd(0x03, 6)

    frozen, later = read(mode_first=True)
    assert frozen == read(mode_first=False)[0]
    assert frozen != later


def test_hmc5883l_ready_bit_falls_for_250_us_around_new_data():
    bench = hmc_in_continuous_mode(config_a=0x18)  # 75 Hz
    seen = []
    for _ in range(1333):
        bench.wait_ms(0.01)
        seen.append(bench.byte(0x09) & 1)
    assert 23 <= seen.count(0) <= 27


def test_hmc5883l_pointer_goes_from_the_last_data_byte_to_the_first():
    bench = hmc_in_continuous_mode()
    bench.wait_ms(100)
    twice = bench.rd(0x03, 12)
    assert twice[:6] == twice[6:]
    assert bench.rd(0x0A, 4) == b"H43" + bench.rd(0x00)
    assert bench.rd(0x40) == b"\x00"


def test_hmc5883l_status_and_identification_cannot_be_written():
    bench = Bench(Hmc5883l)
    bench.wr(0x03, *[0xFF] * 6)
    bench.wr(0x09, 0xFF)
    bench.wr(0x0A, 1, 2, 3)
    bench.wr(0x00, 0xFF, 0xFF)
    assert bench.rd(0x0A, 3) == b"H43"
    assert bench.rd(0x00, 2) == b"\x7f\xe0"
    assert bench.rd(0x03, 6) == bytes(6)


@pytest.mark.parametrize(("config_a", "averaged"), [(0x18, 1), (0x38, 2), (0x58, 4), (0x78, 8)])
def test_hmc5883l_averaging_quietens_it(config_a, averaged):
    bench = hmc_in_continuous_mode(config_a=config_a, imperfections=MagnetometerImperfections(noise_ut=5.0, seed=3))
    words = []
    for _ in range(400):
        bench.wait_ms(14)
        words.append(bench.words(0x03, ">i2"))
    assert np.std(words, axis=0).mean() == pytest.approx(5.0 * 10.9 / averaged**0.5, rel=0.1)


@pytest.mark.parametrize(("range_bit", "lsb_per_gauss"), [(0x00, 12000), (0x10, 3000)])
def test_qmc5883l_words_are_x_y_z_low_byte_first_at_the_range(range_bit, lsb_per_gauss):
    bench = Bench(Qmc5883l)
    bench.wr(0x0B, 0x01)
    bench.wr(0x09, 0x0D | range_bit)
    bench.wait_ms(20)
    assert np.all(np.abs(bench.words(0x00, "<i2") - body_field_ut() / 100 * lsb_per_gauss) <= 0.5)


def test_hmc5883l_driver_finds_no_h43_on_the_board_with_a_qmc5883l():
    bench = Bench(Qmc5883l)
    assert bench.chip.address == 0x0D != Hmc5883l.address
    assert bench.rd(0x0A, 3) != b"H43"
    assert bench.byte(0x0D) == 0xFF


@pytest.mark.parametrize(("bits", "rate_hz"), [(0, 10), (1, 50), (2, 100), (3, 200)])
def test_qmc5883l_measures_at_the_rate_that_is_set_and_not_in_standby(bits, rate_hz):
    bench = Bench(Qmc5883l)
    bench.wait_ms(3000)
    assert bench.byte(0x06) == 0
    bench.wr(0x09, 0x01 | bits << 2)
    bench.wait_ms(10_000)
    bench.byte(0x06)
    assert bench.chip.measurements == 10 * rate_hz
    bench.wr(0x09, 0x00)
    bench.wait_ms(1000)
    bench.byte(0x06)
    assert bench.chip.measurements == 10 * rate_hz


def test_qmc5883l_change_of_range_does_not_disturb_the_rate():
    bench = Bench(Qmc5883l)
    bench.wr(0x09, 0x01)
    for value in [0x11, 0x01] * 50:
        bench.wait_ms(37)
        bench.wr(0x09, value)
    assert bench.chip.measurements == 37


@pytest.mark.parametrize(("osr_bits", "factor"), [(0x00, 1), (0x40, 2**0.5), (0x80, 2), (0xC0, 8**0.5)])
def test_qmc5883l_oversampling_quietens_it(osr_bits, factor):
    bench = Bench(Qmc5883l, imperfections=MagnetometerImperfections(noise_ut=0.5, seed=3))
    bench.wr(0x09, 0x0D | osr_bits)
    words = []
    for _ in range(400):
        bench.wait_ms(5)
        words.append(bench.words(0x00, "<i2"))
    assert np.std(words, axis=0).mean() == pytest.approx(0.5 * 120 * factor, rel=0.1)


def test_qmc5883l_data_ready_is_cleared_by_reading_data_not_by_reading_the_status():
    bench = Bench(Qmc5883l)
    bench.wr(0x09, 0x01)
    bench.wait_ms(101)
    assert bench.byte(0x06) == 1
    assert bench.byte(0x06) == 1
    bench.rd(0x00, 6)
    assert bench.byte(0x06) == 0


def test_qmc5883l_status_at_the_end_of_a_burst_from_the_data_never_says_ready():
    bench = Bench(Qmc5883l)
    bench.wr(0x09, 0x0D)
    for _ in range(5):
        bench.wait_ms(6)
        assert bench.rd(0x00, 7)[6] & 1 == 0


def test_qmc5883l_tells_of_skipped_data():
    bench = Bench(Qmc5883l)
    bench.wr(0x09, 0x0D)
    bench.wait_ms(5.5)
    assert bench.byte(0x06) == 1
    bench.wait_ms(5)
    assert bench.byte(0x06) == 1 | 4
    bench.rd(0x00, 6)
    assert bench.byte(0x06) == 0


def test_qmc5883l_skipped_data_are_told_however_seldom_one_looks():
    bench = Bench(Qmc5883l)
    bench.wr(0x09, 0x0D)
    bench.wait_ms(50.5)
    assert bench.byte(0x06) == 1 | 4


def test_qmc5883l_places_no_data_between_the_first_and_the_last_byte_read():
    bench = Bench(Qmc5883l, motion=Turntable(start_s=0))
    bench.wr(0x09, 0x0D)
    bench.wait_ms(1000)
    first = bench.rd(0x00, 5)
    bench.wait_ms(500)
    assert bench.rd(0x00, 5) == first
    bench.byte(0x05)
    bench.wait_ms(6)
    assert bench.rd(0x00, 5) != first


def test_qmc5883l_overflow_is_flagged_and_the_word_clipped():
    bench = Bench(Qmc5883l, imperfections=MagnetometerImperfections(hard_iron_ut=(300.0, 0.0, -300.0)))
    bench.wr(0x09, 0x0D)
    bench.wait_ms(6)
    assert bench.byte(0x06) & 2
    x, _, z = bench.words(0x00, "<i2")
    assert (x, z) == (32767, -32768)
    bench.wr(0x09, 0x1D)
    bench.wait_ms(11)
    assert bench.byte(0x06) & 2 == 0


def test_qmc5883l_roll_over_repeats_data_and_status():
    bench = Bench(Qmc5883l)
    bench.wr(0x09, 0x0D)
    bench.wait_ms(6)
    assert bench.rd(0x00, 14)[7:9] == bench.rd(0x07, 2)
    bench.wr(0x0A, 0x40)
    twice = bench.rd(0x00, 14)
    assert twice[:6] == twice[7:13]


def test_qmc5883l_soft_reset_goes_to_standby_and_forgets():
    bench = Bench(Qmc5883l)
    bench.wr(0x09, 0x1D, 0x41, 0x01)
    bench.wait_ms(20)
    assert bench.rd(0x09, 3) == b"\x1d\x41\x01"
    bench.wr(0x0A, 0x80)
    assert bench.rd(0x09, 3) == bytes(3)
    assert bench.rd(0x00, 7) == bytes(7)
    bench.wait_ms(100)
    assert bench.byte(0x06) == 0


def test_qmc5883l_temperature_is_right_only_as_a_difference():
    def word(temp_degc):
        return int.from_bytes(Bench(Qmc5883l, temp_degc=temp_degc).rd(0x07, 2), "little", signed=True)

    assert word(35.0) - word(25.0) == 1000
    assert word(25.0) != 2500
