"""A motion that changes while it runs: no jump of the attitude, and one truth throughout."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from hw_fakes import Still, Sway, Tilt, Turntable
from hw_fakes.world.motion_bench import SixFaces
from hw_fakes.world.motion_carried import Walk
from hw_fakes.world.motion_switched import SwitchedMotion
from quavelet.core.units import STANDARD_GRAVITY_M_S2

CHAINS = {
    "still to sway": (Still(roll_deg=20, yaw_deg=100), [(3.3, Sway())]),
    "sway to walk": (Sway(), [(4.1, Walk(start_s=1))]),
    "upside down": (Still(), [(2.0, Still(roll_deg=180)), (6.0, Still(pitch_deg=89))]),
    "to the same": (Tilt(), [(1.0, Tilt())]),
    "again within a turn": (Sway(), [(2.0, Turntable(start_s=0)), (2.7, SixFaces()), (2.7, Tilt()), (9.0, Sway())]),
}


def rotation(q):
    return Rotation.from_quat(np.roll(q, -1, axis=-1))


def chain(first, switches):
    motion = SwitchedMotion(first)
    for at_s, to in switches:
        motion.switch(to, at_s)
    return motion


def seams(switches):
    return np.array([s for at_s, _ in switches for s in (at_s, at_s + 1.5)])


@pytest.mark.parametrize(("first", "switches"), CHAINS.values(), ids=CHAINS)
def test_attitude_jumps(first, switches):
    motion, h = chain(first, switches), 1e-4
    t_s = np.concatenate([np.arange(0, 20, 0.01), seams(switches) - h / 2])
    moved = (rotation(motion.attitude(t_s)).inv() * rotation(motion.attitude(t_s + h))).magnitude()
    assert moved.max() < 6.5 * h, "faster than any of these motions"


@pytest.mark.parametrize(("first", "switches"), CHAINS.values(), ids=CHAINS)
def test_rate_is_not_the_derivative_of_the_attitude(first, switches):
    motion, h = chain(first, switches), 1e-4
    t_s = np.random.default_rng(1).uniform(0, 20, 3000)
    t_s = t_s[np.abs(t_s[:, None] - seams(switches)).min(1) > 2 * h]
    turned = rotation(motion.attitude(t_s - h)).inv() * rotation(motion.attitude(t_s + h))
    assert np.allclose(turned.as_rotvec() / (2 * h), motion.rate_rad_s(t_s), atol=2e-5)


@pytest.mark.parametrize(("first", "switches"), CHAINS.values(), ids=CHAINS)
def test_force_or_field_is_of_another_attitude(first, switches):
    motion, t_s = chain(first, switches), np.arange(0, 20, 0.003)
    attitude = rotation(motion.attitude(t_s))
    assert np.allclose(attitude.apply(motion.magnetic_field_ut(t_s)), first.earth_field.world_ut)
    turning = np.any([(t_s >= at_s) & (t_s < at_s + 1.5) for at_s, _ in switches], axis=0)
    up = attitude[turning].apply(motion.specific_force_m_s2(t_s[turning]))
    assert np.allclose(up, [0, 0, STANDARD_GRAVITY_M_S2])


def test_the_next_motion_begins_in_the_middle():
    motion = chain(Sway(), [(4.1, Walk(start_s=1))])
    t_s = np.arange(0, 20, 0.01)
    for ask in ("attitude", "rate_rad_s", "specific_force_m_s2", "magnetic_field_ut"):
        before, after = t_s < 4.1, t_s >= 5.6
        assert np.array_equal(getattr(motion, ask)(t_s)[before], getattr(Sway(), ask)(t_s[before]))
        assert np.allclose(getattr(motion, ask)(t_s)[after], getattr(Walk(start_s=1), ask)(t_s[after] - 5.6))
    assert motion.present == Walk(start_s=1)


def test_a_turn_takes_the_long_way_or_another_time():
    motion = SwitchedMotion(Still(roll_deg=-10), turn_s=2)
    motion.switch(Still(roll_deg=80), at_s=5)
    t_s = np.linspace(4.9, 7.1, 500)
    rate = motion.rate_rad_s(t_s)
    assert np.allclose(rate[:, 1:], 0)
    assert np.array_equal(rate[:, 0] != 0, (t_s > 5) & (t_s < 7))
    assert rate[:, 0].sum() * (t_s[1] - t_s[0]) == pytest.approx(np.pi / 2, rel=1e-4)


def test_a_turn_goes_the_long_way_round():
    motion = chain(Still(yaw_deg=-170), [(0.0, Still(yaw_deg=170))])
    t_s = np.linspace(0, 1.5, 300)
    assert np.degrees(motion.rate_rad_s(t_s)[:, 2]).min() == pytest.approx(-20 / 1.5 * 1.875, rel=1e-3)
    assert np.degrees(motion.rate_rad_s(t_s)[:, 2]).max() == pytest.approx(0, abs=1e-9)


def test_a_motion_left_within_the_turn_comes_after_all():
    motion = chain(Still(), [(2.0, Sway()), (2.7, Tilt())])
    t_s = np.arange(4.2, 30, 0.01)
    assert np.allclose(motion.attitude(t_s), Tilt().attitude(t_s - 4.2))
    motion = chain(Still(), [(float(at_s), to) for at_s, to in enumerate([Sway(), Walk(), Sway(), Walk(), Tilt()])])
    assert np.allclose(motion.attitude(t_s + 1.3), Tilt().attitude(t_s - 4.2))


@pytest.mark.parametrize(("first", "switches"), CHAINS.values(), ids=CHAINS)
def test_a_moment_asked_for_alone_has_another_attitude(first, switches):
    motion, t_s = chain(first, switches), np.random.default_rng(4).uniform(0, 12, 500)
    alone = np.concatenate([motion.attitude(np.array([t])) for t in t_s])
    assert np.allclose(alone, motion.attitude(t_s))
    in_order = np.argsort(t_s)
    assert np.allclose(alone[in_order], motion.attitude(t_s[in_order]))


def test_a_switch_rewrites_the_past():
    motion = SwitchedMotion(Still())
    motion.switch(Tilt(), at_s=5)
    with pytest.raises(ValueError, match="before the last switch at 5 s"):
        motion.switch(Sway(), at_s=4.9)
    with pytest.raises(ValueError, match="turn_s"):
        SwitchedMotion(Still(), turn_s=0)


def test_a_chip_goes_on_with_the_old_motion(make_board):
    motion = SwitchedMotion(Still())
    board = make_board(motion=motion)
    board.wake(div=0)
    board.start_fifo()
    before = board.collect(1)
    motion.switch(Still(roll_deg=90), board.chip.world_time_s(board.clock.now_ns()))
    board.chip.recompute()
    turning = board.collect(1.7)
    assert (np.abs(before[:, 1]) < 10).all()
    assert turning[-1, 1] == pytest.approx(16384, abs=10)
    assert turning[:, 4].sum() / 131 / 1000 == pytest.approx(90, abs=0.5)
    assert np.abs(np.diff(turning[:, 1].astype(int))).max() < 60
