"""The magnetometer in the FIFO's frames: its measurements come with the samples, and its troubles cost none of them."""

from __future__ import annotations

import logging
from dataclasses import replace

import numpy as np
import pytest
from chip_rig import check_honest
from magnetometer_rig import BOARDS, NAMES, lying
from magnetometer_stream_rig import MagStreamRig

from hw_fakes import Turntable
from hw_fakes.faults.plan import parse
from hw_fakes.magnetometers.base import PERFECT_MAGNETOMETER, MagnetometerImperfections
from quavelet.core.blocks import Flag
from quavelet.core.errors import SettingsError
from quavelet.core.health import Health
from quavelet.core.units import NS_PER_MS
from quavelet.mpu6050.decoder import Decoder
from quavelet.mpu6050.magnetometer.asked import LONGEST_BYTES, MagnetometerParams

RATES = {"gy-87": 50.0, "gy-87-hmc5883l": 100.0, "mpu-9150": 100.0, "mpu-9250": 100.0}
COUNT_UT = {"gy-87": 1 / 30, "gy-87-hmc5883l": 100 / 660, "mpu-9150": 0.36, "mpu-9250": 0.18}
"""No more than a count is worth, at the range that is taken by itself."""
FRAMES = {"gy-87": 21, "gy-87-hmc5883l": 24, "mpu-9150": 22, "mpu-9250": 22}
SLOW_TURN = Turntable(start_s=0.0, ramp_s=0.2, rate_deg_s=10.0, turn_deg=1e4)


@pytest.fixture(autouse=True)
def quiet(caplog):
    caplog.set_level(logging.CRITICAL)


@pytest.mark.parametrize("name", BOARDS)
def test_samples_are_lost_or_the_field_is_another(name):
    rig = MagStreamRig(name, motion=SLOW_TURN, imperfections=PERFECT_MAGNETOMETER).start()
    rig.run(4.0)
    assert (np.diff(check_honest(rig)) == 1).all()
    assert len(rig.got) == pytest.approx(800, abs=8)
    info = rig.infos[0]
    assert info.magnetometer is not None
    assert (info.magnetometer.kind, info.frame_bytes) == (NAMES[name], FRAMES[name])
    new = ~np.isnan(rig.got.field_ut[:, 0])
    # Without noise many a measurement has the words of the one before.
    assert RATES[name] * 4 * 0.1 < new.sum() <= RATES[name] * 4 * 1.02
    # 10 deg/s turn the 20 uT across the axis by 3.5 uT/s: by 0.07 uT in the 20 ms that a measurement is old at most.
    error = np.abs(rig.got.field_ut - rig.true_ut(rig.got.t_ns))[new]
    assert error.max() < COUNT_UT[name] + 0.1
    troubles = {name: n for name, n in rig.health.as_dict().items() if n}
    assert troubles.keys() <= {"samples", "drains", "fifo_empty"}


@pytest.mark.parametrize("name", BOARDS)
def test_frames_of_a_kilohertz_do_not_fit_the_bus(name):
    rig = MagStreamRig(name, rate_hz=1000.0).start()
    rig.run(1.0)
    assert (np.diff(check_honest(rig)) == 1).all()
    assert len(rig.fields()) == pytest.approx(RATES[name], rel=0.1)


def test_pulses_of_the_data_ready_line_and_the_magnetometer_do_not_go_together():
    """The master holds each pulse back until it has fetched (RM p. 17)."""
    rig = MagStreamRig("gy-87-hmc5883l", wired=True).start()
    rig.run(3.0)
    assert rig.infos[0].data_ready and rig.infos[0].magnetometer is not None
    numbers = check_honest(rig)
    assert (np.diff(numbers) == 1).all()
    late_ns = rig.got.t_ns - rig.samples.true_ns(numbers)
    assert np.abs(late_ns[-400:]).max() < NS_PER_MS
    assert len(rig.fields()) == pytest.approx(300, rel=0.1)
    assert rig.health.data_ready_missed == 0


def test_boards_without_a_magnetometer_pay_for_it_or_stop(caplog):
    caplog.set_level(logging.WARNING)
    rig = MagStreamRig("gy-521").start()
    rig.run(1.0)
    struck = len(rig.got)
    rig.fake_bus.adapter.faults.add(parse("brown-out"))
    rig.run(2.0)
    assert sum("no magnetometer is used" in record.message for record in caplog.records) == 1
    assert len(rig.got) > struck + 200
    assert rig.infos[0].magnetometer is None
    assert np.isnan(rig.got.field_ut).all()
    assert not rig.got.flags[-1] & (Flag.FIELD_LOST | Flag.FIELD_DISTURBED)


