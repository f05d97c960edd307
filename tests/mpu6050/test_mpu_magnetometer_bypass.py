"""The field by the bypass: its unit and axes against the world's, new and stale, saturation, and what fails."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from magnetometer_rig import ADDRESS, BOARDS, CHIPS, NAMES, NOISY, MagRig, new_samples

from hw_fakes import EarthField, Still, Turntable
from quavelet.core.errors import BusError, ChipUnstable, DeviceLost, DeviceMissing, SettingsError
from quavelet.mpu6050.config import ChipConfig
from quavelet.mpu6050.magnetometer.bypass import BypassReader
from quavelet.mpu6050.magnetometer.kinds import KINDS
from quavelet.mpu6050.magnetometer.plan import MagnetometerConfig
from quavelet.mpu6050.source import ChipSource

# uT a count, of the data sheets; for AKM before the factory's adjustment, which makes it at most 1.5 times that.
LSB_UT = {
    "gy-87": {200.0: 1 / 120, 800.0: 1 / 30},
    "gy-87-hmc5883l": dict(
        zip(
            (88.0, 130.0, 190.0, 250.0, 400.0, 470.0, 560.0, 810.0),
            (0.073, 0.092, 0.122, 0.152, 0.227, 0.256, 0.303, 0.435),  # DS 13, table 9
            strict=True,
        )
    ),
    "mpu-9150": {1229.0: 0.3 * 1.2},
    "mpu-9250": {4912.0: 0.15 * 1.2},
}
EVERY = [(name, range_ut) for name, ranges in LSB_UT.items() for range_ut in ranges]


def test_every_range_of_every_kind_is_looked_at():
    assert {NAMES[name]: tuple(ranges) for name, ranges in LSB_UT.items()} == {
        kind.name: kind.ranges_ut for kind in KINDS.values()
    }


@pytest.mark.parametrize(("name", "range_ut"), EVERY)
@settings(max_examples=10)
@given(roll=st.floats(-180, 180), pitch=st.floats(-89, 89), yaw=st.floats(-180, 180))
def test_field_is_the_worlds_in_the_chips_axes_within_half_a_count(name, range_ut, roll, pitch, yaw):
    rig = MagRig(name, motion=Still(roll_deg=roll, pitch_deg=pitch, yaw_deg=yaw))
    (field_ut,) = new_samples(rig, rig.bypass(range_ut=range_ut), 1, every_ms=5)
    assert np.abs(field_ut - rig.true_ut()).max() <= LSB_UT[name][range_ut] * 0.51


@pytest.mark.parametrize("name", ["mpu-9150", "mpu-9250"])
@settings(max_examples=10)
@given(adjustment=st.tuples(*[st.integers(1, 254)] * 3))
def test_factory_adjustment_of_any_part_is_taken_off(name, adjustment):
    rig = MagRig(name)
    rig.magnetometer.sensitivity = adjustment
    (field_ut,) = new_samples(rig, rig.bypass(), 1, every_ms=5)
    assert np.abs(field_ut - rig.true_ut()).max() <= 0.3 * 1.5 / 2


@pytest.mark.parametrize("asa", [0x00, 0xFF])
def test_adjustment_that_cannot_be_read_is_not_believed(asa):
    rig = MagRig("mpu-9250")
    rig.magnetometer.sensitivity = (asa, asa, asa)
    with pytest.raises(ChipUnstable, match="0x0c"):
        rig.bypass()


def test_configured_mounting_turns_the_field_into_the_chips_axes():
    rig = MagRig("gy-87")
    turned = ((0.0, -1.0, 0.0), (1.0, 0.0, 0.0), (0.0, 0.0, 1.0))
    (field_ut,) = new_samples(rig, rig.bypass(to_body=turned), 1, every_ms=5)
    x, y, z = rig.true_ut()
    assert np.allclose(field_ut, [-y, x, z], atol=0.1)


@pytest.mark.parametrize(
    "matrix",
    [
        ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, -1.0)),
        ((2.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 0.5)),
        ((math.nan, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)),
    ],
)
def test_mounting_that_is_no_rotation_is_refused(matrix):
    with pytest.raises(SettingsError, match="rotation"):
        MagnetometerConfig(rate_hz=50.0, range_ut=200.0, to_body=matrix)


@pytest.mark.parametrize("name", BOARDS)
@pytest.mark.parametrize("changed", [{"rate_hz": 1234.5}, {"rate_hz": math.nan}, {"range_ut": 1.0}])
def test_rate_or_range_it_does_not_have_is_refused_with_what_it_has(name, changed):
    with pytest.raises(SettingsError, match=NAMES[name]):
        MagRig(name).bypass(**changed)


RATES = [("gy-87", rate) for rate in (10.0, 50.0, 100.0, 200.0)] + [("mpu-9250", 8.0), ("mpu-9250", 100.0)]


@pytest.mark.parametrize(
    ("name", "rate_hz"), [*RATES, ("gy-87-hmc5883l", 20.0), ("gy-87-hmc5883l", 100.0), ("mpu-9150", 20.0)]
)
def test_every_measurement_is_new_once_and_they_come_at_the_rate(name, rate_hz):
    rig = MagRig(name, imperfections=NOISY)
    reader = rig.bypass(rate_hz=rate_hz)
    made, begun_ns = rig.magnetometer.measurements, rig.clock.now_ns()
    fields = []
    step_ms = 1000 / rate_hz / 7.3
    for _ in range(round(20 * 7.3)):
        rig.wait_ms(step_ms)
        sample = reader.read()
        if sample.new:
            fields.append(sample.field_ut)
    assert len(set(fields)) == len(fields)
    assert rig.magnetometer.measurements - made == pytest.approx(len(fields), abs=1)
    expected = (rig.clock.now_ns() - begun_ns) / 1e9 * rate_hz
    # A triggered one waits for the next look before it is begun anew.
    assert expected * 0.75 <= len(fields) <= expected + 1


@pytest.mark.parametrize("name", BOARDS)
def test_before_the_first_measurement_there_is_no_field(name):
    rig = MagRig(name)
    sample = rig.bypass().read()
    assert not sample.new and all(math.isnan(axis) for axis in sample.field_ut)


@pytest.mark.parametrize("name", BOARDS)
def test_stale_look_repeats_the_last_measurement_and_its_time(name):
    rig = MagRig(name, imperfections=NOISY)
    reader = rig.bypass()
    new_samples(rig, reader, 2, every_ms=1)
    first, second = reader.read(), reader.read()
    assert not first.new and not second.new
    assert (first.field_ut, first.t_ns) == (second.field_ut, second.t_ns)
    assert first.t_ns < rig.clock.now_ns()


@pytest.mark.parametrize("name", BOARDS)
def test_time_of_a_sample_fits_a_field_that_turns(name):
    rig = MagRig(name, motion=Turntable(start_s=0.0, ramp_s=0.2, rate_deg_s=1440.0, turn_deg=1e6))
    reader = rig.bypass()
    new_samples(rig, reader, 30, every_ms=1)
    worst_ms = 0.0
    for _ in range(300):
        rig.wait_ms(1)
        sample = reader.read()
        if sample.new:
            aside = min(
                range(-15, 4),
                key=lambda ms: np.abs(rig.true_ut(sample.t_ns + ms * 1_000_000) - sample.field_ut).sum(),
            )
            worst_ms = max(worst_ms, abs(aside))
    assert worst_ms <= 4


def test_single_measurement_made_long_ago_is_not_called_fresh():
    rig = MagRig("mpu-9150")
    reader = rig.bypass()
    begun_ns = rig.clock.now_ns()
    rig.wait_ms(5000)
    sample = reader.read()
    assert sample.new and sample.t_ns - begun_ns < 20_000_000


# Every chip reaches further than its range is called, by up to 1.9 times.
@pytest.mark.parametrize(("name", "range_ut"), EVERY)
@pytest.mark.parametrize(("part", "overflow"), [(0.4, False), (2.0, True)])
def test_saturated_axis_is_flagged_and_one_in_range_is_not(name, range_ut, part, overflow):
    axis = np.abs(MagRig(name, strength_ut=1.0).true_ut()).max()
    rig = MagRig(name, strength_ut=range_ut * part / axis)
    reader = rig.bypass(range_ut=range_ut)
    looks = []
    for _ in range(20):
        rig.wait_ms(7)
        looks.append(reader.read())
    assert {look.overflow for look in looks if look.new} == {overflow}


def test_one_axis_of_an_ak8975_at_its_end_is_flagged_though_the_sum_is_not_too_large():
    motion = Still(pitch_deg=0.0, earth_field=EarthField(strength_ut=1500.0, inclination_deg=90.0))
    rig = MagRig("mpu-9150", motion=motion)
    reader = rig.bypass()
    rig.wait_ms(20)
    assert reader.read().overflow


@pytest.mark.parametrize("name", BOARDS)
def test_saturated_magnetometer_is_not_called_lost(name):
    rig = MagRig(name, strength_ut=20_000.0)
    reader = rig.bypass()
    for _ in range(1500):
        rig.wait_ms(10)
        sample = reader.read()
    assert sample.overflow


@pytest.mark.parametrize("name", BOARDS)
def test_stuck_words_are_told_of_as_a_lost_device(name):
    rig = MagRig(name, imperfections=NOISY)
    reader = rig.bypass()
    new_samples(rig, reader, 5, every_ms=5)
    rig.magnetometer._counts = rig.magnetometer._raw = lambda _measurement: (100, -200, 300)
    with pytest.raises(DeviceLost, match=NAMES[name]):
        new_samples(rig, reader, 2000, every_ms=10)


@pytest.mark.parametrize("name", ["gy-87", "gy-87-hmc5883l", "mpu-9250"])
def test_magnetometer_whose_supply_failed_is_told_of_and_set_up_anew_by_one_call(name):
    rig = MagRig(name, imperfections=NOISY)
    reader = rig.bypass()
    new_samples(rig, reader, 5, every_ms=5)
    rig.magnetometer.power_cut()
    with pytest.raises((DeviceLost, ChipUnstable), match=NAMES[name]):
        for _ in range(400):
            rig.wait_ms(10)
            sample = reader.read()
            assert not sample.new or np.abs(np.array(sample.field_ut) - rig.true_ut()).max() < 12
    reader.set_up()
    field_ut = new_samples(rig, reader, 20, every_ms=5).mean(axis=0)
    assert np.allclose(field_ut, rig.true_ut(), atol=2.5)


def test_ak8975_whose_supply_failed_has_nothing_to_forget_and_goes_on():
    rig = MagRig("mpu-9150")
    reader = rig.bypass()
    new_samples(rig, reader, 5, every_ms=5)
    rig.magnetometer.power_cut()
    assert np.allclose(new_samples(rig, reader, 20, every_ms=5), rig.true_ut(), atol=0.3)


@pytest.mark.parametrize("name", BOARDS)
def test_reset_of_the_chip_closes_the_bypass_and_one_call_brings_all_back(name):
    rig = MagRig(name)
    reader = rig.bypass()
    rig.bus.write(0x68, b"\x6b\x80")
    rig.wait_ms(100)
    rig.wake()
    with pytest.raises(DeviceMissing) as raised:
        reader.read()
    assert raised.value.address == CHIPS[name].address
    reader.set_up()
    (field_ut,) = new_samples(rig, reader, 1, every_ms=5)
    assert np.allclose(field_ut, rig.true_ut(), atol=0.5)


def test_unplugged_magnetometer_is_missing():
    rig = MagRig("gy-87")
    reader = rig.bypass()
    rig.unplug()
    with pytest.raises(BusError):
        reader.read()
    assert rig.health.bus_errors


def test_magnetometer_on_the_outer_bus_is_read_without_the_bypass():
    rig = MagRig("gy-87")
    rig.bus.targets[0x0D] = rig.magnetometer
    (field_ut,) = new_samples(rig, rig.bypass(), 1, every_ms=5)
    assert np.allclose(field_ut, rig.true_ut(), atol=0.1)
    assert not rig.chip.registers[0x37] & 0x02


def test_reading_before_setting_up_is_refused():
    rig = MagRig("gy-87")
    reader = rig.bypass()
    reader._plan = None
    with pytest.raises(ValueError, match="set_up"):
        reader.read()


@pytest.mark.parametrize("name", BOARDS)
def test_magnetometer_is_read_beside_a_running_stream_and_after_its_chip_was_reset(name):
    rig = MagRig(name, imperfections=NOISY)
    chip_config = ChipConfig(gyro_range_dps=500, accel_range_g=4, dlpf=3, sample_rate_hz=200.0)
    source = ChipSource(rig.bus, address=ADDRESS, config=chip_config, clock=rig.clock, health=rig.health)
    source.wait_until_streaming()
    reader = rig.bypass()
    samples, new, missing, lost = 0, 0, 0, False
    begun_ns = rig.clock.now_ns()
    for turn in range(200):
        if turn == 100:
            rig.bus.write(ADDRESS, b"\x6b\x80")
        rig.wait_ms(10)
        samples += len(source.read())
        try:
            if lost:
                reader.set_up()
            lost = False
            new += reader.read().new
        except (DeviceMissing, ChipUnstable):
            lost = True
            missing += 1
    seconds = (rig.clock.now_ns() - begun_ns) / 1e9
    assert rig.health.chip_restarts == 1
    assert 1 <= missing < 60
    assert samples + rig.health.samples_lost == pytest.approx(200 * seconds, rel=0.02)
    assert rig.health.samples_lost < 200 * 0.5
    assert new > 30
    assert np.allclose(new_samples(rig, reader, 20, every_ms=5).mean(axis=0), rig.true_ut(), atol=2.5)
    assert not rig.health.fifo_misaligned


@pytest.mark.parametrize("name", ["mpu-9150", "mpu-9250"])
@pytest.mark.parametrize("control", [0x00, 0x01, 0x06, 0x0F])
def test_akm_is_given_its_time_in_power_down_whatever_it_did_before(name, control):
    rig = MagRig(name)
    found, config = rig.found(), rig.config()
    rig.magnetometer.write(bytes([0x0A, control]))
    rig.magnetometer.stop()
    BypassReader(rig.access, found, config, clock=rig.clock, health=rig.health).set_up()
    assert not rig.magnetometer.hasty_changes


@pytest.mark.parametrize(("name", "part"), [("mpu-9150", 0.94), ("mpu-9250", 0.6)])
def test_sum_of_the_axes_beyond_what_akm_can_measure_is_flagged_though_each_is_in_range(name, part):
    axis = np.abs(MagRig(name, strength_ut=1.0).true_ut()).max()
    (range_ut,) = LSB_UT[name]
    rig = MagRig(name, strength_ut=range_ut * part / axis)
    reader = rig.bypass()
    rig.wait_ms(20)
    assert reader.read().overflow


def test_ak8963_that_fell_back_to_14_bits_is_not_read_at_a_quarter_of_the_field():
    rig = MagRig("mpu-9250")
    reader = rig.bypass()
    new_samples(rig, reader, 2, every_ms=5)
    for control in (0x00, 0x06):
        rig.magnetometer.write(bytes([0x0A, control]))
        rig.magnetometer.stop()
        rig.wait_ms(1)
    with pytest.raises(ChipUnstable, match="settings"):
        new_samples(rig, reader, 3, every_ms=5)
