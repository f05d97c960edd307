"""Yaw set to zero by hand: it reads zero there, nothing else changes, and its sigma is that of what came since."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hw_fakes import FakeBus, FakeMpu6050, Turntable
from hw_fakes.world.imperfections import TYPICAL, Imperfections, draw
from hw_fakes.world.motion_base import EulerMotion
from quavelet.attitude.doubt import YAW_MAX_RAD
from quavelet.attitude.params import FilterParams, Kind
from quavelet.attitude.yaw_zero import YawZero
from quavelet.core.blocks import AttitudeBlock, Flag, FloatArray, YawFrom, concat
from quavelet.core.clock import VirtualClock
from quavelet.core.errors import NotPossible
from quavelet.core.euler import from_euler, to_euler
from quavelet.core.quaternion import angle_between, conjugate, multiply
from quavelet.core.units import DEG_PER_RAD, NS_PER_S
from quavelet.imu import Imu
from quavelet.settings import Settings

KINDS: tuple[Kind, ...] = ("gated", "velocity", "pid", "fusion", "fusion-literal")


def block_of(angles_deg: list[tuple[float, float, float]], **changed) -> AttitudeBlock:
    n = len(angles_deg)
    block = AttitudeBlock(
        t_ns=np.arange(1, n + 1) * 5_000_000,
        period_s=np.full(n, 0.005),
        gap_ns=np.zeros(n, dtype=np.int64),
        flags=np.zeros(n, dtype=np.uint32),
        q=from_euler(np.radians(angles_deg)),
        sigma_rad=np.tile([0.01, 0.02, 0.3], (n, 1)),
        gyro_rad_s=np.zeros((n, 3)),
        accel_m_s2=np.tile([0.0, 0.0, 9.8], (n, 1)),
        temp_degc=np.full(n, 25.0),
        gyro_bias_rad_s=np.zeros((n, 3)),
        still=np.ones(n, dtype=np.bool_),
    )
    return replace(block, **changed)


def angles_deg(block: AttitudeBlock) -> FloatArray:
    return DEG_PER_RAD * to_euler(block.q)


degrees = st.tuples(st.floats(-179, 179), st.floats(-79, 79), st.floats(-179, 179))


@given(at=degrees, later=degrees)
@settings(max_examples=200)
def test_yaw_is_zero_where_it_was_asked_for_and_roll_pitch_and_turns_stay(at, later) -> None:
    stage = YawZero()
    stage.process(block_of([at]))
    stage.zero()
    before = block_of([at, later])
    after = stage.process(before)
    assert angles_deg(after)[0] == pytest.approx([at[0], at[1], 0.0], abs=1e-6)
    assert angle_between(*after.q) == pytest.approx(angle_between(*before.q), abs=1e-7)
    assert angles_deg(after)[:, :2] == pytest.approx(angles_deg(before)[:, :2], abs=1e-6)
    assert (after.q[:, 0] >= 0.0).all()
    assert np.linalg.norm(after.q, axis=1) == pytest.approx(1.0, abs=1e-12)
    # The square of the tilt's sigma about both axes together is the same from wherever it is seen.
    assert (after.sigma_rad[:, :2] ** 2).sum() == pytest.approx((before.sigma_rad[:, :2] ** 2).sum())


def test_a_quarter_turn_swaps_the_sigmas_about_x_and_y() -> None:
    stage = YawZero()
    stage.process(block_of([(0.0, 0.0, 90.0)]))
    stage.zero()
    after = stage.process(block_of([(0.0, 0.0, 90.0)]))
    assert after.sigma_rad[0, :2] == pytest.approx([0.02, 0.01])


def test_where_no_zero_was_asked_for_nothing_is_touched() -> None:
    block = block_of([(1.0, 2.0, 3.0)])
    assert YawZero().process(block) is block


@pytest.mark.parametrize(
    ("block", "why"),
    [
        (None, "no attitude yet"),
        (block_of([(0.0, 0.0, 5.0)], yaw_from=np.array([YawFrom.MAGNETIC], dtype=np.uint8)), "from magnetic north"),
        (block_of([(0.0, 0.0, 5.0)], yaw_from=np.array([YawFrom.TRUE], dtype=np.uint8)), "from true north"),
        (block_of([(0.0, 0.0, 5.0)], flags=np.array([Flag.BIAS_UNKNOWN], dtype=np.uint32)), "lie still"),
        (block_of([(0.0, -86.0, 5.0)]), "lay the board flatter"),
    ],
)
def test_what_cannot_be_set_to_zero_is_refused_with_the_reason(block: AttitudeBlock | None, why: str) -> None:
    stage = YawZero()
    if block is not None:
        stage.process(block)
    with pytest.raises(NotPossible, match=why):
        stage.zero()
    assert why in stage.refusal and not stage.is_set


@pytest.mark.parametrize("by", ["north", "a bias that is unknown again"])
def test_a_zero_is_dropped_where_the_yaw_it_is_of_ends(by: str) -> None:
    stage, rows = YawZero(), [(1.0, 2.0, 40.0)] * 4
    stage.process(block_of(rows))
    stage.zero()
    block = block_of(rows)
    if by == "north":
        block = replace(block, yaw_from=np.array([0, 0, 2, 2], dtype=np.uint8))
    else:
        block = replace(block, flags=np.array([0, 0, Flag.BIAS_UNKNOWN, 0], dtype=np.uint32))
    assert angles_deg(stage.process(block))[:, 2] == pytest.approx([0.0, 0.0, 40.0, 40.0])
    assert not stage.is_set and stage.state().before_rad == 0.0


def test_an_undone_zero_gives_the_old_yaw_with_both_sigmas_added_up() -> None:
    stage, rows = YawZero(), [(1.0, 2.0, 40.0)]
    with pytest.raises(NotPossible, match="no zero"):
        stage.undo()
    stage.process(block_of(rows))
    stage.zero()
    since = block_of(rows, sigma_rad=np.array([[0.01, 0.02, 0.1]]))
    stage.process(since)
    stage.undo()
    back = stage.process(since)
    assert angles_deg(back)[0, 2] == pytest.approx(40.0)
    assert back.sigma_rad[0].tolist() == pytest.approx([0.01, 0.02, 0.4])
    far = stage.process(block_of(rows, sigma_rad=np.array([[0.01, 0.02, 1.8]])))
    assert far.sigma_rad[0, 2] == YAW_MAX_RAD


def test_sigma_is_never_less_than_the_noise_of_one_sample() -> None:
    stage, rows = YawZero(), [(0.0, 0.0, 40.0)]
    stage.process(block_of(rows))
    stage.zero()
    after = stage.process(block_of(rows, sigma_rad=np.zeros((1, 3))))
    assert 0.0 < DEG_PER_RAD * after.sigma_rad[0, 2] < 0.01


class Run:
    """A fake chip on a motion, read by an `Imu`; what came since the last `take`, and the truth of it."""

    def __init__(
        self,
        motion: EulerMotion | Turntable,
        *,
        kind: Kind = "gated",
        seed: int = 1,
        imperfections: Imperfections = TYPICAL,
    ) -> None:
        self.clock, self.motion = VirtualClock(), motion
        chip = FakeMpu6050(self.clock, motion=motion, imperfections=imperfections, seed=seed)
        settings = Settings(filter=FilterParams(kind=kind))
        self.imu = Imu(FakeBus({0x68: chip}, clock=self.clock), settings=settings, clock=self.clock)

    def until(self, t_s: float) -> AttitudeBlock:
        blocks = []
        for _ in self.imu.loop.deadlines(round(t_s * NS_PER_S)):
            block = self.imu.read()
            assert block is not None
            if len(block):
                blocks.append(block)
        return concat(blocks)

    def azimuth_error_rad(self, block: AttitudeBlock) -> FloatArray:
        """By what the attitude is turned about the world's vertical against the truth."""
        off = multiply(block.q, conjugate(self.motion.attitude(block.t_ns / NS_PER_S)))
        error: FloatArray = 2.0 * np.arctan2(off[:, 3], off[:, 0])
        return np.remainder(error + np.pi, 2.0 * np.pi) - np.pi