def test_magnetometer_is_touched_where_nobody_asked_for_it():
    rig = MagStreamRig("gy-87", params=MagnetometerParams()).start()
    rig.run(0.5)
    assert rig.infos[0].magnetometer is None
    assert rig.magnetometer.measurements == 0
    assert not rig.chip.registers[0x6A] & 0x20


def test_magnetometer_of_another_name_is_taken(caplog):
    caplog.set_level(logging.WARNING)
    rig = MagStreamRig("gy-87", params=MagnetometerParams(use="AK8963")).start()
    assert rig.infos[0].magnetometer is None
    assert "no AK8963 answers" in caplog.text


def test_rate_that_the_magnetometer_cannot_do_is_taken_for_another():
    rig = MagStreamRig("gy-87", params=MagnetometerParams(use="auto", rate_hz=75.0))
    with pytest.raises(SettingsError, match="75 is not a rate of the QMC5883L"):
        rig.start()


@pytest.mark.parametrize("slip", [1, 7, 14, 20, -3])
@pytest.mark.parametrize("name", ["gy-87", "gy-87-hmc5883l"])
def test_slipped_fifo_gives_a_torn_frame(name, slip):
    rig = MagStreamRig(name).start()
    rig.run(2.0)
    rig.fake_bus.adapter.faults.add(parse(f"slip bytes={slip}"))
    rig.run(1.0)
    check_honest(rig)
    assert rig.health.fifo_misaligned >= 1
    assert rig.health.gaps == 1
    assert rig.health.chip_restarts == 0
    assert np.abs(np.linalg.norm(rig.fields(), axis=1) - 49).max() < 12


@pytest.mark.parametrize("name", BOARDS)
@pytest.mark.parametrize(("frames_late", "counter"), [(1.5, "fifo_near_full"), (-20, "fifo_overflows")])
def test_fifo_that_fills_gives_torn_frames(name, frames_late, counter):
    rig = MagStreamRig(name).start()
    rig.run(1.0)
    info = rig.infos[0]
    fits = info.variant.fifo_bytes / info.frame_bytes
    rig.drain((fits - frames_late) / 0.2008)
    rig.run(0.5)
    check_honest(rig)
    assert getattr(rig.health, counter) == 1
    assert rig.health.gaps == 1


@pytest.mark.parametrize("name", BOARDS)
def test_chip_that_lost_its_setting_comes_back_without_the_magnetometer(name):
    rig = MagStreamRig(name).start()
    rig.run(2.0)
    before = len(rig.got)
    rig.magnetometer.power_cut()  # it hangs on the same supply
    rig.fake_bus.adapter.faults.add(parse("brown-out"))
    rig.run(3.0)
    check_honest(rig)
    assert rig.health.chip_restarts == rig.health.gaps == 1
    assert rig.health.magnetometer_restarts == 1
    assert len(rig.infos) == 1
    assert len(rig.fields(before)) > RATES[name] * 2
    assert np.abs(np.linalg.norm(rig.fields(before), axis=1) - 49).max() < 12


@pytest.mark.parametrize("name", BOARDS)
def test_magnetometer_without_its_setting_is_not_set_up_again(name):
    """Its supply alone failed: no sample is lost for it."""
    rig = MagStreamRig(name).start()
    rig.run(2.0)
    rig.magnetometer.power_cut()
    rig.run(5.0)
    assert (np.diff(check_honest(rig)) == 1).all()
    # An AK8975 has no setting but the one that the master writes for each measurement.
    lost = name != "mpu-9150"
    assert rig.health.magnetometer_lost == rig.health.magnetometer_restarts == lost
    assert len(rig.fields(len(rig.got) - 400)) == pytest.approx(2 * RATES[name], rel=0.1)
    assert np.abs(np.linalg.norm(rig.fields(), axis=1) - 49).max() < 12
    assert not (rig.got.flags[-400:] & Flag.FIELD_LOST).any()


@pytest.mark.parametrize("name", BOARDS)
def test_magnetometer_that_is_unplugged_stops_the_stream(name):
    rig = MagStreamRig(name).start()
    rig.run(2.0)
    back = rig.unplug()
    before = len(rig.got)
    rig.run(8.0)
    assert (np.diff(check_honest(rig)) == 1).all()
    lost = rig.got.flags[before:] & Flag.FIELD_LOST != 0
    first = int(np.argmax(lost))
    assert 180 < first < 260 and lost[first:].all()
    assert np.isnan(rig.got.field_ut[before + 4 :]).all()
    assert rig.health.magnetometer_lost == 1
    assert rig.health.magnetometer_restarts == 0
    # Tried again every two seconds, with a few bytes each.
    assert sum(transfer.register == 0x31 for transfer in rig.bus.trace) in (3, 4)
    back()
    rig.run(4.0)
    assert (np.diff(check_honest(rig)) == 1).all()
    assert not (rig.got.flags[-200:] & Flag.FIELD_LOST).any()
    assert len(rig.fields(len(rig.got) - 200)) == pytest.approx(RATES[name], rel=0.1)


