"""Starting on boards drawn from the data sheet's limits: lying still, and already moving."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from session import run_session

from hw_fakes import FakeBus, FakeMpu6050, Still, Sway, Tilt
from hw_fakes.world.imperfections import NO_MATRIX, draw
from quavelet.core.blocks import Flag
from quavelet.core.clock import VirtualClock
from quavelet.core.euler import to_euler
from quavelet.settings import Settings

BOARDS = range(12)


def session(motion, seed: int, seconds: float, *, calibrated_accelerometer: bool = False):
    clock = VirtualClock()
    sensor = draw(seed)
    if calibrated_accelerometer:
        sensor = replace(
            sensor,
            accel_bias_m_s2=(0.0, 0.0, 0.0),
            accel_scale=(1.0, 1.0, 1.0),
            accel_cross_axis=NO_MATRIX,
            accel_nonlinearity=(0.0, 0.0, 0.0),
        )
    chip = FakeMpu6050(clock, motion=motion, imperfections=sensor, pll_error=0.01 * (-1) ** seed, seed=seed)
    return run_session(FakeBus({0x68: chip}, clock=clock, name="fake:drawn"), clock, Settings(), seconds=seconds)


@pytest.mark.parametrize("seed", BOARDS)
def test_a_start_while_moving_is_flagged_until_it_is_right_and_right_within_ten_seconds(seed, capsys):
    run = session(Sway(), seed, 30.0, calibrated_accelerometer=True)
    error_deg, seconds = run.tilt_error_deg(), (run.attitude.t_ns - run.attitude.t_ns[0]) / 1e9
    trusted = (run.attitude.flags & Flag.SETTLING) == 0
    with capsys.disabled():
        print(
            f"\nboard {seed}: trusted after {seconds[trusted][0]:.1f} s, worst since {error_deg[trusted].max():.2f} deg"
        )
    assert error_deg[trusted].max() < 5.0
    assert error_deg[seconds > 10.0].max() < 5.0
    assert trusted[seconds > 10.0].all()
    assert ((run.attitude.flags & Flag.BIAS_UNKNOWN) != 0).all(), "no bias can be known of a board that never rests"


def test_the_stated_sigma_covers_the_tilt_of_drawn_boards_at_rest(capsys):
    """Zero-g offset and scale are drawn from the data sheet's limits: that is what sigma must own up to."""
    ratios = []
    for seed in range(40):
        rng = np.random.default_rng(seed)
        roll_deg, pitch_deg = rng.uniform([-180.0, -80.0], [180.0, 80.0])
        run = session(Still(roll_deg=roll_deg, pitch_deg=pitch_deg), seed, 4.0)
        ratios.append(np.radians(run.tilt_error_deg()[-1]) / run.attitude.sigma_rad[-1, 0])
    # Two axes of one sigma each: the length is within 2.45 sigma for 95 % of normal errors.
    within = np.mean(np.array(ratios) < 2.45)
    with capsys.disabled():
        print(
            f"\ntilt at rest: {100 * within:.0f} % of 40 drawn boards within 2.45 sigma, median {np.median(ratios):.2f}"
        )
    assert within >= 0.9
    assert np.median(ratios) > 0.4, "a sigma that is never reached says nothing either"


@pytest.mark.parametrize("seed", range(4))
def test_yaw_without_reference_stays_within_three_of_its_sigmas(seed):
    run = session(Tilt(), seed, 60.0)
    known = (run.attitude.flags & Flag.BIAS_UNKNOWN) == 0
    turn = run.chip.motion.attitude(run.world_s())
    yaw = np.unwrap(to_euler(run.attitude.q)[:, 2])[known] - np.unwrap(to_euler(turn)[:, 2])[known]
    level = (np.abs(to_euler(turn)[:, :2]) < 0.01).all(axis=1)[known]
    error, sigma = (yaw - yaw[0])[level], run.attitude.sigma_rad[known, 2][level]
    assert level.sum() > 100
    assert (np.abs(error) <= 3.0 * sigma + np.radians(0.1)).all(), np.degrees([error, sigma])
