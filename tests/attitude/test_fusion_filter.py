"""The fusion filters as stages: start, gaps, heading, clipping, recovery, and what they say of their own doubt."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from fusion_blocks import RESIDUAL, G, swaying
from hypothesis import given, settings
from hypothesis import strategies as st
from imu_blocks import imu_block, level, with_gap

from quavelet.attitude.doubt import YAW_MAX_RAD
from quavelet.attitude.fusion import FusionFilter
from quavelet.attitude.fusion_literal import LiteralFusionFilter, LiteralParams
from quavelet.attitude.fusion_params import FusionParams
from quavelet.attitude.params import FilterParams
from quavelet.attitude.pid import PidFilter, PidParams
from quavelet.core.blocks import Flag
from quavelet.core.errors import SettingsError
from quavelet.core.euler import to_euler
from quavelet.core.quaternion import inclination_between

PLAIN = replace(RESIDUAL, tilt_rad=0.0)


def fusion(**params) -> FusionFilter:
    return FusionFilter(FusionParams(**params), residual=RESIDUAL)


FILTERS = {
    "velocity": fusion,
    "gravity": lambda: fusion(model="gravity"),
    "literal": lambda: LiteralFusionFilter(LiteralParams(), residual=RESIDUAL),
}
STABLE = {name: FILTERS[name] for name in ("velocity", "gravity")}
every = pytest.mark.parametrize("make", FILTERS.values(), ids=FILTERS)
stable = pytest.mark.parametrize("make", STABLE.values(), ids=STABLE)


def tilt_deg(out, truth) -> np.ndarray:
    return np.degrees(inclination_between(np.asarray(truth), out.q))


@every
def test_a_whole_turn_comes_out_whole(make):
    out = make().process(imu_block(np.tile([0.0, 0.0, np.radians(30.0)], (1200, 1)), level(1200)))
    # The first sample has nothing before it to turn from; the literal form's Euler step is its own.
    assert np.degrees(np.unwrap(to_euler(out.q)[:, 2]))[-1] == pytest.approx(30.0 * 11.99, abs=1e-2)


@stable
def test_gravity_never_steers_heading(make):
    """A board pushed sideways for a minute: what the tilt is pulled by must not turn yaw about the vertical."""
    rng = np.random.default_rng(1)
    out = make().process(
        imu_block(np.zeros((3000, 3)), level(3000) + rng.normal(0.0, 1.0, (3000, 3)) + [1.0, 0.7, 0.0])
    )
    moved = np.cumsum((out.gyro_rad_s * [0.0, 0.0, 1.0]).sum(axis=1)) * 0.01
    assert np.abs(to_euler(out.q)[:, 2]).max() < np.abs(moved).max() + 0.02


@stable
@pytest.mark.parametrize("period_s", [0.004, 0.02])
def test_a_swaying_board_is_followed_and_its_bias_learned_at_any_rate(make, period_s):
    """No default rate hides anywhere: densities make the gains fit the period."""
    bias = (0.6, -0.4, 0.3)
    rates, forces, truth = swaying(2, round(40 / period_s), period_s=period_s, bias=bias)
    out = make().process(imu_block(rates, forces, period_s=period_s, flags=Flag.BIAS_UNKNOWN))
    late = slice(len(truth) // 2, None)
    assert tilt_deg(out, truth)[late].max() < 0.5
    assert np.allclose(np.degrees(out.gyro_bias_rad_s[-1]), bias, atol=0.15)
    assert not (out.flags[late] & Flag.SETTLING).any()


def test_a_hand_that_pushes_the_board_about_tilts_it_less_than_it_tilts_the_pid():
    rates, forces, truth = swaying(3, 6000, hand_m_s=0.3)
    data = imu_block(rates, forces)
    by_name = {name: tilt_deg(make().process(data), truth)[1000:] for name, make in STABLE.items()}
    pid = tilt_deg(PidFilter(PidParams(), residual=RESIDUAL).process(data), truth)[1000:]
    assert by_name["velocity"].std() < pid.std() / 2
    assert np.sqrt((by_name["velocity"] ** 2).mean()) < 0.7 * np.sqrt((by_name["gravity"] ** 2).mean())


@stable
@given(bias=st.tuples(*[st.floats(-20.0, 20.0)] * 2))
@settings(max_examples=15, deadline=None)
def test_a_start_while_moving_finds_the_tilt_whatever_the_bias(make, bias):
    """The data sheet's whole range of zero-rate output, on axes that gravity sees."""
    out = make().process(imu_block(np.tile([*np.radians(bias), 0.0], (1000, 1)), level(1000), flags=Flag.BIAS_UNKNOWN))
    tilt = tilt_deg(out, [1.0, 0.0, 0.0, 0.0])
    trusted = (out.flags & Flag.SETTLING) == 0
    assert trusted[-1]
    assert tilt[trusted].max() < 5.0
    assert np.allclose(out.gyro_bias_rad_s[-1, :2], np.radians(bias), atol=np.radians(0.5))


