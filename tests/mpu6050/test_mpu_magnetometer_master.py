"""The magnetometer's data by the chip's own I2C master: the same samples as by the bypass, in bursts and in frames."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from magnetometer_rig import BOARDS, CHIPS, NAMES, NOISY, MagRig, new_samples

from hw_fakes import Turntable
from quavelet.core.errors import ChipUnstable, DeviceLost, DeviceMissing, SettingsError
from quavelet.mpu6050 import registers as r
from quavelet.mpu6050.magnetometer.fifo_frames import fifo_en, fifo_frame_bytes, split_frames
from quavelet.mpu6050.magnetometer.identify import find_magnetometer
from quavelet.mpu6050.magnetometer.kinds import KINDS
from quavelet.mpu6050.magnetometer.master import MasterReader, fetch_every

RATES = {"gy-87": 50.0, "gy-87-hmc5883l": 50.0, "mpu-9150": 50.0, "mpu-9250": 100.0}


def by_master(name, n, *, rate_hz=200.0, mag_hz=None):
    rig = MagRig(name, imperfections=NOISY, rate_hz=rate_hz)
    reader = rig.master(rate_hz=mag_hz or RATES[name])
    return new_samples(rig, reader, n, every_ms=2)


@pytest.mark.parametrize("name", BOARDS)
@pytest.mark.parametrize("rate_hz", [100.0, 200.0, 1000.0])
def test_master_gives_the_very_measurements_the_bypass_gives(name, rate_hz):
    """The noise of a measurement hangs on its number alone, so that none may be missing or come twice."""
    rig = MagRig(name, imperfections=NOISY)
    direct = new_samples(rig, rig.bypass(rate_hz=RATES[name]), 45, every_ms=2).tolist()
    fetched = by_master(name, 45, rate_hz=rate_hz).tolist()
    # One of the two may have begun a measurement or so earlier.
    both = [field for field in direct if field in fetched]
    assert len(both) >= 42
    assert direct[direct.index(both[0]) :][: len(both)] == both
    assert fetched[fetched.index(both[0]) :][: len(both)] == both


@pytest.mark.parametrize("name", BOARDS)
@settings(max_examples=10)
@given(divider=st.sampled_from([0, 1, 3, 4, 9, 19]), every_ms=st.floats(0.5, 30))
def test_field_by_the_master_is_the_worlds_at_any_rate_of_the_chip(name, divider, every_ms):
    rig = MagRig(name, rate_hz=1000 / (divider + 1))
    (field_ut,) = new_samples(rig, rig.master(), 1, every_ms=every_ms)
    assert np.abs(field_ut - rig.true_ut()).max() <= 0.2


@pytest.mark.parametrize("name", BOARDS)
def test_sensors_and_magnetometer_come_in_one_burst(name):
    rig = MagRig(name)
    reader = rig.master()
    rig.wait_ms(60)
    before = rig.bus.transactions
    counts, sample = reader.read_with_sensors()
    assert rig.bus.transactions - before == 2  # the master's status, and the burst
    assert np.abs(np.array(sample.field_ut) - rig.true_ut()).max() <= 0.2
    seen = np.frombuffer(bytes(rig.chip.registers[0x3B:0x49]), dtype=">i2")
    assert np.array_equal(counts, seen)
    assert np.linalg.norm(counts[:3].astype(float)) == pytest.approx(16384, rel=0.02)


@pytest.mark.parametrize("name", BOARDS)
def test_look_twice_at_one_fetching_is_one_measurement(name):
    rig = MagRig(name, imperfections=NOISY)
    reader = rig.master()
    new_samples(rig, reader, 3, every_ms=2)
    again = reader.read()
    assert not again.new
    assert again.t_ns < rig.clock.now_ns()


@pytest.mark.parametrize("name", ["mpu-9150", "gy-87-hmc5883l"])
@pytest.mark.parametrize(("rate_hz", "mag_hz"), [(1000.0, 100.0), (1000.0, 40.0), (500.0, 100.0), (50.0, 50.0)])
def test_triggered_measurements_come_at_the_rate_asked_for(name, rate_hz, mag_hz):
    rig = MagRig(name, imperfections=NOISY, rate_hz=rate_hz)
    rig.master(rate_hz=mag_hz)
    rig.wait_ms(100)
    rig.access.read(r.WHO_AM_I)
    made = rig.magnetometer.measurements
    for _ in range(100):
        rig.wait_ms(10)
        rig.access.read(r.WHO_AM_I)
    assert rig.magnetometer.measurements - made == pytest.approx(mag_hz, rel=0.02, abs=2)


@settings(max_examples=200)
@given(
    name=st.sampled_from(BOARDS),
    rate_hz=st.sampled_from([4.0, 50.0, 200.0, 333.3333, 1000.0]),
    mag_hz=st.floats(1.0, 100.0),
)
def test_a_triggered_measurement_always_has_the_time_it_takes(name, rate_hz, mag_hz):
    rig = _RIGS[name]
    kind = KINDS[NAMES[name]]
    config = rig.config(rate_hz=mag_hz if kind.any_rate else kind.rates_hz[-1])
    plan = kind.make_plan(config, (128, 128, 128))
    try:
        every = fetch_every(plan, sample_period_s=1 / rate_hz)
    except SettingsError as error:
        assert kind.any_rate and mag_hz * 32 < rate_hz
        assert "take" in str(error)
        return
    assert 1 <= every <= 32
    if kind.any_rate:
        assert every / rate_hz * 1e9 >= plan.measuring_ns
        assert every / rate_hz >= 1 / mag_hz * (1 - 1e-6)
    else:
        assert every == 1 or every / rate_hz <= 0.5 / plan.rate_hz


_RIGS = {name: MagRig(name) for name in BOARDS}


@pytest.mark.parametrize("name", BOARDS)
def test_magnetometer_unplugged_is_told_of_at_the_next_look_and_set_up_anew_by_one_call(name):
    rig = MagRig(name)
    reader = rig.master()
    new_samples(rig, reader, 1, every_ms=3)
    targets, outer = dict(rig.aux.targets), dict(rig.bus.targets)
    rig.unplug()
    rig.wait_ms(30)
    with pytest.raises(DeviceMissing) as raised:
        reader.read()
    assert raised.value.address == CHIPS[name].address
    rig.aux.targets.update(targets)
    rig.bus.targets.update(outer)
    rig.magnetometer.power_cut()
    reader.set_up()
    (field_ut,) = new_samples(rig, reader, 1, every_ms=3)
    assert np.abs(field_ut - rig.true_ut()).max() <= 0.2


@pytest.mark.parametrize("name", BOARDS)
def test_reset_of_the_chip_is_not_taken_for_a_field_of_zero_and_one_call_brings_all_back(name):
    rig = MagRig(name, imperfections=NOISY)
    reader = rig.master()
    new_samples(rig, reader, 3, every_ms=3)
    rig.access.write(r.PWR_MGMT_1, 0x80)
    rig.wait_ms(100)
    rig.wake()
    with pytest.raises(DeviceLost, match=NAMES[name]):
        for _ in range(600):
            rig.wait_ms(10)
            assert not reader.read().new
    reader.set_up()
    field_ut = new_samples(rig, reader, 20, every_ms=3).mean(axis=0)
    assert np.abs(field_ut - rig.true_ut()).max() <= 2.5


@pytest.mark.parametrize("name", ["gy-87", "gy-87-hmc5883l", "mpu-9250"])
def test_magnetometer_whose_supply_failed_is_told_of(name):
    rig = MagRig(name, imperfections=NOISY)
    reader = rig.master()
    new_samples(rig, reader, 3, every_ms=3)
    rig.magnetometer.power_cut()
    with pytest.raises((DeviceLost, ChipUnstable), match=NAMES[name]):
        for _ in range(600):
            rig.wait_ms(10)
            reader.read()


@pytest.mark.parametrize("name", BOARDS)
def test_stuck_data_are_told_of_and_a_saturated_magnetometer_is_not_called_lost(name):
    rig = MagRig(name, imperfections=NOISY)
    reader = rig.master()
    new_samples(rig, reader, 3, every_ms=3)
    rig.magnetometer._counts = rig.magnetometer._raw = lambda _measurement: (100, -200, 300)
    with pytest.raises(DeviceLost, match=NAMES[name]):
        new_samples(rig, reader, 2000, every_ms=50)

    rig = MagRig(name, strength_ut=20_000.0)
    reader = rig.master()
    seen = []
    for _ in range(1500):
        rig.wait_ms(10)
        seen.append(reader.read())
    assert all(sample.overflow for sample in seen[10:])


def test_sleeping_chip_is_not_given_a_master_that_would_rest():
    rig = MagRig("gy-87")
    found, config = rig.found(), rig.config()
    reader = MasterReader(rig.access, found, config, clock=rig.clock, health=rig.health)
    rig.access.write(r.PWR_MGMT_1, 0x41)
    with pytest.raises(ChipUnstable, match="sleeps"):
        reader.set_up()


def test_magnetometer_on_the_outer_bus_is_not_looked_for_by_the_master():
    rig = MagRig("gy-87")
    rig.bus.targets[0x0D] = rig.magnetometer
    with pytest.raises(SettingsError, match="outer bus"):
        rig.master()


def test_master_that_does_not_take_its_registers_is_told_of():
    rig = MagRig("gy-87")
    found, config = rig.found(), rig.config()
    store = rig.chip._store
    rig.chip._store = lambda register, value: None if register == 0x26 else store(register, value)
    reader = MasterReader(rig.access, found, config, clock=rig.clock, health=rig.health)
    with pytest.raises(ChipUnstable, match="I2C_SLV0_REG"):
        reader.set_up()


@pytest.mark.parametrize("name", BOARDS)
def test_looking_behind_the_chip_lets_the_master_go_on(name):
    rig = MagRig(name, imperfections=NOISY)
    reader = rig.master()
    new_samples(rig, reader, 3, every_ms=3)
    find_magnetometer(rig.access)
    assert len(new_samples(rig, reader, 10, every_ms=3)) == 10


def start_fifo(rig, plan):
    """As the driver starts its FIFO, with the master left on."""
    rig.access.write(r.FIFO_EN, 0)
    rig.access.write(r.USER_CTRL, 0x20)
    rig.access.write(r.USER_CTRL, 0x24)
    rig.access.write(r.USER_CTRL, 0x60)
    rig.access.write(r.FIFO_EN, fifo_en(plan))


@pytest.mark.parametrize("name", BOARDS)
@pytest.mark.parametrize("rate_hz", [100.0, 500.0])
def test_frames_of_the_fifo_hold_the_sensors_and_every_measurement(name, rate_hz):
    motion = Turntable(start_s=0.0, ramp_s=0.2, rate_deg_s=90.0, turn_deg=1e6)
    rig = MagRig(name, motion=motion, imperfections=NOISY, rate_hz=rate_hz)
    reader = rig.master(rate_hz=RATES[name])
    plan = reader.plan
    start_fifo(rig, plan)
    frame = fifo_frame_bytes(plan)
    sampler, samples, words = reader.sampler(), [], []
    made, begun_ns = rig.magnetometer.measurements, rig.clock.now_ns()
    for _ in range(50):
        rig.wait_ms(20)
        now_ns = rig.clock.now_ns()
        count = rig.access.fifo_count()
        assert count % frame == 0
        if count:
            counts, external = split_frames(rig.access.read_fifo(count), external_bytes=plan.block_bytes)
            words.append(counts)
            samples += [sampler.take_copied(block.tobytes(), rig.clock.now_ns()) for block in external]
    counts = np.concatenate(words)
    assert len(counts) == len(samples) == pytest.approx((now_ns - begun_ns) / 1e9 * rate_hz, abs=3)
    assert np.median(counts[:, 2]) == pytest.approx(16384, rel=0.01)
    assert np.median(counts[len(counts) // 2 :, 6]) == pytest.approx(90 * 131, rel=0.02)
    new = [sample for sample in samples if sample.new]
    assert len(new) == pytest.approx(rig.magnetometer.measurements - made, abs=2)
    strength = np.linalg.norm([sample.field_ut for sample in new], axis=1)
    assert np.median(strength) == pytest.approx(49, abs=2)


@given(
    words=st.lists(st.tuples(*[st.integers(-32768, 32767)] * 7), max_size=20),
    external=st.integers(0, 24),
    data=st.data(),
)
def test_frames_are_split_as_they_were_joined(words, external, data):
    blocks = [data.draw(st.binary(min_size=external, max_size=external)) for _ in words]
    joined = b"".join(
        b"".join(word.to_bytes(2, "big", signed=True) for word in row) + block
        for row, block in zip(words, blocks, strict=True)
    )
    counts, rest = split_frames(joined, external_bytes=external)
    assert counts.tolist() == [list(row) for row in words]
    assert rest.shape == (len(words), external)
    assert [row.tobytes() for row in rest] == blocks


@pytest.mark.parametrize("external", [-1, 6])
def test_bytes_that_are_no_whole_frames_are_refused(external):
    with pytest.raises(ValueError, match=r"give|whole"):
        split_frames(bytes(14), external_bytes=external)


def test_without_a_magnetometer_a_frame_is_the_sensors():
    assert fifo_frame_bytes(None) == 14


@pytest.mark.parametrize("name", BOARDS)
def test_slaves_that_another_program_left_on_do_not_come_into_the_data(name):
    rig = MagRig(name)
    found, config = rig.found(), rig.config()
    for n in range(4):
        rig.bus.write(0x68, bytes([0x25 + 3 * n, 0x80 | 0x55, 0x00, 0x85]))
    rig.bus.write(0x68, b"\x6a\x20")
    rig.wait_ms(50)
    reader = MasterReader(rig.access, found, config, clock=rig.clock, health=rig.health)
    reader.set_up()
    rig.wait_ms(100)
    field_ut = reader.read().field_ut
    assert np.abs(field_ut - rig.true_ut()).max() <= 0.2
    assert not rig.chip.registers[0x37] & 0x02