class ThereAndBack(EulerMotion):
    """Still for 6 s, then two turns one way within 12 s, and from 20 s on the same back."""

    def euler_rad(self, t_s: FloatArray) -> tuple[FloatArray, FloatArray]:
        rate = 4.0 * np.pi / 12.0
        angles, rates = np.zeros((len(t_s), 3)), np.zeros((len(t_s), 3))
        angles[:, 2] = rate * (np.clip(t_s - 6.0, 0.0, 12.0) - np.clip(t_s - 20.0, 0.0, 12.0))
        rates[:, 2] = rate * (((t_s > 6.0) & (t_s < 18.0)) * 1.0 - ((t_s > 20.0) & (t_s < 32.0)))
        return angles, rates


@pytest.mark.parametrize("kind", KINDS)
def test_after_a_turn_is_taken_back_sigma_knows_of_the_scale_since_the_zero(kind: Kind) -> None:
    """As the root of a difference of squares it would be next to nothing: sigma before the zero was the larger one."""
    run = Run(ThereAndBack(), kind=kind)
    run.until(6.0)
    before = run.until(19.0)[-1:]
    run.imu.zero_yaw()
    first = run.until(19.5)
    assert abs(angles_deg(first)[0, 2]) < 0.1
    assert first.sigma_rad[0, 2] < 0.05 * before.sigma_rad[0, 2]
    last = run.until(33.0)[-1:]
    assert last.sigma_rad[0, 2] == pytest.approx(before.sigma_rad[0, 2], rel=0.35)
    run.imu.undo_zero_yaw()
    undone = run.until(33.5)[-1:]
    assert undone.sigma_rad[0, 2] > before.sigma_rad[0, 2]