def test_a_board_that_lies_still_with_an_unknown_bias_does_not_turn():
    rng = np.random.default_rng(3)
    forces = rng.normal([0.0, 0.17 * G, 0.985 * G], 0.003 * G, (200, 3))
    rates = np.tile(np.radians([15.0, -8.0, 20.0]), (200, 1))
    out = fusion().process(imu_block(rates, forces, flags=Flag.BIAS_UNKNOWN, still=True))
    mean = forces.mean(axis=0)
    assert np.degrees(to_euler(out.q[-1]))[0] == pytest.approx(np.degrees(np.arctan2(mean[1], mean[2])), abs=0.02)
    assert np.abs(to_euler(out.q)[:, 2]).max() < 1e-9
    assert not out.flags[-1] & Flag.SETTLING


def test_a_bias_that_becomes_known_replaces_what_was_learned_and_yaw_counts_from_there():
    n = 1000
    rates = np.tile(np.radians([3.0, -2.0, 1.0]), (n, 1))
    data = imu_block(rates, level(n), flags=Flag.BIAS_UNKNOWN)
    data.flags[600:] = 0
    data.gyro_bias_rad_s[600:] = rates[0]
    data.gyro_rad_s[600:] = 0.0
    out = fusion().process(data)
    assert out.sigma_rad[599, 2] > np.radians(60.0)
    assert out.sigma_rad[600, 2] < np.radians(1.0)
    assert np.abs(to_euler(out.q)[600:, 2] - to_euler(out.q)[600, 2]).max() < np.radians(0.1)


@stable
def test_a_bias_followed_further_at_rest_leaves_the_sum_where_it_was(make):
    """The stage before takes 0.02 deg/s more off from row 300 on: the filter's own share becomes that much less."""
    data = imu_block(np.zeros((600, 3)), level(600))
    data.gyro_bias_rad_s[300:] += np.radians(0.02)
    data.gyro_rad_s[300:] -= np.radians(0.02)
    out = make().process(data)
    assert np.abs(np.diff(out.gyro_bias_rad_s, axis=0)).max() < np.radians(1e-3)


@every
def test_a_gap_is_bridged_at_the_rate_before_and_after_it(make):
    rates, forces = np.tile([0.0, 0.0, np.radians(30.0)], (1200, 1)), level(1200)
    out = make().process(with_gap(imu_block(rates, forces), 400, 420))
    assert np.degrees(np.unwrap(to_euler(out.q)[:, 2]))[-1] == pytest.approx(30.0 * 11.99, abs=1e-2)
    assert not (out.flags[1000:] & Flag.SETTLING).any()


@every
def test_after_a_long_gap_the_tilt_is_the_accelerometers_and_is_doubted_until_it_is_sure(make):
    n = 3000
    forces = level(n)
    forces[1000:] = G * np.array([0.0, np.sin(0.5), np.cos(0.5)])  # turned by 29 deg while nobody looked
    out = make().process(with_gap(imu_block(np.zeros((n, 3)), forces), 700, 1000))
    assert out.sigma_rad[700, 0] > np.radians(1.0)
    assert np.abs(np.degrees(to_euler(out.q)[700:, 0] - 0.5)).max() < 0.5
    assert not out.flags[-1] & Flag.SETTLING


