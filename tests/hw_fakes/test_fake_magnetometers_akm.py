"""The AK8963 of the MPU-9250 and the AK8975 of the MPU-9150, each through its messages."""

from __future__ import annotations

import numpy as np
import pytest
from magnetometer_bench import Bench, body_field_ut

from hw_fakes.magnetometers.akm import Ak8963, Ak8975
from hw_fakes.magnetometers.base import MagnetometerImperfections
from hw_fakes.target import Nack
from hw_fakes.world.motion import Turntable


def in_package(field):
    """Page of axes of the MPU-9150 and MPU-9250: the magnetometer's x is the board's y, its y the x, its z down."""
    x, y, z = field
    return np.array([y, x, -z])


@pytest.mark.parametrize("mode", [0x02, 0x06])
@pytest.mark.parametrize(("bit", "ut_per_lsb"), [(0x00, 0.6), (0x10, 0.15)])
def test_ak8963_words_once_adjusted_are_the_field_in_its_own_axes(mode, bit, ut_per_lsb):
    bench = Bench(Ak8963)
    bench.wr(0x0A, 0x0F)
    asa = np.array(list(bench.rd(0x10, 3)))
    bench.wr(0x0A, 0x00)
    bench.wait_ms(1)
    bench.wr(0x0A, mode | bit)
    bench.wait_ms(10)
    adjusted = bench.words(0x03, "<i2") * ((asa - 128) * 0.5 / 128 + 1)
    assert np.all(np.abs(adjusted * ut_per_lsb - in_package(body_field_ut())) <= 0.7 * ut_per_lsb)
    assert bench.byte(0x09) == bit


def test_ak8975_words_once_adjusted_are_the_field_in_its_own_axes():
    bench = Bench(Ak8975, sensitivity=(140, 128, 200))
    bench.wr(0x0A, 0x01)
    bench.wait_ms(10)
    adjusted = bench.words(0x03, "<i2") * ((np.array([140, 128, 200]) - 128) * 0.5 / 128 + 1)
    assert np.all(np.abs(adjusted * 0.3 - in_package(body_field_ut())) <= 0.25)


@pytest.mark.parametrize("chip", [Ak8963, Ak8975])
def test_adjustment_cannot_be_read_outside_fuse_rom_mode(chip):
    bench = Bench(chip, sensitivity=(176, 177, 165))
    assert bench.rd(0x10, 3) != bytes([176, 177, 165])
    bench.wr(0x0A, 0x0F)
    assert bench.rd(0x10, 4) == bytes([176, 177, 165, 176])
    assert bench.byte(0x00) == 0x48


@pytest.mark.parametrize("chip", [Ak8963, Ak8975])
def test_single_measurement_ends_in_power_down(chip):
    bench = Bench(chip)
    bench.wr(0x0A, 0x01)
    bench.wait_ms(7)
    assert bench.byte(0x02) == 0
    assert bench.byte(0x0A) == 0x01
    bench.wait_ms(0.5)
    assert bench.byte(0x02) == 1
    assert bench.byte(0x0A) == 0x00
    bench.wait_ms(1000)
    bench.byte(0x02)
    assert bench.chip.measurements == 1


@pytest.mark.parametrize("chip", [Ak8963, Ak8975])
@pytest.mark.parametrize("register", [0x03, 0x08, 0x09])
def test_data_ready_is_cleared_by_data_or_status_2(chip, register):
    bench = Bench(chip)
    bench.wr(0x0A, 0x01)
    bench.wait_ms(8)
    assert bench.byte(0x02) == 1
    assert bench.byte(0x02) == 1
    bench.byte(register)
    assert bench.byte(0x02) == 0


@pytest.mark.parametrize(("mode", "rate_hz"), [(0x02, 8), (0x06, 100)])
def test_ak8963_measures_at_8_or_100_hz(mode, rate_hz):
    bench = Bench(Ak8963)
    bench.wr(0x0A, mode)
    bench.wait_ms(10_000)
    bench.byte(0x02)
    assert bench.chip.measurements == 10 * rate_hz


@pytest.mark.parametrize("mode", [0x02, 0x06])
def test_ak8975_has_no_continuous_mode(mode):
    bench = Bench(Ak8975)
    bench.wr(0x0A, mode)
    bench.wait_ms(1000)
    assert bench.byte(0x02) == 0
    assert bench.chip.measurements == 0


def test_ak8963_data_freeze_where_status_2_is_never_read():
    bench = Bench(Ak8963, motion=Turntable(start_s=0))
    bench.wr(0x0A, 0x16)
    bench.wait_ms(1008)
    frozen = bench.rd(0x03, 6)
    for _ in range(20):
        bench.wait_ms(100)
        assert bench.byte(0x02) & 1 == 0
        assert bench.rd(0x03, 6) == frozen
    bench.byte(0x09)
    bench.wait_ms(11)
    assert bench.byte(0x02) & 1
    assert bench.rd(0x03, 7)[:6] != frozen


def test_ak8963_data_are_released_by_setting_a_mode():
    bench = Bench(Ak8963)
    bench.wr(0x0A, 0x06)
    bench.wait_ms(8)
    bench.rd(0x03, 6)
    bench.wr(0x0A, 0x00)
    bench.wait_ms(1)
    bench.wr(0x0A, 0x06)
    bench.wait_ms(8)
    assert bench.byte(0x02) == 1


