"""The board that does what the bench session asks for: each instruction is obeyed, and the truth can be had."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hw_fakes import open_fake
from hw_fakes.chip.registers import ACCEL_TRIM
from hw_fakes.wire.bench import BenchBus
from hw_fakes.world.motion_told import ToldMotion
from quavelet.bus.protocol import FollowsInstructions
from quavelet.core.clock import VirtualClock
from quavelet.core.errors import SettingsError
from quavelet.core.instruction import FACES, Instruction
from quavelet.core.units import DEG_PER_RAD, NS_PER_S, STANDARD_GRAVITY_M_S2


def bench(seed: int = 0) -> tuple[BenchBus, VirtualClock]:
    clock = VirtualClock(7 * NS_PER_S)
    return BenchBus(clock=clock, seed=seed), clock


def seconds(bus: BenchBus, clock: VirtualClock, after_s: float) -> np.ndarray:
    return np.array([bus.chip.world_time_s(clock.now_ns()) + after_s])


@pytest.mark.parametrize("face", FACES)
def test_a_face_that_is_asked_for_is_up_by_the_accelerometers_sign(face):
    bus, clock = bench()
    bus.follow(Instruction(action="face", face=face))
    force = bus.motion.specific_force_m_s2(seconds(bus, clock, 3.0))[0]
    axis = "xyz".index(face[1])
    assert force[axis] * (1 if face[0] == "+" else -1) == pytest.approx(STANDARD_GRAVITY_M_S2, rel=1e-3)
    assert not bus.motion.rate_rad_s(seconds(bus, clock, 3.0)).any()


def test_a_turn_goes_round_the_axis_that_is_up_counter_clockwise_and_back_to_the_edge():
    bus, clock = bench(4)
    bus.follow(Instruction(action="face", face="-x"))
    clock.advance_ns(4 * NS_PER_S)
    bus.follow(Instruction(action="turn", face="-x", turn_deg=360.0))
    t_s = seconds(bus, clock, 0.0) + np.arange(0.0, 12.0, 1e-3)
    turned_deg = bus.motion.rate_rad_s(t_s).sum(axis=0) * 1e-3 * DEG_PER_RAD
    assert turned_deg[0] == pytest.approx(-360.0, abs=1.0)
    assert abs(turned_deg[1:]).max() < 3.0


def test_a_warmed_board_cools_again_and_its_bias_goes_with_it():
    bus, clock = bench(1)
    before = bus.sensor.temperature_degc(seconds(bus, clock, 0.0))[0]
    bus.follow(Instruction(action="warm"))
    hot, cold = (bus.sensor.temperature_degc(seconds(bus, clock, s))[0] for s in (30.0, 1000.0))
    assert hot - before > 20.0
    assert cold == pytest.approx(before, abs=1.0)
    biases = [bus.chip.source.gyro_bias_rad_s(seconds(bus, clock, s))[0] for s in (30.0, 1000.0)]
    slope = np.array(bus.sensor.gyro_bias_rad_s_degc)
    assert biases[0] - biases[1] == pytest.approx(slope * (hot - cold), abs=0.02 / DEG_PER_RAD)


def test_the_chip_shows_an_instruction_that_came_after_its_samples_were_computed():
    bus, clock = bench()
    for register, value in ((0x6B, 1), (0x1C, 0x08)):
        bus.write(0x68, bytes([register, value]))
    clock.advance_ns(NS_PER_S)
    bus.write_read(0x68, b"\x3b", 14)
    bus.follow(Instruction(action="face", face="-z"))
    clock.advance_ns(4 * NS_PER_S)
    z = int.from_bytes(bus.write_read(0x68, b"\x3f", 2), "big", signed=True)
    assert z < -7800


def test_boards_of_two_seeds_differ_and_one_seed_gives_one_board():
    (one, _), (same, _), (other, _) = bench(5), bench(5), bench(6)
    assert one.sensor == same.sensor
    assert one.sensor.gyro_bias_rad_s != other.sensor.gyro_bias_rad_s


def test_every_drawn_chip_is_of_the_usual_silicon_and_has_a_trim_of_its_own():
    trims = [bench(seed)[0].chip.accel_trim for seed in range(40)]
    assert len(set(trims)) == 40
    assert {tuple(word & 1 for word in trim) for trim in trims} == {tuple(word & 1 for word in ACCEL_TRIM)}


def test_it_is_opened_by_name_with_a_seed_and_follows_instructions():
    clock = VirtualClock()
    bus = open_fake("bench:12", clock=clock)
    assert isinstance(bus, FollowsInstructions)
    assert bus.name == "fake:bench:12"
    assert not isinstance(open_fake("still", clock=clock), FollowsInstructions)
    for name in ("bench:", "bench:x", "benches", "bench:-1"):
        with pytest.raises(SettingsError):
            open_fake(name, clock=clock)


@given(st.lists(st.tuples(st.integers(0, 5), st.floats(0.0, 4.0)), min_size=1, max_size=5))
@settings(max_examples=20, deadline=None)
def test_attitude_is_the_integral_of_the_rate_whenever_it_is_told(told):
    motion, at_s = ToldMotion(), 0.0
    for face, pause_s in told:
        at_s += pause_s
        motion.bring_up(np.eye(3)[face % 3] * (1 if face < 3 else -1), at_s=at_s, takes_s=1.0)
    t_s = np.arange(0.0, motion.free_s + 1.0, 1e-3)
    q, rate = motion.attitude(t_s), motion.rate_rad_s(t_s + 5e-4)
    half = 0.5e-3 * rate[:-1]
    step = np.column_stack([np.ones(len(half)), half])
    w, x, y, z = q[:-1].T
    a, b, c, d = step.T
    after = np.column_stack(
        [
            w * a - x * b - y * c - z * d,
            w * b + x * a + y * d - z * c,
            w * c - x * d + y * a + z * b,
            w * d + x * c - y * b + z * a,
        ]
    )
    assert np.abs(np.abs((after * q[1:]).sum(axis=1)) - 1.0).max() < 1e-5