@stable
def test_a_gap_with_a_change_of_rate_makes_yaw_less_sure_for_good_and_tilt_for_a_while(make):
    n = 2000
    rates, forces = np.zeros((n, 3)), level(n)
    rates[:500, 2] = np.radians(60.0)
    whole = imu_block(rates, forces)
    smooth, out = make().process(whole), make().process(with_gap(whole, 480, 500))
    assert out.sigma_rad[480, 0] > 3 * smooth.sigma_rad[479, 0]
    assert out.sigma_rad[-1, 2] > smooth.sigma_rad[-1, 2] + np.radians(2.0)
    assert out.sigma_rad[-1, 0] < 1.5 * smooth.sigma_rad[-1, 0]


@every
def test_while_the_chip_is_stuck_the_attitude_stands_and_is_not_trusted(make):
    rates, forces, _ = swaying(5, 1000)
    data = imu_block(rates, forces)
    data.flags[400:600] |= np.uint32(Flag.STUCK)
    out = make().process(data)
    assert (out.q[400:600] == out.q[399]).all()
    assert (out.flags[400:600] & Flag.SETTLING).all()


def test_a_clipped_blow_says_less_than_a_whole_one():
    """The missing peak would leave a velocity that never was: with the flag the board is not tilted for it."""
    rng = np.random.default_rng(4)
    forces = level(2000) + rng.normal(0.0, 0.03, (2000, 3))
    forces[1000:1004, 0] += 30.0
    forces[1004:1014, 0] -= 24.0  # the other half of the blow, of which twice as much was cut off
    unmarked = imu_block(np.zeros((2000, 3)), forces)
    marked = imu_block(np.zeros((2000, 3)), forces)
    marked.flags[1000:1014] |= np.uint32(Flag.ACCEL_CLIPPED)
    level_q = [1.0, 0.0, 0.0, 0.0]
    assert tilt_deg(fusion().process(marked), level_q).max() < 0.6 * tilt_deg(fusion().process(unmarked), level_q).max()
    gravity = fusion(model="gravity")
    assert tilt_deg(gravity.process(marked), level_q)[100:].max() < 0.1


@stable
def test_free_fall_leaves_the_attitude_to_the_rate(make):
    rates = np.tile([0.0, np.radians(10.0), 0.0], (60, 1))
    out = make().process(imu_block(rates, np.vstack([level(1), np.zeros((59, 3))])))
    assert np.degrees(to_euler(out.q[-1]))[1] == pytest.approx(5.9, abs=1e-6)


@stable
@pytest.mark.parametrize("turn_deg", [60.0, 120.0, 175.0])
def test_a_board_turned_while_the_gyroscope_saw_nothing_is_found_again(make, turn_deg):
    """As after a clipped rate: the first seconds say SETTLING or a sigma that covers the error, then it is right."""
    angle = np.radians(turn_deg)
    forces = level(6000)
    forces[1000:] = G * np.array([0.0, np.sin(angle), np.cos(angle)])
    out = make().process(imu_block(np.zeros((6000, 3)), forces + np.random.default_rng(0).normal(0.0, 0.03, (6000, 3))))
    error = tilt_deg(out, [np.cos(angle / 2), np.sin(angle / 2), 0.0, 0.0])
    doubted = (out.flags & Flag.SETTLING) != 0
    wrong = np.flatnonzero(error > 20.0)
    assert doubted[wrong[wrong > 1100]].all()
    assert error[-1] < 2.0


