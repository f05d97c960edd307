"""The gyroscope's bias over temperature, and its scale and misalignment from turns."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from simulated_boards import RATE_HZ, G, Script, face_attitude, samples_of

from hw_fakes.world.imperfections import NOISE_ONLY, Imperfections
from quavelet.calibration.gyro_bias import fit_gyro_bias
from quavelet.calibration.poses import StillPose, still_poses
from quavelet.calibration.turns import Turn, fit_turns, recognised, turn_between, turned_deg
from quavelet.core.blocks import Flag
from quavelet.core.errors import CalibrationError

NOISE_DPS = 0.006


def pose_at(temp_degc, bias_dps, *, k, force=(0.0, 0.0, G), rng=None) -> StillPose:
    noise = np.zeros(3) if rng is None else rng.normal(0.0, NOISE_DPS / np.sqrt(40), 3)
    return StillPose(
        begin_ns=k * 10 * 10**9, end_ns=(k + 1) * 10 * 10**9, duration_s=10.0, windows=40,
        gyro_rad_s=tuple(np.radians(np.asarray(bias_dps) + noise).tolist()), accel_m_s2=force,
        gyro_noise2=(39 * np.radians(NOISE_DPS) ** 2,) * 3, accel_noise2=(1e-4,) * 3, temp_degc=temp_degc,
    )  # fmt: skip


def warming(bias_of, *, n=60, low=20.0, high=40.0, seed=0) -> list[StillPose]:
    rng = np.random.default_rng(seed)
    temps = high - (high - low) * np.exp(-np.linspace(0.0, 3.0, n))
    return [pose_at(float(t), bias_of(t), k=k, rng=rng) for k, t in enumerate(temps)]


def test_a_straight_bias_is_called_straight_and_found():
    fit = fit_gyro_bias(warming(lambda t: [3.0 + 0.02 * t, -1.0, 0.5 - 0.03 * t]))
    assert fit.degree == 1
    curve = fit.curve()
    assert curve.is_known
    temps = np.array([22.0, 30.0, 38.0])
    truth = np.column_stack([3.0 + 0.02 * temps, np.full(3, -1.0), 0.5 - 0.03 * temps])
    assert np.abs(np.degrees(curve.at(temps)) - truth).max() < 0.01


def test_a_bent_bias_is_called_bent_by_the_evidence():
    fit = fit_gyro_bias(warming(lambda t: [0.004 * (t - 30.0) ** 2, 0.0, 0.1]))
    assert fit.degree == 2
    assert fit.evidence[0] > 10.0
    assert np.degrees(fit.curve().at(np.array([30.0]))[0, 0]) == pytest.approx(0.0, abs=0.02)


def test_beyond_the_temperatures_seen_nothing_is_claimed():
    poses = warming(lambda t: [0.02 * t, 0.0, 0.0], low=25.0, high=26.0)
    fit = fit_gyro_bias(poses)
    assert not fit.curve().is_known
    assert fit.sigma_at(45.0) > 1.5 * fit.sigma_at(25.5)
    assert fit.curve().at(np.array([45.0])).tolist() == fit.curve().at(np.array([fit.highest_degc])).tolist()


def test_what_force_does_is_found_where_the_board_lay_on_all_faces_and_else_left_open():
    rng = np.random.default_rng(3)
    per_g = np.array([[0.05, -0.02, 0.01], [0.0, 0.04, 0.03], [-0.05, 0.0, -0.02]])
    ups = [*np.eye(3), *-np.eye(3)] * 2
    poses = [
        pose_at(30.0 + 0.01 * k, np.array([1.0, 2.0, -3.0]) + per_g @ up, k=k, force=tuple((G * up).tolist()), rng=rng)
        for k, up in enumerate(ups)
    ]
    fit = fit_gyro_bias(poses)
    assert np.degrees(np.array(fit.per_force) * G) == pytest.approx(per_g, abs=0.008)
    assert np.degrees(fit.coefficients_rad_s[0]) == pytest.approx([1.0, 2.0, -3.0], abs=0.008)
    alone = fit_gyro_bias(poses[2:3])
    assert np.degrees(alone.sigma_at(30.0)) > 0.05


def test_no_pose_is_refused():
    with pytest.raises(CalibrationError, match="no still pose"):
        fit_gyro_bias([])


GYRO = Imperfections(
    gyro_scale=(1.02, 0.985, 1.01),
    gyro_cross_axis=((0.0, 0.01, -0.005), (0.015, 0.0, 0.008), (-0.01, 0.004, 0.0)),
    gyro_noise_rad_s_rthz=NOISE_ONLY.gyro_noise_rad_s_rthz,
    accel_noise_m_s2_rthz=NOISE_ONLY.accel_noise_m_s2_rthz,
)


def turned(degrees, *, axes=(0, 1, 2), board=GYRO, bias_dps=(0.0, 0.0, 0.0)) -> list[Turn]:
    """Turns by these angles about each of the axes, put upright."""
    turns = []
    for axis in axes:
        rng = np.random.default_rng(axis)
        script = Script(rng, face_attitude("+" + "xyz"[axis], 0.3), [], [])
        script.rest(2.5)
        for angle in degrees:
            script.turn(np.radians(angle) * np.eye(3)[axis], max(2.0, abs(angle) / 90.0))
            script.rest(2.5)
        block = samples_of(board, script, rng)
        poses = still_poses(block)
        assert len(poses) == len(degrees) + 1
        for angle, before, after in zip(degrees, poses, poses[1:], strict=False):
            turn = turn_between(block, before, after, bias_rad_s=-np.radians(bias_dps))
            turns.append(replace(turn, axis=axis, angle_rad=float(np.radians(angle))))
    return turns


def left_over(fit) -> np.ndarray:
    return np.array(fit.matrix) @ (np.diag(GYRO.gyro_scale) + np.array(GYRO.gyro_cross_axis)) - np.eye(3)


def test_whole_and_half_turns_about_each_axis_show_scale_and_misalignment():
    fit = fit_turns(turned([360.0, -360.0, 180.0, -180.0]), bias_sigma_rad_s=np.radians(0.02))
    assert fit.undetermined == ()
    assert np.abs(left_over(fit)).max() < 0.0015
    assert np.abs(fit.residual_deg[list(fit.used)]).max() < 0.5


def test_whole_turns_alone_do_not_show_misalignment_and_it_is_named():
    fit = fit_turns(turned([360.0, -360.0]), bias_sigma_rad_s=np.radians(0.02))
    assert not any(name.startswith("scale") for name in fit.undetermined)
    assert all(f"misalignment {a}{b}" in fit.undetermined for a in "xyz" for b in "xyz" if a != b)
    assert np.abs(np.diag(left_over(fit))).max() < 0.0015


def test_an_axis_that_was_not_turned_is_named():
    fit = fit_turns(turned([360.0, -360.0], axes=(0, 2)), bias_sigma_rad_s=np.radians(0.02))
    assert "scale y" in fit.undetermined
    assert fit.matrix[1][1] == pytest.approx(1.0, abs=0.01)


def test_turns_both_ways_cancel_a_bias_that_was_left():
    bias_dps = (0.15, -0.1, 0.12)
    turns = turned([360.0, -360.0, 180.0, -180.0], bias_dps=bias_dps)
    fit = fit_turns(turns, bias_sigma_rad_s=np.radians(0.2))
    assert np.degrees(fit.bias_rad_s) == pytest.approx(bias_dps, abs=0.03)
    assert np.abs(np.diag(left_over(fit))).max() < 0.002


def test_a_turn_that_was_not_by_the_angle_asked_for_is_thrown_out():
    turns = turned([360.0, -360.0, 180.0, -180.0])
    turns[4] = replace(turns[4], angle_rad=float(np.radians(345.0)))
    fit = fit_turns(turns, bias_sigma_rad_s=np.radians(0.02))
    assert 4 not in fit.used
    assert np.abs(left_over(fit)).max() < 0.0015


def test_the_angle_and_the_axis_of_a_turn_are_recognised():
    for angle, turn in zip(
        [360.0, -360.0, 90.0, -180.0], turned([360.0, -360.0, 90.0, -180.0], axes=(1,)), strict=True
    ):
        found = recognised(turn)
        assert found is not None
        assert (found[0], np.degrees(found[1])) == (1, pytest.approx(angle))
        assert turned_deg(turn)[1] == pytest.approx(angle, abs=0.03 * abs(angle))
    assert recognised(turned([37.0], axes=(2,))[0]) is None


def test_lost_samples_within_a_turn_are_refused():
    rng = np.random.default_rng(0)
    script = Script(rng, face_attitude("+z", 0.0), [], [])
    script.rest(2.5)
    script.turn(np.array([0.0, 0.0, np.pi]), 2.0)
    script.rest(2.5)
    block = samples_of(GYRO, script, rng)
    before, after = still_poses(block)
    block.flags[round(3.5 * RATE_HZ)] |= Flag.GAP
    with pytest.raises(CalibrationError, match="turn again"):
        turn_between(block, before, after, bias_rad_s=np.zeros(3))
