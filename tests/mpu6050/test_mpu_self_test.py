"""The factory self-test: formulas, procedure, and what it says of good, broken and moved boards."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from chip_rig import ADDRESS, Rig, StubbornChip, config
from hypothesis import given
from hypothesis import strategies as st

from hw_fakes import NOISE_ONLY, TYPICAL, Still
from hw_fakes.chip import personalities as fakes
from quavelet.core.errors import BusError, ChipUnstable, DeviceLost
from quavelet.core.health import Health
from quavelet.core.units import NS_PER_MS, NS_PER_S
from quavelet.mpu6050.access import RegisterAccess
from quavelet.mpu6050.factory_trim import TrimCodes, codes_of_four, expected_response, read_codes
from quavelet.mpu6050.self_test import AXES, run_self_test
from quavelet.mpu6050.variants import MPU6050, MPU6500, VARIANTS

CHIPS = {chip.name: chip for chip in fakes.PERSONALITIES}
CONFIGURATION = [0x19, 0x1A, 0x1B, 0x1C, 0x1D, 0x23, 0x37, 0x38, 0x6A, 0x6B, 0x6C]


class Bench:
    """A chip lying still, and access to it. `spoil(words)` changes what the axes show, (n, 7) with the chip."""

    def __init__(self, personality=fakes.MPU6050, *, imperfections=NOISE_ONLY, motion=None, speed_hz=400_000, **kwargs):
        self.rig = Rig(
            personality=personality,
            motion=motion or Still(roll_deg=3, pitch_deg=-5),
            imperfections=imperfections,
            speed_hz=speed_hz,
            **kwargs,
        )
        self.chip = self.rig.chip
        self.clock = self.rig.clock
        self.variant = VARIANTS[personality.who_am_i]
        self.access = RegisterAccess(self.rig.bus, address=ADDRESS, clock=self.clock, health=Health())

    def run(self):
        return run_self_test(self.access, variant=self.variant, clock=self.clock)

    def testing(self, register, axis):
        return bool(self.chip.registers[register] & 0x80 >> axis)


def test_codes_of_a_real_chip_give_its_published_responses():
    """Registers 51 4F B8 A5, of a reader of a widespread library whose mask gives 23 for accelerometer z."""
    codes = codes_of_four(bytes.fromhex("51 4F B8 A5"))
    assert codes == TrimCodes((10, 9, 21), (17, 15, 24))
    response = expected_response(codes, variant=MPU6050)
    assert np.array(response.accel_g) * 4096 == pytest.approx([1877.29, 1816.02, 2704.24], abs=0.005)
    assert np.array(response.gyro_dps) * 131 == pytest.approx([6725.40, -6146.88, 9213.83], abs=0.005)


@given(st.binary(min_size=4, max_size=4))
def test_codes_are_the_bits_of_the_register_map_and_no_others(run):
    bits = "".join(f"{byte:08b}" for byte in run)
    codes = codes_of_four(run)
    assert codes.gyro == tuple(int(bits[8 * axis + 3 : 8 * axis + 8], 2) for axis in range(3))
    low = [bits[24 + 2 + 2 * axis : 24 + 4 + 2 * axis] for axis in range(3)]
    assert codes.accel == tuple(int(bits[8 * axis : 8 * axis + 3] + low[axis], 2) for axis in range(3))


def test_ends_of_the_formulas_are_those_of_the_data_sheet():
    first = expected_response(TrimCodes((1, 1, 1), (1, 1, 1)), variant=MPU6050)
    last = expected_response(TrimCodes((31, 31, 31), (31, 31, 31)), variant=MPU6050)
    assert np.array([*first.accel_g, *last.accel_g]) * 4096 == pytest.approx([1392.64] * 3 + [3768.32] * 3)
    assert np.array(last.gyro_dps) * 131 == pytest.approx([12622.98, -12622.98, 12622.98], abs=0.005)
    assert expected_response(TrimCodes((0, 1, 0), (1, 0, 1)), variant=MPU6050).gyro_dps == (25.0, None, 25.0)
    # 2620 counts at 16384 per g and 131 per deg/s (the vendor's driver).
    relative = expected_response(TrimCodes((1, 2, 0), (1, 2, 0)), variant=MPU6500)
    assert relative.accel_g == pytest.approx((2620 / 16384, 2646.2 / 16384, None))
    assert relative.gyro_dps == pytest.approx((20.0, 20.2, None))


@pytest.mark.parametrize("name", CHIPS)
@pytest.mark.parametrize("imperfections", [NOISE_ONLY, TYPICAL], ids=["noise", "typical"])
def test_good_chip_of_any_kind_passes(name, imperfections):
    report = Bench(CHIPS[name], imperfections=imperfections).run()
    assert report.passed and report.still and report.advice == ""
    assert tuple(axis.axis for axis in report.axes) == AXES
    assert [axis.unit for axis in report.axes] == ["g"] * 3 + ["deg/s"] * 3
    # Scale errors of a good part are 1 %.
    assert [axis.ratio for axis in report.axes] == pytest.approx([1] * 6, abs=0.02)
    assert all(axis.measured == pytest.approx(axis.ratio * axis.expected) for axis in report.axes)
    if not CHIPS[name].class_6500:
        assert report.axes[4].expected < 0 < report.axes[3].expected


def test_formula_of_the_other_class_would_fail_every_clone():
    bench = Bench(fakes.MPU6500)
    assert read_codes(bench.access, variant=MPU6500) == TrimCodes((0x60, 0x68, 0x78), (0x8D, 0x90, 0xB0))
    bench.variant = replace(MPU6050, who_am_i=MPU6500.who_am_i)
    assert not bench.run().passed


@pytest.mark.parametrize("speed_hz", [100_000, 400_000, 1_000_000])
def test_slow_and_fast_wires_give_the_same_verdict_in_time(speed_hz):
    bench = Bench(speed_hz=speed_hz)
    begin_ns = bench.clock.now_ns()
    assert bench.run().passed
    assert bench.clock.now_ns() - begin_ns < 2.5 * NS_PER_S


@pytest.mark.parametrize("name", ["MPU-6050", "MPU-6500"])
def test_procedure_has_the_vendors_waits_and_ranges(name):
    bench = Bench(CHIPS[name])
    bench.run()
    both = [t for t in bench.rig.bus.trace if t.register == 0x1C and t.written and t.written[0] & 0xE0 == 0xE0]
    gyro = [t for t in bench.rig.bus.trace if t.register == 0x1B and t.written and t.written[0] & 0xE0 == 0xE0]
    fifo = [t for t in bench.rig.bus.trace if t.register == 0x23 and t.written == b"\xf8"]
    (on,), (gyro_on,) = both, gyro
    assert on.written[0] == (0xE0 if CHIPS[name].class_6500 else 0xF0)  # 2 g, 8 g
    assert gyro_on.written[0] == 0xE0  # 250 deg/s
    assert min(t.at_ns for t in fifo if t.at_ns > on.at_ns) - on.at_ns >= 200 * NS_PER_MS
    wake = next(t for t in bench.rig.bus.trace if t.register == 0x6B and t.written == b"\x01")
    assert fifo[0].at_ns - wake.at_ns >= 100 * NS_PER_MS


@pytest.mark.parametrize("name", ["MPU-6050", "MPU-6500"])
@pytest.mark.parametrize("started", [False, True])
def test_chip_is_left_as_it_was_found(name, started):
    bench = Bench(CHIPS[name])
    if started:
        bench.rig.config = config(500, dlpf=4, gyro=2000, accel=16)
        bench.rig.source = bench.rig.new_source()
        bench.rig.start()
    before = {register: bench.chip.registers[register] for register in CONFIGURATION}
    assert bench.run().passed
    assert {register: bench.chip.registers[register] for register in CONFIGURATION} == before


# Register of the self-test bits, and the word in a sample.
AXIS = [(0x1C, axis, axis) for axis in range(3)] + [(0x1B, axis, 4 + axis) for axis in range(3)]


@pytest.mark.parametrize("name", ["MPU-6050", "MPU-6500"])
@pytest.mark.parametrize("k", range(6))
@pytest.mark.parametrize(
    ("factor", "says"), [(0.0, "does not respond"), (-1.0, "wrong sign"), (0.4, "of the least that is allowed")]
)
def test_axis_that_responds_wrongly_is_named_and_no_other(name, k, factor, says):
    bench = Bench(CHIPS[name])
    register, axis, word = AXIS[k]
    good = bench.run().axes[k].measured
    lsb = {0x1C: 16384 if name == "MPU-6500" else 4096, 0x1B: 131}[register]

    def broken(words):
        if bench.testing(register, axis):
            words = words.copy()
            words[:, word] += np.int16(round((factor - 1) * good * lsb))
        return words

    bench.chip.spoil_words = broken
    report = bench.run()
    assert not report.passed and report.still
    assert [axis.axis for axis in report.axes if not axis.passed] == [AXES[k]]
    assert says in report.axes[k].advice and report.advice.startswith(AXES[k])
    assert report.axes[k].ratio == pytest.approx(factor, abs=0.02)


@pytest.mark.parametrize(("percent", "passes"), [(-16, False), (-12, True), (12, True), (16, False)])
def test_limit_of_the_6050_is_14_percent(percent, passes):
    bench = Bench()

    def off(words):
        if bench.testing(0x1B, 0):
            words = words.copy()
            words[:, 4] += np.int16(round(percent / 100 * 6725.4))
        return words

    bench.chip.spoil_words = off
    report = bench.run()
    assert report.axes[3].passed == passes == report.passed


@pytest.mark.parametrize(("dps", "passes"), [(15.0, True), (25.0, False)])
def test_bias_of_the_6500_class_counts_in_its_verdict(dps, passes):
    parts = replace(NOISE_ONLY, gyro_bias_rad_s=(0.0, np.radians(dps), 0.0))
    report = Bench(fakes.MPU6500, imperfections=parts).run()
    assert report.passed == passes
    if not passes:
        assert "25.0 deg/s at rest" in report.axes[4].advice


@pytest.mark.parametrize(
    ("name", "codes", "shown", "passes"),
    [
        # Without codes the vendor's driver takes 10 to 105 deg/s and 0.3 to 0.95 g.
        ("MPU-6050", (0, 0, 0, 0), ((0.5, 0.31, 0.94), (11, -50, 104)), True),
        ("MPU-6050", (0, 0, 0, 0), ((0.28, 0.5, 0.5), (50, -50, 50)), False),
        ("MPU-6050", (0, 0, 0, 0), ((0.5, 0.97, 0.5), (50, -50, 50)), False),
        ("MPU-6050", (0, 0, 0, 0), ((0.5, 0.5, 0.5), (9, -50, 50)), False),
        ("MPU-6050", (0, 0, 0, 0), ((0.5, 0.5, 0.5), (50, -50, 107)), False),
        ("MPU-6050", (0, 0, 0, 0), ((0.5, 0.5, 0.5), (50, 50, 50)), False),
        ("MPU-6050", (0, 0, 0, 0), ((0.0, 0.0, 0.0), (0, 0, 0)), False),
        # 60 deg/s and more, 225 to 675 mg.
        ("MPU-6500", (0,) * 6, ((0.24, 0.45, 0.66), (61, 100, 150)), True),
        ("MPU-6500", (0,) * 6, ((0.21, 0.45, 0.66), (61, 100, 150)), False),
        ("MPU-6500", (0,) * 6, ((0.24, 0.45, 0.69), (61, 100, 150)), False),
        ("MPU-6500", (0,) * 6, ((0.24, 0.45, 0.66), (58, 100, 150)), False),
    ],
)
def test_chip_without_codes_is_judged_by_what_the_vendor_accepts(name, codes, shown, passes):
    bench = Bench(CHIPS[name], self_test_codes=codes)
    accel_lsb = 16384 if name == "MPU-6500" else 4096

    def responding(words):
        words = words.copy()
        for register, axis, word in AXIS:
            if bench.testing(register, axis):
                lsb = 131 if register == 0x1B else accel_lsb
                words[:, word] += np.int16(round(shown[register == 0x1B][axis] * lsb))
        return words

    bench.chip.spoil_words = responding
    report = bench.run()
    assert all(axis.expected is None and axis.ratio is None for axis in report.axes)
    assert report.passed == passes


@pytest.mark.parametrize("at_s", [0.45, 0.7, 0.95, 1.2])
@pytest.mark.parametrize("turned", [(3.0, -5.0, 20.0), (9.0, -5.0, 0.0)])
def test_board_that_moved_meanwhile_is_measured_anew(at_s, turned):
    """Turned from one rest to another, or turning evenly from then on: in which of the three measurements does not
    matter."""

    class Turning:
        def __init__(self):
            self.first, self.then = Still(roll_deg=3, pitch_deg=-5), Still(roll_deg=turned[0], pitch_deg=turned[1])

        def rate_rad_s(self, t_s):
            rate = np.zeros((len(t_s), 3))
            rate[t_s > at_s, 2] = np.radians(turned[2])
            return rate

        def specific_force_m_s2(self, t_s):
            late = (t_s > at_s)[:, None]
            return np.where(late, self.then.specific_force_m_s2(t_s), self.first.specific_force_m_s2(t_s))

    report = Bench(motion=Turning()).run()
    assert report.passed and report.repeats == 1


def test_board_that_goes_on_shaking_is_not_called_broken():
    class Shaken:
        def rate_rad_s(self, t_s):
            return np.outer(np.sin(2 * np.pi * 7 * t_s), np.radians([0, 5, 0]))

        def specific_force_m_s2(self, t_s):
            return Still().specific_force_m_s2(t_s)

    bench = Bench(motion=Shaken())
    reasons: list[str] = []
    report = run_self_test(bench.access, variant=bench.variant, clock=bench.clock, on_repeat=reasons.append)
    assert not report.still and not report.passed
    assert report.advice.startswith("the board moved")
    assert report.repeats == len(reasons) == 3
    assert "moved" in reasons[0]


def test_axis_that_clips_is_not_called_broken():
    """Codes at the top of the range and gravity on the same axis are more than 2 g."""
    bench = Bench(fakes.MPU6500, motion=Still(), self_test_codes=(0x8D, 0x90, 0xB0, 0x60, 0x68, 0xC0))
    report = bench.run()
    assert "turn the board" in report.axes[2].advice
    assert Bench(
        fakes.MPU6500, motion=Still(roll_deg=180), self_test_codes=(0x8D, 0x90, 0xB0, 0x60, 0x68, 0xC0)
    ).run().passed  # fmt: skip


def test_code_disturbed_on_its_way_is_read_again():
    bench = Bench()
    times = 0

    def alter(_k, transfer, answer):
        nonlocal times
        if transfer.register == 0x0D:
            times += 1
            return bytes([answer[0] ^ 0x0F, *answer[1:]]) if times == 1 else answer
        return answer

    bench.rig.bus.alter = alter
    report = bench.run()
    assert report.passed and report.repeats == 0


def test_code_disturbed_twice_alike_is_found_out_at_the_end():
    bench = Bench()
    times = 0

    def alter(_k, transfer, answer):
        nonlocal times
        times += transfer.register == 0x0D
        return bytes([0x0F, *answer[1:]]) if transfer.register == 0x0D and times <= 2 else answer

    bench.rig.bus.alter = alter
    report = bench.run()
    assert report.passed and report.repeats == 1


def test_code_that_never_reads_twice_the_same_is_a_bus_error():
    bench = Bench()
    bench.rig.bus.alter = lambda k, t, answer: bytes([k & 0xFF]) * len(answer) if t.register == 0x0D else answer
    with pytest.raises(BusError, match="reads differently"):
        bench.run()


def test_chip_that_takes_no_samples_is_told_apart_from_a_broken_axis():
    bench = Bench(chip_type=StubbornChip)
    bench.chip.stubborn = lambda at, byte: 0 if at == 0x23 else byte
    with pytest.raises(ChipUnstable, match="FIFO"):
        bench.run()


def test_chip_that_leaves_the_temperature_out_of_its_frames_is_not_said_to_have_moved():
    """56 frames of 12 bytes are 48 of 14."""
    bench = Bench(chip_type=StubbornChip, pll_error=-0.07)
    bench.chip.stubborn = lambda at, byte: byte & 0x7F if at == 0x23 else byte
    with pytest.raises(ChipUnstable, match="FIFO"):
        bench.run()


def test_range_that_does_not_take_is_not_measured_with():
    bench = Bench(chip_type=StubbornChip)
    bench.chip.stubborn = lambda at, byte: byte | 0x18 if at == 0x1B else byte
    with pytest.raises(ChipUnstable, match=r"GYRO_CONFIG .* did not read back"):
        bench.run()


def test_chip_that_is_frozen_for_good_is_told_and_its_axes_are_not_called_broken():
    bench = Bench()
    bench.chip.spoil_words = lambda words: np.repeat(
        np.array([[9, 8, 4000, 0, 7, 6, 5]], dtype=np.int16), len(words), 0
    )
    with pytest.raises(ChipUnstable, match=r"no axis .* changes"):
        bench.run()


def test_self_test_bits_that_somebody_left_are_not_put_back():
    bench = Bench()
    for register, value in ((0x6B, 0x01), (0x1B, 0xE8), (0x1C, 0xE8)):
        bench.rig.wr(register, value)
    assert bench.run().passed
    assert (bench.chip.registers[0x1B], bench.chip.registers[0x1C]) == (0x08, 0x08)


def test_chip_put_in_its_place_is_not_judged_by_the_wrong_tables():
    bench = Bench(fakes.MPU6500)
    bench.variant = MPU6050
    with pytest.raises(DeviceLost, match="exchanged"):
        bench.run()


def test_host_that_sleeps_too_long_once_measures_again():
    bench = Bench()
    slept = bench.clock.sleep_until_ns
    naps = iter([0, 0, 0, 0, 0, 300 * NS_PER_MS])
    bench.clock.sleep_until_ns = lambda t_ns: slept(t_ns + next(naps, 0))
    assert bench.run().passed