@pytest.mark.parametrize("make", STABLE.values(), ids=STABLE)
def test_the_tilt_error_is_within_the_sigma_that_is_said_about_the_right_share_of_time(make, capsys):
    """Under a hand's pushes, which are not the white noise of the model: the sigma must not be too small."""
    inside, total = 0, 0
    for seed in range(6):
        rates, forces, truth = swaying(seed, 3000, hand_m_s=0.1 * (seed % 3))
        out = make().process(imu_block(rates, forces))
        error = tilt_deg(out, truth)[500:]
        sigma = np.degrees(np.hypot(out.sigma_rad[500:, 0], out.sigma_rad[500:, 1]))
        inside += (error < sigma).sum()
        total += len(error)
    with capsys.disabled():
        print(f"\ntilt within the sigma said: {inside / total:.0%} of the time")
    # Both axes together within sqrt(2) sigma: 63 % if Gaussian.
    assert inside / total > 0.6


def test_with_the_temperature_the_bias_and_yaw_are_doubted():
    n = 6000
    data = imu_block(np.zeros((n, 3)), level(n))
    warm = imu_block(np.zeros((n, 3)), level(n))
    warm.temp_degc[:] += np.linspace(0.0, 5.0, n)
    residual = replace(RESIDUAL, gyro_bias_rad_s_degc=np.radians(0.19))
    yaws = [
        np.degrees(FusionFilter(FusionParams(), residual=residual).process(d).sigma_rad[-1, 2]) for d in (data, warm)
    ]
    assert yaws[0] < 4.0
    assert yaws[1] > 20.0


@pytest.mark.parametrize("forgetting", [0.98, 0.999])
def test_the_literal_form_says_that_it_is_lost_when_it_is(forgetting):
    """0.05 g of sway near its resonance: whenever the tilt is off by 15 deg and more, the sample is SETTLING."""
    n = 6000
    t = np.arange(n) * 0.01
    forces = level(n) + 0.05 * G * np.column_stack([np.sin(3.1 * t), np.cos(3.1 * t), 0 * t])
    params = LiteralParams(forgetting=forgetting)
    out = LiteralFusionFilter(params, residual=PLAIN).process(imu_block(np.zeros((n, 3)), forces))
    error = tilt_deg(out, [1.0, 0.0, 0.0, 0.0])
    doubted = (out.flags & Flag.SETTLING) != 0
    assert np.isfinite(out.q).all()
    assert doubted[error > 15.0].all()
    if forgetting == 0.999:
        assert doubted[500:].any()
    assert (out.sigma_rad[doubted] == YAW_MAX_RAD).all()


@every
@given(seed=st.integers(0, 10**6))
@settings(max_examples=20, deadline=None)
def test_the_quaternion_is_of_unit_length_and_one_sign(make, seed):
    rng = np.random.default_rng(seed)
    out = make().process(imu_block(rng.normal(0.0, 3.0, (200, 3)), rng.normal(0.0, 8.0, (200, 3))))
    assert np.allclose(np.linalg.norm(out.q, axis=1), 1.0, atol=1e-12)
    assert (out.q[:, 0] >= 0.0).all()
    assert np.isfinite(out.sigma_rad).all()


@pytest.mark.parametrize("bad", [{"gyro_rad_s_rthz": 0.0}, {"memory_s": float("nan")}, {"norm_gate": -1.0}])
def test_a_noise_that_is_none_is_refused(bad):
    with pytest.raises(SettingsError, match=next(iter(bad))):
        FusionParams(**bad)


@pytest.mark.parametrize("bad", [{"forgetting": 1.1}, {"accel_rad": 0.0}, {"drift_rad_s": float("nan")}])
def test_a_parameter_of_the_literal_form_that_is_none_is_refused(bad):
    with pytest.raises(SettingsError, match=next(iter(bad))):
        LiteralParams(**bad)


@every
def test_a_value_that_is_no_number_is_refused_before_it_is_remembered(make):
    rates = np.zeros((20, 3))
    rates[7, 1] = np.nan
    with pytest.raises(ValueError, match="row 7"):
        make().process(imu_block(rates, level(20)))


@pytest.mark.parametrize(("kind", "kept"), [("fusion", FusionFilter), ("fusion-literal", LiteralFusionFilter)])
def test_the_settings_choose_it_by_name(kind, kept):
    assert isinstance(FilterParams(kind=kind).build(residual=RESIDUAL), kept)
