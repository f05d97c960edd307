"""Offsets in the chip's own registers: they offset, they are not lost, and nothing of the factory's is."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from chip_rig import ADDRESS, Rig, config
from hypothesis import given
from hypothesis import strategies as st

from hw_fakes import NOISE_ONLY, PERFECT, TYPICAL, Still
from hw_fakes.chip import personalities as fakes
from quavelet.core.errors import CalibrationError
from quavelet.core.health import Health
from quavelet.mpu6050.access import RegisterAccess
from quavelet.mpu6050.config import configuration_table
from quavelet.mpu6050.offset_plan import OffsetPlan
from quavelet.mpu6050.offsets import write_offsets
from quavelet.mpu6050.source import ChipSource
from quavelet.mpu6050.variants import MPU6050, MPU6500, VARIANTS

G = 9.80665
CHIPS = {chip.name: chip for chip in fakes.PERSONALITIES}
FLAT = (0.0, 0.0, 1.0)
ACCEL_STEP_G, GYRO_STEP_DPS = 2 / 2048, 1 / 32.8
BIASED = replace(
    NOISE_ONLY,
    gyro_bias_rad_s=tuple(np.radians((-7.3, 2.71, 15.9)).tolist()),
    accel_bias_m_s2=(0.043 * G, -0.0171 * G, 0.0793 * G),
)
PLAN = OffsetPlan(0x68, (-2100, 801, 1200), (0, 0, 0), (-2100, 801, 1200), (0, 0, 0))


class Bench:
    """A chip lying flat, and access to it."""

    def __init__(self, personality=fakes.MPU6050, *, imperfections=BIASED, motion=None, **kwargs):
        self.rig = Rig(personality=personality, motion=motion or Still(), imperfections=imperfections, **kwargs)
        self.chip, self.personality = self.rig.chip, personality
        self.variant = VARIANTS[personality.who_am_i]
        self.access = RegisterAccess(self.rig.bus, address=ADDRESS, clock=self.rig.clock, health=Health())

    def write(self, lies_g=FLAT):
        return write_offsets(self.access, variant=self.variant, clock=self.rig.clock, lies_g=lies_g)

    def plan(self):
        """What takes the bias of BIASED away, reckoned by hand: 2048 per g, 32.8 per deg/s."""
        x, y, z = factory = self.accel_words()
        return OffsetPlan(self.personality.who_am_i, factory, (0, 0, 0), (x - 88, y + 36, z - 162), (239, -89, -522))

    def accel_words(self):
        held = self.chip.registers
        return tuple(int.from_bytes(held[at : at + 2], "big", signed=True) for at in self.personality.accel_offsets)

    def gyro_words(self):
        return tuple(int.from_bytes(self.chip.registers[at : at + 2], "big", signed=True) for at in (0x13, 0x15, 0x17))

    def stream(self, plan, seconds=2.0):
        """Means of accelerometer in g and gyroscope in deg/s of a source that was given the plan."""
        rig = self.rig
        rig.source = ChipSource(
            rig.bus, address=ADDRESS, config=config(500, accel=2, gyro=250), clock=rig.clock, health=rig.health,
            offsets=plan,
        )  # fmt: skip
        rig.blocks.clear()
        rig.start().run(seconds)
        return self.means()

    def means(self):
        got = self.rig.got
        counts = got.counts[len(got) // 2 :].astype(float).mean(0)
        return counts[:3] * got.scale.accel_m_s2_per_lsb / G, np.degrees(counts[4:] * got.scale.gyro_rad_s_per_lsb)


@pytest.fixture(params=["MPU-6050", "MPU-6050-early", "MPU-9250", "ICM-20689", "clone-0x69", "clone-0x75"])
def bench(request):
    return Bench(CHIPS[request.param])


@pytest.fixture(params=["MPU-6050", "MPU-6500"])
def one_of_each(request):
    return CHIPS[request.param]


def test_bias_falls_below_one_step_of_the_register_on_every_kind_of_chip(bench):
    factory = bench.accel_words()
    written = bench.write()
    assert written.gyro_before_dps == pytest.approx((-7.3, 2.71, 15.9), abs=0.05)
    assert written.accel_before_g == pytest.approx((0.043, -0.0171, 0.0793), abs=0.002)
    assert np.abs(written.gyro_after_dps).max() < GYRO_STEP_DPS
    assert np.abs(written.accel_after_g).max() < ACCEL_STEP_G
    by_hand = bench.plan()
    assert written.plan.gyro == pytest.approx(by_hand.gyro, abs=1)
    assert (bench.accel_words(), bench.gyro_words()) == (written.plan.accel, written.plan.gyro)
    assert written.plan.accel_factory == factory
    assert [a & 1 for a in bench.accel_words()] == [a & 1 for a in factory]


def test_repeated_calibration_does_not_walk_off(one_of_each):
    bench = Bench(one_of_each)
    factory = bench.accel_words()
    plans = [bench.write().plan for _ in range(3)]
    assert all(plan.accel_factory == factory and plan.gyro_factory == (0, 0, 0) for plan in plans)
    spread = np.ptp([[*plan.accel, *plan.gyro] for plan in plans], axis=0)
    assert spread.max() <= 2
    bench.chip.power_cut()
    assert bench.accel_words() == factory


def test_offsets_come_back_after_a_supply_dip(one_of_each):
    bench = Bench(one_of_each)
    plan = bench.plan()
    accel, gyro = bench.stream(plan)
    assert accel == pytest.approx(FLAT, abs=1.5 * ACCEL_STEP_G)
    assert gyro == pytest.approx((0, 0, 0), abs=GYRO_STEP_DPS)
    assert bench.rig.health.config_mismatches == 0
    bench.chip.power_cut()
    assert bench.gyro_words() == (0, 0, 0)
    bench.rig.blocks.clear()
    bench.rig.run(2.0)
    assert bench.rig.health.chip_restarts == 1
    assert (bench.accel_words(), bench.gyro_words()) == (plan.accel, plan.gyro)
    accel, gyro = bench.means()
    assert accel == pytest.approx(FLAT, abs=1.5 * ACCEL_STEP_G)
    assert gyro == pytest.approx((0, 0, 0), abs=GYRO_STEP_DPS)


def test_offset_register_upset_while_streaming_is_written_anew(one_of_each):
    bench = Bench(one_of_each)
    plan = bench.plan()
    bench.stream(plan, 0.5)
    bench.rig.wr(0x13, 0x7F)
    bench.rig.run(3.0)
    assert bench.gyro_words() == plan.gyro
    assert bench.rig.health.registers_upset == 1


def obey_offsets(bench, factor):
    """From now on the chip adds `factor` times what stands in its offset registers beyond the factory's words."""
    factory = [word & ~1 for word in bench.accel_words()]

    def spoilt(words):
        accel = [8 * ((word & ~1) - at_factory) for word, at_factory in zip(bench.accel_words(), factory, strict=True)]
        gyro = [131 / 32.8 * word for word in bench.gyro_words()]
        return (words + (factor - 1) * np.round([*accel, 0, *gyro])).astype(np.int16)

    bench.chip.spoil_words = spoilt


