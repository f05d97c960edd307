"""Counts and what they mean: three distinct values on three axes, through the whole way of the FIFO."""

from __future__ import annotations

import numpy as np
import pytest
from chip_rig import Rig, StubbornChip, config
from hypothesis import given
from hypothesis import strategies as st

from hw_fakes import PERFECT, Imperfections
from quavelet.core.blocks import Flag
from quavelet.core.errors import ChipUnstable
from quavelet.mpu6050.decoder import clip_flags
from quavelet.mpu6050.stream import StreamInfo

G, DEG = 9.80665, np.pi / 180


class Constant:
    """A motion no body could keep up: the same three rates and three forces for ever."""

    def __init__(self, rate_dps: tuple[float, ...], force_g: tuple[float, ...]) -> None:
        self.rate, self.force = np.array(rate_dps) * DEG, np.array(force_g) * G

    def rate_rad_s(self, t_s: np.ndarray) -> np.ndarray:
        return np.broadcast_to(self.rate, (len(t_s), 3))

    def specific_force_m_s2(self, t_s: np.ndarray) -> np.ndarray:
        return np.broadcast_to(self.force, (len(t_s), 3))


def means(rig: Rig) -> tuple[np.ndarray, np.ndarray, float]:
    got = rig.got
    counts = got.counts[20:].astype(float)  # past the filter's memory
    accel = counts[:, 0:3].mean(0) * got.scale.accel_m_s2_per_lsb
    gyro = counts[:, 4:7].mean(0) * got.scale.gyro_rad_s_per_lsb
    temp = counts[:, 3].mean() * got.scale.temp_degc_per_lsb + got.scale.temp_degc_at_zero
    return accel, gyro, temp


@pytest.mark.parametrize("dlpf", [0, 3])
@pytest.mark.parametrize("accel_range", [2, 4, 8, 16])
@pytest.mark.parametrize("gyro_range", [250, 500, 1000, 2000])
def test_three_values_come_out_on_their_axes_with_their_signs_and_sizes(gyro_range, accel_range, dlpf):
    rate = tuple(gyro_range * x for x in (0.91, -0.37, 0.113))
    force = tuple(accel_range * x for x in (-0.17, 0.53, 0.87))
    parts = Imperfections(temp_degc=31.7, warm_temp_degc=31.7)
    rig = Rig(
        config(200, dlpf=dlpf, gyro=gyro_range, accel=accel_range), motion=Constant(rate, force), imperfections=parts
    )
    rig.start().run(0.3)
    accel, gyro, temp = means(rig)
    # Half a count of 16 bits over twice the range.
    assert gyro / DEG == pytest.approx(rate, abs=0.51 * gyro_range / 32750)
    assert accel / G == pytest.approx(force, abs=0.51 * accel_range / 32768)
    assert temp == pytest.approx(31.7, abs=0.51 / 340)
    assert not (rig.got.flags & (Flag.GYRO_CLIPPED | Flag.ACCEL_CLIPPED)).any()


@pytest.mark.parametrize(("axis", "sign"), [(a, s) for a in range(3) for s in (1, -1)])
def test_axis_at_the_end_of_its_range_is_flagged_and_the_other_sensor_is_not(axis, sign):
    over = [0.0, 0.0, 0.0]
    over[axis] = sign * 1.2
    rig = Rig(motion=Constant(tuple(500 * x for x in over), (0, 0, 1)), imperfections=PERFECT).start()
    rig.run(0.3)
    flags = rig.got.flags[20:]
    assert (flags & Flag.GYRO_CLIPPED != 0).all() and not (flags & Flag.ACCEL_CLIPPED).any()
    rig = Rig(motion=Constant((0, 0, 0), tuple(4 * x for x in over)), imperfections=PERFECT).start()
    rig.run(0.3)
    flags = rig.got.flags[20:]
    assert (flags & Flag.ACCEL_CLIPPED != 0).all() and not (flags & Flag.GYRO_CLIPPED).any()


def test_temperature_at_its_end_is_not_a_clipped_sensor():
    counts = np.zeros((2, 7), dtype=np.int16)
    counts[:, 3] = [-32768, 32767]
    assert (clip_flags(counts) == 0).all()


@pytest.mark.parametrize(("register", "fs"), [(0x1B, 0x18), (0x1B, 0x00), (0x1C, 0x18), (0x1C, 0x00)])
def test_range_that_does_not_take_is_refused_not_scaled_by_the_wish(register, fs):
    rig = Rig(chip_type=StubbornChip)
    rig.chip.stubborn = lambda at, byte: fs if at == register else byte
    with pytest.raises(ChipUnstable, match="_CONFIG did not read back"):
        rig.start()


@pytest.mark.parametrize(("register", "fs"), [(0x1B, 0x18), (0x1C, 0x10)])
def test_range_changed_after_the_check_gives_samples_of_another_scale(register, fs):
    """The check passed, then something else wrote to the chip, before the start or while it streams."""
    rig = Rig(motion=Constant((100, -200, 30), (0.5, -0.25, 0.75)), imperfections=PERFECT)
    checks = 0

    def after_check(_k: int, _transfer: object, answer: bytes) -> bytes:
        nonlocal checks
        checks += rig.bus.trace[-1].register == 0x38 and rig.bus.trace[-1].is_read
        if checks == 2:
            checks += 1
            rig.wr(register, fs)
        return answer

    rig.bus.alter = after_check
    rig.start().run(0.3)
    assert rig.chip.registers[register] == 0x08
    assert rig.health.config_mismatches == 1
    accel, gyro, _ = means(rig)
    assert gyro / DEG == pytest.approx([100, -200, 30], abs=0.04)
    assert accel / G == pytest.approx([0.5, -0.25, 0.75], abs=2e-4)


@given(
    gyro=st.integers(0, 255), accel=st.integers(0, 255), chip_config=st.integers(0, 255), divider=st.integers(0, 255)
)
def test_stream_info_reads_ranges_and_period_out_of_any_bytes(gyro, accel, chip_config, divider):
    """Range bits must be masked: self-test and filter bits stand in the same bytes."""
    info = StreamInfo(
        src="x", address=0x68, who_am_i=0x68, config=chip_config, gyro_config=gyro, accel_config=accel,
        smplrt_div=divider,
    )  # fmt: skip
    assert info.gyro_range_dps == 250 * 2 ** (gyro // 8 % 4)
    assert info.accel_range_g == 2 * 2 ** (accel // 8 % 4)
    base = 8000 if chip_config % 8 in (0, 7) else 1000
    assert info.nominal_period_s == pytest.approx((divider + 1) / base)
    # The data sheet's sensitivities are the range over 2^15, rounded.
    assert info.scale.gyro_rad_s_per_lsb * 32768 == pytest.approx(info.gyro_range_dps * DEG, rel=3e-3)
    assert info.scale.accel_m_s2_per_lsb * 32768 == pytest.approx(info.accel_range_g * G)
    assert info.scale.temp_degc_at_zero + -521 * info.scale.temp_degc_per_lsb == pytest.approx(35, abs=0.01)
