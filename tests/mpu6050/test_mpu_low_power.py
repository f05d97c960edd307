"""Cycle mode: samples in m/s^2 at the rate asked for, the gyroscope off, and a chip that is given back as it was."""

from __future__ import annotations

from contextlib import suppress

import numpy as np
import pytest
from chip_rig import StubbornChip, config
from idle_rig import IdleRig

from hw_fakes import NOISE_ONLY, Still
from quavelet.core.errors import BusBusy, BusError, ChipUnstable
from quavelet.core.health import Health
from quavelet.core.units import NS_PER_S, STANDARD_GRAVITY_M_S2
from quavelet.mpu6050.low_power import cycling
from quavelet.mpu6050.measuring import reset_chip
from quavelet.mpu6050.source import ChipSource

BOTH = ("MPU-6050", "MPU-6500")


def low_power(rig, wake_hz=20.0, **kwargs):
    return cycling(rig.status(), variant=rig.variant, clock=rig.clock, wake_hz=wake_hz, **kwargs)


@pytest.mark.parametrize("error", [-0.05, 0.03])
@pytest.mark.parametrize(
    ("name", "wake_hz"),
    [*(("MPU-6050", hz) for hz in (1.25, 5, 20, 40)), *(("MPU-6500", hz) for hz in (0.24, 3.91, 15.63, 62.5, 500))],
)
def test_samples_come_at_the_rate_of_the_data_sheet_by_the_internal_oscillator(name, wake_hz, error):
    rig = IdleRig(name, internal_error=error)
    with low_power(rig, wake_hz) as accel:
        t_ns = np.array([accel.read().t_ns for _ in range(12)])
    period_s = np.diff(t_ns).mean() / NS_PER_S
    assert period_s * wake_hz * (1 + error) == pytest.approx(1, abs=0.03)


@pytest.mark.parametrize("name", [*BOTH, "MPU-6050-early", "ICM-20689", "clone-0x75"])
@pytest.mark.parametrize("range_g", [2, 16])
def test_samples_are_in_m_s2_on_every_kind_of_chip_and_range(name, range_g):
    motion = Still(roll_deg=30, pitch_deg=-20)
    rig = IdleRig(name, motion=motion)
    with low_power(rig, rig.variant.wake_rates_hz[-1], accel_range_g=range_g) as accel:
        got = [accel.read().accel_m_s2 for _ in range(3)][-1]
    truth = motion.specific_force_m_s2(np.zeros(1))[0]
    assert got == pytest.approx(truth, abs=0.02)
    assert np.linalg.norm(got) == pytest.approx(STANDARD_GRAVITY_M_S2, abs=0.03)


@pytest.mark.parametrize("name", BOTH)
def test_gyroscope_and_thermometer_are_off_and_the_chip_cycles(name):
    rig = IdleRig(name)
    with low_power(rig) if name == "MPU-6050" else low_power(rig, 31.25):
        power, standby = rig.chip.registers[0x6B], rig.chip.registers[0x6C]
        assert (power, standby & 0x3F) == (0x28, 0x07)
        assert standby >> 6 == (2 if name == "MPU-6050" else 0)


@pytest.mark.parametrize("name", BOTH)
@pytest.mark.parametrize("found", ["asleep", "awake", "configured"])
@pytest.mark.parametrize("fails", [False, True])
def test_chip_is_given_back_as_it_was_found(name, found, fails):
    rig = IdleRig(name)
    if found != "asleep":
        rig.wr(0x6B, 0x01)
    if found == "configured":
        for register, value in ((0x1A, 3), (0x1B, 0x08), (0x1C, 0x18), (0x19, 4), (0x37, 0x30), (0x38, 0x10)):
            rig.wr(register, value)
    before = rig.kept
    with suppress(ZeroDivisionError), low_power(rig, rig.variant.wake_rates_hz[-2]) as accel:
        accel.read()
        if fails:
            raise ZeroDivisionError
    assert rig.kept == before


def test_chip_that_streams_is_refused_and_one_left_streaming_is_had_after_a_reset():
    rig = IdleRig()
    source = ChipSource(rig.bus, address=0x68, config=config(), clock=rig.clock, health=Health())
    source.wait_until_streaming()
    with pytest.raises(BusBusy, match=r"streams.*reset the chip"):
        rig.status()
    reset_chip(rig.access, variant=rig.variant, clock=rig.clock)
    with low_power(rig) as accel:
        assert accel.read().accel_m_s2[2] == pytest.approx(9.8, abs=0.1)


@pytest.mark.parametrize(
    ("name", "asked", "says"),
    [
        ("MPU-6050", {"wake_hz": 10.0}, "1.25, 5, 20, 40"),
        ("MPU-6500", {"wake_hz": 40.0}, "0.244.*500"),
        ("MPU-6050", {"wake_hz": float("nan")}, "cannot be made"),
        ("MPU-6050", {"accel_range_g": 3}, "2, 4, 8 or 16"),
    ],
)
def test_what_the_chip_cannot_do_is_refused_before_anything_is_written(name, asked, says):
    rig = IdleRig(name)
    with pytest.raises(ValueError, match=says), low_power(rig, **asked):
        pass
    assert rig.chip.written == []


@pytest.mark.parametrize("fault", ["brown-out", "asleep", "changed register=0x1c value=0x18", "zeros for=2"])
def test_chip_that_loses_its_setting_gives_an_error_and_no_wrong_sample(fault):
    rig = IdleRig(imperfections=NOISE_ONLY)
    with pytest.raises(ChipUnstable), low_power(rig) as accel:
        accel.read()
        rig.fault(fault)
        for _ in range(40):
            assert accel.read().accel_m_s2[2] == pytest.approx(9.8, abs=0.3)


def test_chip_that_is_gone_is_a_bus_error():
    rig = IdleRig()
    with pytest.raises(BusError), low_power(rig) as accel:
        rig.fault("unplugged")
        accel.read()


def test_setting_that_does_not_take_is_not_cycled_with():
    rig = IdleRig()
    rig.chip.__class__ = StubbornChip
    rig.chip.stubborn = lambda at, byte: 0 if at == 0x6C else byte
    with pytest.raises(ChipUnstable, match=r"PWR_MGMT_2 .* did not read back"), low_power(rig):
        pass
