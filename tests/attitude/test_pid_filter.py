"""The filter as a stage: gaps, heading, settling, and what it says of its own doubt."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from imu_blocks import imu_block, level, with_gap

from quavelet.attitude.doubt import YAW_MAX_RAD, Residual
from quavelet.attitude.kernel import up_in_body
from quavelet.attitude.pid import PidFilter, PidParams
from quavelet.core.blocks import Flag
from quavelet.core.errors import SettingsError
from quavelet.core.euler import to_euler
from quavelet.core.quaternion import inclination_between

G = 9.80665
RESIDUAL = Residual(tilt_rad=0.001, gyro_bias_rad_s=np.radians(0.01), gyro_bias_rad_s_degc=0.0, gyro_scale=0.0)
PLAIN = PidParams(kp=1.0, ki=0.0)


def turned(rate_rad_s: float, n: int, period_s: float = 0.01) -> tuple[np.ndarray, np.ndarray]:
    """Rates and forces of a board that rolls steadily about x."""
    angle = rate_rad_s * period_s * np.arange(1, n + 1)
    forces = G * np.column_stack([np.zeros(n), np.sin(angle), np.cos(angle)])
    return np.tile([rate_rad_s, 0.0, 0.0], (n, 1)), forces


def test_gravity_never_steers_heading():
    """A board pushed sideways for a minute, rate zero: tilt is drawn off, yaw must not be."""
    forces = level(6000) + [3.0, 2.0, 0.0]
    out = PidFilter(PidParams(kp=1.0, ki=0.1, kd=0.5), residual=RESIDUAL).process(
        imu_block(np.zeros((6000, 3)), forces)
    )
    turn = np.cumsum((out.gyro_rad_s * [0.0, 0.0, 1.0]).sum(axis=1)) * 0.01
    assert np.abs(np.degrees(to_euler(out.q)[:, 2])).max() < 1e-6 + np.degrees(np.abs(turn).max())


def test_a_whole_turn_comes_out_whole():
    rates, forces = np.tile([0.0, 0.0, np.radians(30.0)], (1200, 1)), level(1200)
    out = PidFilter(PLAIN, residual=RESIDUAL).process(imu_block(rates, forces))
    yaw = np.degrees(np.unwrap(to_euler(out.q)[:, 2]))
    # The first sample has nothing before it to turn from.
    assert yaw[-1] == pytest.approx(30.0 * 11.99, abs=1e-6)


def test_a_steady_roll_is_followed_through_all_attitudes():
    rates, forces = turned(np.radians(50.0), 3000)
    out = PidFilter(PLAIN, residual=RESIDUAL).process(imu_block(rates, forces))
    angle = np.radians(50.0) * 0.01 * np.arange(1, 3001)
    truth = np.column_stack([np.cos(angle / 2), np.sin(angle / 2), 0 * angle, 0 * angle])
    # One period of lead at 50 deg/s and 100 Hz is half a degree.
    assert np.degrees(inclination_between(truth, out.q))[300:].max() < 0.6


def test_a_gap_is_bridged_at_the_rate_before_and_after_it():
    rates, forces = np.tile([0.0, 0.0, np.radians(30.0)], (1200, 1)), level(1200)
    out = PidFilter(PLAIN, residual=RESIDUAL).process(with_gap(imu_block(rates, forces), 400, 450))
    assert np.degrees(np.unwrap(to_euler(out.q)[:, 2]))[-1] == pytest.approx(30.0 * 11.99, abs=1e-6)
    assert not (out.flags[1000:] & Flag.SETTLING).any()


def test_a_rate_held_through_an_outage_turns_the_board_over():
    """Five seconds at 90 deg/s are more than a turn; gravity at the end says how the board stands, yaw is doubted."""
    n = 2000
    rates, forces = np.zeros((n, 3)), np.zeros((n, 3))
    rates[:600, 0] = np.radians(90.0)
    angle = np.cumsum(rates[:, 0]) * 0.01
    forces[:, 1], forces[:, 2] = np.sin(angle) * 9.81, np.cos(angle) * 9.81
    rates[1100:, 0] = 0.0
    out = PidFilter(PLAIN, residual=RESIDUAL).process(with_gap(imu_block(rates, forces), 590, 1100))
    up = np.array([up_in_body(tuple(q)) for q in out.q[590:].tolist()])
    measured = forces[1100:] / np.linalg.norm(forces[1100:], axis=1)[:, None]
    assert np.degrees(np.arccos(np.clip((up * measured).sum(1), -1, 1))).max() < 2.0
    assert np.degrees(out.sigma_rad[-1, 2]) > 90.0


def test_a_gap_with_a_change_of_rate_makes_yaw_less_sure_for_good_and_tilt_for_a_while():
    rates, forces = turned(np.radians(30.0), 2000)
    rates[500:, 0], forces[500:] = 0.0, forces[500]
    whole = imu_block(rates, forces)
    smooth = PidFilter(PLAIN, residual=RESIDUAL).process(whole)
    out = PidFilter(PLAIN, residual=RESIDUAL).process(with_gap(whole, 480, 520))
    assert out.sigma_rad[480, 0] > 3 * smooth.sigma_rad[479, 0]
    assert out.sigma_rad[480, 2] > smooth.sigma_rad[520, 2] + np.radians(2.0)
    assert out.sigma_rad[-1, 2] > smooth.sigma_rad[-1, 2] + np.radians(2.0)
    assert out.sigma_rad[-1, 0] < 1.5 * smooth.sigma_rad[-1, 0]


def test_after_a_long_gap_the_attitude_is_doubted_and_then_found_again_within_two_seconds():
    n = 3000
    forces = level(n)
    forces[1000:] = G * np.array([0.0, np.sin(0.5), np.cos(0.5)])  # turned by 29 deg while nobody looked
    out = PidFilter(PLAIN, residual=RESIDUAL).process(with_gap(imu_block(np.zeros((n, 3)), forces), 700, 1000))
    assert (out.flags[700:800] & Flag.SETTLING).all()
    roll = np.degrees(to_euler(out.q)[:, 0])
    assert abs(roll[900] - np.degrees(0.5)) < 1.0
    assert not out.flags[-1] & Flag.SETTLING


@given(bias=st.tuples(*[st.floats(-20.0, 20.0)] * 2))
def test_a_start_while_moving_finds_the_tilt_whatever_the_bias(bias):
    """The data sheet's whole range of zero-rate output, on axes that gravity sees."""
    n = 1000
    rates = np.tile([*np.radians(bias), 0.0], (n, 1))
    out = PidFilter(PidParams(), residual=RESIDUAL).process(imu_block(rates, level(n), flags=Flag.BIAS_UNKNOWN))
    tilt = np.degrees(inclination_between(np.array([1.0, 0.0, 0.0, 0.0]), out.q))
    trusted = (out.flags & Flag.SETTLING) == 0
    assert trusted[-1]
    assert tilt[trusted].max() < 5.0
    assert np.allclose(out.gyro_bias_rad_s[-1, :2], np.radians(bias), atol=np.radians(0.5))