def test_chip_comes_back_while_its_magnetometer_is_away_and_the_frames_have_another_length():
    rig = MagStreamRig("gy-87-hmc5883l").start()
    rig.run(2.0)
    back = rig.unplug()
    rig.fake_bus.adapter.faults.add(parse("brown-out"))
    rig.run(3.0)
    assert rig.health.gaps == 1 and len(rig.infos) == 1
    assert rig.got.flags[-1] & Flag.FIELD_LOST
    back()
    rig.run(4.0)
    check_honest(rig)
    assert rig.health.gaps == 1
    assert len(rig.fields(len(rig.got) - 200)) == pytest.approx(100, rel=0.1)


@pytest.mark.parametrize("register", [0x24, 0x25, 0x26, 0x27, 0x34, 0x67, 0x6A])
def test_changed_register_of_the_master_goes_unnoticed(register):
    rig = MagStreamRig("gy-87").start()
    rig.run(1.0)
    table = bytes(rig.chip.registers)
    rig.wr(register, table[register] ^ (0x20 if register == 0x6A else 0x01))
    rig.run(3.0)
    assert rig.chip.registers[register] == table[register]
    check_honest(rig)
    # With the master off the frames are shorter at once, and beginning the FIFO anew switches it on.
    assert rig.health.registers_upset == (register != 0x6A)
    assert len(rig.fields(len(rig.got) - 200)) == pytest.approx(50, rel=0.1)


def test_field_beyond_the_range_is_given_out():
    rig = MagStreamRig("gy-87-hmc5883l", motion=lying(400.0)).start()
    rig.run(1.0)
    assert np.isnan(rig.got.field_ut).all()
    assert rig.got.flags[-1] & Flag.FIELD_DISTURBED


def test_stream_is_decoded_otherwise_by_another_cut_or_from_its_drains():
    rig = MagStreamRig("mpu-9250", imperfections=MagnetometerImperfections(noise_ut=1.0)).start()
    rig.run(1.0)
    rig.unplug()
    rig.run(2.0)
    health = Health()
    decoder = Decoder(rig.infos[0], health=health)
    for k, drain in enumerate(rig.drains):
        if k % 50 == 7:
            saved, decoder = decoder.state(), Decoder(rig.infos[0], health=health)
            decoder.restore(saved)
        block = decoder.decode(drain)
        assert block.field_ut.tobytes() == rig.blocks[k].field_ut.tobytes()
        assert block.flags.tobytes() == rig.blocks[k].flags.tobytes()
    assert health.magnetometer_lost == rig.health.magnetometer_lost == 1


def test_longest_sample_is_longer_than_the_settings_reckon_with():
    for name in BOARDS:
        rig = MagStreamRig(name).start()
        assert rig.infos[0].frame_bytes <= 14 + LONGEST_BYTES


@pytest.mark.parametrize(
    ("bad", "says"),
    [
        ({"use": "HMC5983"}, "not known: take one of no, auto, HMC5883L"),
        ({"rate_hz": -1.0}, "rate_hz = -1"),
        ({"range_ut": float("nan")}, "range_ut = nan"),
        ({"to_body": (1.0, 0.0, 0.0)}, "nine numbers"),
        ({"to_body": (1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, -1.0)}, "no rotation"),
    ],
)
def test_settings_that_cannot_be_are_taken(bad, says):
    with pytest.raises(SettingsError, match=says):
        MagnetometerParams(**bad)


def test_bus_that_is_disturbed_while_the_magnetometer_is_looked_for_hides_it():
    rig = MagStreamRig("gy-87")
    asked: list[int] = []
    rig.bus.spoil = lambda _k, t: t.register == 0x0D and t.is_read and len(asked) < 2 and not asked.append(t.at_ns)
    rig.start()
    assert len(asked) == 2
    assert rig.infos[0].magnetometer is not None
    assert replace(rig.infos[0], magnetometer=None).frame_bytes == 14
    assert rig.clock.now_ns() < rig.birth_ns + 400 * NS_PER_MS