def test_chip_that_subtracts_its_offsets_is_calibrated_too():
    """As RM9250 says of the gyroscope's."""
    bench = Bench()
    obey_offsets(bench, -1)
    written = bench.write()
    assert np.sign(written.plan.gyro) == pytest.approx(np.sign(written.gyro_before_dps))
    assert np.abs(written.gyro_after_dps).max() < GYRO_STEP_DPS
    assert np.abs(written.accel_after_g).max() < ACCEL_STEP_G


def test_gyroscope_alone_leaves_the_accelerometer_as_the_factory_set_it():
    bench = Bench(motion=Still(roll_deg=33, pitch_deg=-20))
    factory = bench.accel_words()
    written = bench.write(lies_g=None)
    assert written.plan.accel == written.plan.accel_factory == factory == bench.accel_words()
    assert np.isnan(written.accel_before_g).all() and np.isnan(written.accel_after_g).all()
    assert np.abs(written.gyro_after_dps).max() < GYRO_STEP_DPS


def test_board_on_its_side_is_brought_to_what_it_should_show():
    bench = Bench(motion=Still(roll_deg=90))
    written = bench.write(lies_g=(0.0, 1.0, 0.0))
    assert np.abs(written.accel_after_g).max() < ACCEL_STEP_G


def test_offsets_of_a_typical_part_take_its_bias_away():
    written = Bench(imperfections=TYPICAL).write()
    assert np.abs(written.gyro_before_dps).max() > 4
    assert np.abs(written.gyro_after_dps).max() < 2 * GYRO_STEP_DPS