def test_with_the_bias_unknown_yaw_is_soon_known_to_be_unknown():
    out = PidFilter(PidParams(), residual=RESIDUAL).process(
        imu_block(np.zeros((2000, 3)), level(2000), flags=Flag.BIAS_UNKNOWN)
    )
    assert out.sigma_rad[-1, 2] == pytest.approx(YAW_MAX_RAD)


def test_a_board_that_lies_still_with_an_unknown_bias_does_not_turn():
    rng = np.random.default_rng(3)
    forces = rng.normal([0.0, 0.17 * G, 0.985 * G], 0.003 * G, (200, 3))
    out = PidFilter(PidParams(), residual=RESIDUAL).process(
        imu_block(np.tile(np.radians([15.0, -8.0, 20.0]), (200, 1)), forces, flags=Flag.BIAS_UNKNOWN, still=True)
    )
    mean = forces.mean(axis=0)
    assert np.degrees(to_euler(out.q[-1]))[0] == pytest.approx(np.degrees(np.arctan2(mean[1], mean[2])), abs=0.02)
    assert np.abs(to_euler(out.q)[:, 2]).max() < 1e-9


def test_free_fall_leaves_the_attitude_to_the_rate():
    rates = np.tile([0.0, np.radians(10.0), 0.0], (300, 1))
    forces = np.vstack([level(1), np.zeros((299, 3))])
    out = PidFilter(PLAIN, residual=RESIDUAL).process(imu_block(rates, forces))
    assert np.isfinite(out.q).all()
    assert np.degrees(to_euler(out.q[-1]))[1] == pytest.approx(29.9, abs=1e-6)


@given(seed=st.integers(0, 10**6))
def test_the_quaternion_is_of_unit_length_and_one_sign(seed):
    rng = np.random.default_rng(seed)
    out = PidFilter(PidParams(ki=0.5, kd=0.5), residual=RESIDUAL).process(
        imu_block(rng.normal(0.0, 3.0, (200, 3)), rng.normal(0.0, 8.0, (200, 3)))
    )
    assert np.allclose(np.linalg.norm(out.q, axis=1), 1.0, atol=1e-12)
    assert (out.q[:, 0] >= 0.0).all()


@pytest.mark.parametrize("bad", [{"kp": -1.0}, {"ki": float("nan")}, {"kd": 1e9}, {"kd_tau_s": 0.0}])
def test_a_gain_that_is_none_is_refused(bad):
    with pytest.raises(SettingsError, match=next(iter(bad))):
        PidParams(**bad)