def test_ak8963_tells_of_skipped_data_and_of_data_lost_while_frozen():
    bench = Bench(Ak8963)
    bench.wr(0x0A, 0x06)
    bench.wait_ms(8)
    assert bench.byte(0x02) == 1
    bench.wait_ms(10)
    assert bench.byte(0x02) == 3
    bench.rd(0x03, 6)
    assert bench.byte(0x02) == 0
    bench.wait_ms(10)
    assert bench.byte(0x02) == 2
    bench.byte(0x09)
    assert bench.byte(0x02) == 0


@pytest.mark.parametrize(("chip", "limit_ut", "word"), [(Ak8963, 4912, 8190), (Ak8975, 2400, 4095)])
def test_overflow_is_the_sum_of_the_axes_not_a_clipped_word(chip, limit_ut, word):
    def read(field_ut):
        iron = MagnetometerImperfections(hard_iron_ut=field_ut, soft_iron=((0.0,) * 3,) * 3)
        bench = Bench(chip, imperfections=iron, sensitivity=(128, 128, 128))
        bench.wr(0x0A, 0x01)
        bench.wait_ms(8)
        return bench.words(0x03, "<i2"), bench.byte(0x09) & 0x08

    third = limit_ut / 3
    words, over = read((third - 1, -third, third))
    assert not over
    words, over = read((third + 1, -third, third))
    assert over
    assert np.max(np.abs(words)) < word
    words, over = read((1e4, 0.0, 0.0))
    assert over
    assert words[0] == word


def test_ak8963_range_at_16_bits_is_32760():
    bench = Bench(Ak8963, imperfections=MagnetometerImperfections(hard_iron_ut=(1e4, -1e4, 0.0)))
    bench.wr(0x0A, 0x11)
    bench.wait_ms(8)
    assert list(bench.words(0x03, "<i2")[:2]) == [32760, -32760]


def test_ak8975_is_not_ready_while_a_measurement_is_under_way():
    bench = Bench(Ak8975)
    bench.wr(0x0A, 0x01)
    bench.wait_ms(8)
    assert bench.byte(0x02) == 1
    bench.wr(0x0A, 0x01)
    assert bench.byte(0x02) == 0
    bench.wait_ms(8)
    assert bench.byte(0x02) == 1


def test_ak8975_flags_data_read_during_a_measurement():
    bench = Bench(Ak8975)
    bench.wr(0x0A, 0x01)
    bench.wait_ms(3)
    bench.rd(0x03, 6)
    assert bench.byte(0x09) == 0x04
    assert bench.byte(0x09) == 0
    bench.wait_ms(5)
    bench.rd(0x03, 6)
    assert bench.byte(0x09) == 0


@pytest.mark.parametrize(
    ("chip", "control", "limits"),
    [
        (Ak8963, 0x08, [(-50, 50), (-50, 50), (-800, -200)]),
        (Ak8963, 0x18, [(-200, 200), (-200, 200), (-3200, -800)]),
        (Ak8975, 0x08, [(-100, 100), (-100, 100), (-1000, -300)]),
    ],
)
def test_self_test_is_within_the_data_sheets_limits(chip, control, limits):
    bench = Bench(chip, sensitivity=(128, 128, 128), strength_ut=200.0)
    bench.wr(0x0C, 0x40)
    bench.wr(0x0A, control)
    bench.wait_ms(10)
    assert bench.byte(0x02) & 1
    assert all(low <= word <= high for word, (low, high) in zip(bench.words(0x03, "<i2"), limits, strict=True))
    assert bench.byte(0x0A) & 0x0F == 0


def test_ak8963_soft_reset_stops_it():
    bench = Bench(Ak8963)
    bench.wr(0x0A, 0x16)
    bench.wait_ms(100)
    bench.wr(0x0B, 0x01)
    assert bench.rd(0x0A, 2) == bytes(2)
    assert bench.rd(0x02, 8) == bytes(8)
    bench.wait_ms(100)
    assert bench.byte(0x02) == 0


def test_hasty_change_of_mode_is_counted():
    bench = Bench(Ak8963)
    bench.wr(0x0A, 0x0F)
    bench.wr(0x0A, 0x00)
    bench.wait_ms(0.2)
    bench.wr(0x0A, 0x16)
    assert bench.chip.hasty_changes == 0
    bench.wr(0x0A, 0x12)
    assert bench.chip.hasty_changes == 1
    bench.wr(0x0A, 0x00)
    bench.wr(0x0A, 0x16)
    assert bench.chip.hasty_changes == 2


def test_ak8963_burst_goes_round_below_the_test_registers():
    bench = Bench(Ak8963)
    assert bench.rd(0x09, 5)[4] == 0x48
    assert bench.byte(0x00) == 0x48


def test_i2c_switched_off_is_silence_until_power_up():
    bench = Bench(Ak8963)
    bench.wr(0x0F, 0x1B)
    with pytest.raises(Nack):
        bench.rd(0x00)
    bench.chip.stop()
    bench.chip.power_cut()
    assert bench.byte(0x00) == 0x48