def test_registers_that_do_nothing_are_noticed_and_put_back(one_of_each):
    """A clone with its offsets elsewhere."""
    bench = Bench(one_of_each)
    factory = bench.accel_words()
    obey_offsets(bench, 0)
    with pytest.raises(CalibrationError, match=r"accel x moves it by -?0\.0"):
        bench.write()
    assert (bench.accel_words(), bench.gyro_words()) == (factory, (0, 0, 0))


class Turning:
    """At rest until a time of its own, then 10 deg/s for ever."""

    def __init__(self, at_s):
        self.at_s = at_s

    def rate_rad_s(self, t_s):
        return np.where((t_s > self.at_s)[:, None], np.radians([0, 10, 0]), 0.0)

    def specific_force_m_s2(self, t_s):
        return Still().specific_force_m_s2(t_s)


@pytest.mark.parametrize("at_s", [1.0, 6.0, 8.0])
def test_board_that_moves_is_refused_and_the_factory_words_are_back(at_s):
    bench = Bench(motion=Turning(at_s))
    factory = bench.accel_words()
    with pytest.raises(CalibrationError, match=r"moves|moved"):
        bench.write()
    assert (bench.accel_words(), bench.gyro_words()) == (factory, (0, 0, 0))


def test_offset_that_makes_it_worse_is_taken_back():
    """The board begins to turn, evenly, between the trial and the last look."""
    bench = Bench()

    def turned(words):
        tried = len(set(bench.gyro_words())) == 1
        return words if tried else (words + np.array([0, 0, 0, 0, 0, 4000, 0])).astype(np.int16)

    bench.chip.spoil_words = turned
    with pytest.raises(CalibrationError, match=r"gyro y is further off"):
        bench.write()
    assert bench.gyro_words() == (0, 0, 0)


def test_plan_of_another_chip_is_refused_before_it_is_written(one_of_each):
    plan = Bench(one_of_each).plan()
    other = Bench(one_of_each, accel_trim=(-2102, 801, 1200))
    with pytest.raises(CalibrationError, match="measured on one that holds"):
        other.stream(plan)
    assert other.accel_words() == (-2102, 801, 1200)


def test_plan_of_another_kind_of_chip_is_refused():
    with pytest.raises(CalibrationError, match=r"0x68.*0x70"):
        configuration_table(config(), variant=MPU6500, offsets=PLAN)


words = st.integers(-32768, 32767)


@given(st.tuples(words, words, words), st.tuples(words, words, words), st.integers(0, 255))
def test_rows_put_the_words_in_and_leave_the_chips_bit_alone(accel, gyro, before):
    factory = tuple(a ^ 2 for a in accel)
    plan = OffsetPlan(0x68, factory, (0, 0, 0), accel, gyro)
    held = bytearray([before] * 128)
    for at, word in zip((0x06, 0x08, 0x0A), factory, strict=True):
        held[at : at + 2] = (word & 0xFFFF).to_bytes(2, "big")
    for row in configuration_table(config(), variant=MPU6050, offsets=plan)[-12:]:
        held[row.register.address] = row.applied_to(held[row.register.address])
        assert row.holds(held[row.register.address])
    got = [int.from_bytes(held[at : at + 2], "big", signed=True) for at in (0x06, 0x08, 0x0A, 0x13, 0x15, 0x17)]
    assert got == [*accel, *gyro]
    assert held[:6] == bytes([before] * 6) and held[0x0C:0x13] == bytes([before] * 7)


@pytest.mark.parametrize(
    "changes",
    [
        {"accel": (-2099, 801, 1200)},  # bit 0 is the chip's
        {"accel": (-2100, 801)},
        {"gyro": (0, 0, 32768)},
        {"gyro": (-32769, 0, 0)},
    ],
)
def test_plan_that_no_chip_can_hold_is_refused(changes):
    with pytest.raises(CalibrationError):
        replace(PLAN, **changes)


def test_chip_without_a_plan_keeps_its_factory_offsets():
    bench = Bench(imperfections=PERFECT)
    factory = bench.accel_words()
    bench.rig.start()
    assert (bench.accel_words(), bench.gyro_words()) == (factory, (0, 0, 0))