def test_the_accelerometer_alone_knows_no_yaw_and_goes_on_saying_so() -> None:
    run = Run(Turntable(), kind="accelerometer")
    run.until(4.0)
    run.imu.zero_yaw()
    assert run.until(4.5).sigma_rad[-1, 2] == YAW_MAX_RAD


class Swaying(EulerMotion):
    """Still for 4 s, then turning to and fro about the vertical, and leaning meanwhile."""

    def euler_rad(self, t_s: FloatArray) -> tuple[FloatArray, FloatArray]:
        t = np.maximum(t_s - 4.0, 0.0)
        size, omega = np.radians([15.0, 10.0, 120.0]), np.array([1.3, 1.7, 0.35])
        ramp, slope = np.minimum(t / 2.0, 1.0)[:, None], np.where((t > 0.0) & (t < 2.0), 0.5, 0.0)[:, None]
        phase = omega * t[:, None]
        angles = ramp * size * np.sin(phase)
        return angles, ramp * size * omega * np.cos(phase) + slope * size * np.sin(phase)


def test_the_error_since_each_zero_is_within_two_sigma_nineteen_times_in_twenty() -> None:
    in_sigmas, sigmas_deg = [], []
    for seed in range(8):
        run = Run(Swaying(), seed=seed, imperfections=draw(seed))
        before_rad, zero_rad = run.azimuth_error_rad(run.until(6.0)[-1:]), 0.0
        for end_s in (8.5, 11.0, 14.0, 18.0):
            run.imu.zero_yaw()
            last = run.until(end_s)[-1:]
            # What the zero turned the world by is no error: it is taken off both.
            zero_rad = run.imu.stages.yaw_zero.state().zero_rad or 0.0
            error_rad = run.azimuth_error_rad(last) + zero_rad
            since = np.angle(np.exp(1j * (error_rad - before_rad)))
            in_sigmas.append(float(np.abs(since[0]) / last.sigma_rad[0, 2]))
            sigmas_deg.append(DEG_PER_RAD * last.sigma_rad[0, 2])
            before_rad = error_rad
    assert np.mean(np.array(in_sigmas) < 2.0) >= 0.93
    # Nor is it said to be worse than it is.
    assert np.sqrt(np.mean(np.square(in_sigmas))) > 0.4
    assert np.median(sigmas_deg) < 3.0
