"""The default filter: still boards stay put, slow turns are not eaten, doubt is said, bad input is refused."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from imu_blocks import imu_block

from quavelet.attitude.doubt import YAW_MAX_RAD, Residual
from quavelet.attitude.params import FilterParams
from quavelet.core.blocks import AttitudeBlock, Flag, ImuBlock, array_fields
from quavelet.core.errors import SettingsError
from quavelet.core.euler import to_euler
from quavelet.core.quaternion import inclination_between

G, FS = 9.80665, 100.0
RESIDUAL = Residual(tilt_rad=0.001, gyro_bias_rad_s=2e-4, gyro_bias_rad_s_degc=0.0, gyro_scale=0.0)
DATA_SHEET, REAL = (0.0354, 2.83), (0.13, 5.0)
"""Noise of a sample at 100 Hz: deg/s and mg."""
KINDS = ["gated", "velocity", "pid", "p", "gyro", "accelerometer"]


def noisy(rates_deg_s, *, noise, axis=2, forces=None, seed=1) -> ImuBlock:
    """A board that turns about one of its axes from level, with a little bias left."""
    rng, n = np.random.default_rng(seed), len(rates_deg_s)
    rates, angle = np.zeros((n, 3)), np.radians(np.cumsum(rates_deg_s) / FS)
    rates[:, axis] = np.radians(rates_deg_s)
    up = np.zeros((n, 3))
    up[:, 2] = 1.0
    if axis == 0:
        up[:, 1], up[:, 2] = np.sin(angle), np.cos(angle)
    rates += np.radians(rng.normal([0.01, -0.008, 0.01], noise[0], (n, 3)))
    forces = G * (up + rng.normal(0.0, noise[1] * 1e-3, (n, 3))) + (0.0 if forces is None else forces)
    return imu_block(rates, forces)


def still_then(rate_deg_s: float, turn_deg: float) -> np.ndarray:
    turning = np.full(round(turn_deg / rate_deg_s * FS), rate_deg_s)
    return np.concatenate([np.zeros(3000), turning, np.zeros(1000)])


def gated(data: ImuBlock, **params) -> AttitudeBlock:
    return FilterParams(**params).build(residual=RESIDUAL).process(data)


def yaw_deg(out: AttitudeBlock) -> np.ndarray:
    return np.degrees(np.unwrap(to_euler(out.q)[:, 2]))


@pytest.mark.parametrize("noise", [DATA_SHEET, REAL, (0.3, 12.0)], ids=["data sheet", "real", "loud"])
def test_a_board_that_lies_still_keeps_its_heading_whatever_its_noise(noise):
    out = gated(noisy(np.zeros(12000), noise=noise))
    assert out.still[3000:].mean() > 0.99
    assert np.ptp(yaw_deg(out)[3000:]) < 0.05
    assert np.degrees(inclination_between(np.array([1.0, 0.0, 0.0, 0.0]), out.q))[3000:].max() < 0.03
    assert np.diff(out.sigma_rad[3000:, 2]).max() < 1e-4


@pytest.mark.parametrize(
    ("noise", "rate", "turn", "limit"),
    [(DATA_SHEET, 0.5, 30, 0.3), (DATA_SHEET, 0.1, 12, 0.6), (DATA_SHEET, 0.05, 6, 0.6), (REAL, 0.5, 30, 0.5),
     (REAL, 0.1, 12, 1.0)],
)  # fmt: skip
def test_a_slow_turn_is_not_taken_for_the_bias(noise, rate, turn, limit):
    yaw = yaw_deg(gated(noisy(still_then(rate, turn), noise=noise)))
    assert yaw[-1] - yaw[2500] == pytest.approx(turn, abs=limit)


@pytest.mark.parametrize("rate", [0.2, 0.05, 0.02])
def test_a_slow_roll_is_never_lost(rate):
    rates = still_then(rate, 100.0 * rate)
    out = gated(noisy(rates, noise=DATA_SHEET, axis=0))
    roll = np.degrees(to_euler(out.q)[:, 0])
    assert np.abs(roll - np.cumsum(rates) / FS)[1000:].max() < 0.2


def test_what_was_turned_before_it_was_seen_is_turned_after_all():
    """A turn that begins slowly is seen after a while; nothing of it is missing then."""
    ramp = np.concatenate([np.zeros(3000), np.linspace(0.0, 2.0, 1000), np.full(500, 2.0), np.zeros(1000)])
    yaw = yaw_deg(gated(noisy(ramp, noise=DATA_SHEET)))
    assert yaw[-1] - yaw[2500] == pytest.approx(ramp.sum() / FS, abs=0.1)


def test_vibration_does_not_become_a_turn():
    t = np.arange(9000) / FS
    shaking = 0.02 * G * np.sin(2 * np.pi * 25.3 * t)[:, None] * [1.0, 0.5, 0.7]
    data = noisy(np.zeros(9000), noise=DATA_SHEET, forces=np.where(t[:, None] > 30.0, shaking, 0.0))
    out = gated(data)
    assert not out.still[3300:].any()
    assert np.abs(yaw_deg(out)[3000:] - yaw_deg(out)[3000]).max() < 1.0
    assert np.degrees(inclination_between(np.array([1.0, 0.0, 0.0, 0.0]), out.q))[3000:].max() < 0.1


def ramped(seconds: int) -> ImuBlock:
    data = noisy(np.zeros(seconds * 100), noise=DATA_SHEET, seed=5)
    growing = np.radians(np.arange(len(data)) / FS / 60.0 * 0.1)
    return replace(data, gyro_rad_s=data.gyro_rad_s + growing[:, None])


def test_a_bias_that_runs_away_is_relearned_where_that_is_asked_for_and_else_makes_heading_suspect():
    plain, relearning = gated(ramped(180)), gated(ramped(180), relearn_s=10.0)
    assert plain.flags[-1] & Flag.HEADING_SUSPECT
    assert abs(yaw_deg(plain)[-1]) > 6.0
    assert not (relearning.flags & Flag.HEADING_SUSPECT).any()
    assert abs(yaw_deg(relearning)[-1]) < 6.0


def test_a_carried_board_is_level_although_it_is_pushed_about():
    """0.3 g at 0.8 Hz sideways: the accelerometer is 17 deg off, the velocity stays near zero."""
    t = np.arange(6000) / FS
    sway = 0.3 * G * np.sin(2 * np.pi * 0.8 * t)[:, None] * [1.0, 0.4, 0.0]
    data = noisy(np.zeros(6000), noise=REAL, forces=sway)
    level = np.array([1.0, 0.0, 0.0, 0.0])
    tilt = np.degrees(inclination_between(level, gated(data).q))[2000:]
    pid = np.degrees(inclination_between(level, gated(data, kind="pid").q))[2000:]
    assert tilt.max() < 0.6
    assert np.sqrt((tilt**2).mean()) < 0.5 * np.sqrt((pid**2).mean())


@pytest.mark.parametrize("bias", [(20.0, -20.0, 20.0), (-5.0, 0.0, 3.0), (0.0, 0.0, 0.0)])
def test_a_start_while_moving_finds_tilt_and_bias_and_says_when(bias):
    t = np.arange(6000) / FS
    roll = 20.0 * np.sin(2 * np.pi * 0.1 * t)
    data = noisy(np.gradient(roll, 1 / FS), noise=REAL, axis=0)
    data = replace(
        data,
        gyro_rad_s=data.gyro_rad_s + np.radians(bias),
        flags=np.full(len(t), int(Flag.BIAS_UNKNOWN), dtype=np.uint32),
    )
    out = gated(data)
    off = np.abs(np.degrees(to_euler(out.q)[:, 0]) - roll)
    trusted = (out.flags & Flag.SETTLING) == 0
    assert trusted[1000:].all()
    assert off[trusted].max() < 7.5
    assert off[3000:].max() < 1.0
    assert np.degrees(out.gyro_bias_rad_s[-1, :2]) == pytest.approx(bias[:2], abs=0.3)


def test_a_long_gap_makes_the_attitude_doubtful_and_a_wrong_tilt_is_found_again():
    data = noisy(np.zeros(4000), noise=REAL)
    tilted = data.accel_m_s2.copy()
    tilted[2000:] = tilted[2000:] @ np.array([[1, 0, 0], [0, np.cos(0.5), -np.sin(0.5)], [0, np.sin(0.5), np.cos(0.5)]])
    data = replace(data, accel_m_s2=tilted)
    data.gap_ns[2000] = 2_000_000_000
    data.flags[2000] |= Flag.GAP
    out = gated(data)
    assert out.flags[2000] & Flag.SETTLING
    assert not out.flags[-1] & Flag.SETTLING
    assert abs(np.degrees(to_euler(out.q)[-1, 0])) == pytest.approx(np.degrees(0.5), abs=0.1)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("bad", ["gyro_rad_s", "accel_m_s2", "period_s"])
def test_a_row_that_is_no_number_is_refused_and_the_filter_goes_on_without_it(kind, bad):
    data = noisy(np.zeros(50), noise=REAL)
    built = FilterParams(kind=kind).build(residual=RESIDUAL)
    built.process(data[:20])
    broken = replace(data[20:40], **{bad: getattr(data, bad)[20:40].copy()})
    getattr(broken, bad)[7] = np.nan
    with pytest.raises(ValueError, match=f"{bad} of row 7"):
        built.process(broken)
    assert np.isfinite(built.process(data[40:]).q).all()


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("n", [0, 1, 2, 700])
def test_few_samples_and_samples_that_are_all_the_same_give_a_finite_attitude(kind, n):
    out = gated(imu_block(np.zeros((n, 3)), np.tile([0.0, 0.0, G], (n, 1))), kind=kind)
    for name in array_fields(AttitudeBlock):
        assert np.isfinite(getattr(out, name)).all(), name
    assert len(out) == n


@pytest.mark.parametrize("kind", KINDS)
def test_a_stuck_chip_in_free_fall_gives_a_finite_attitude(kind):
    data = noisy(np.zeros(300), noise=REAL)
    data.accel_m_s2[100:200] = 0.0
    data.flags[120:180] |= np.uint32(Flag.STUCK)
    assert np.isfinite(gated(data, kind=kind).q).all()


def test_the_accelerometer_alone_has_no_heading_and_says_so():
    out = gated(noisy(still_then(0.5, 5.0), noise=REAL), kind="accelerometer")
    assert np.abs(to_euler(out.q)[:, 2]).max() < 1e-12
    assert (out.sigma_rad[:, 2] == YAW_MAX_RAD).all()


def test_the_gyroscope_alone_never_asks_gravity():
    data = noisy(np.zeros(2000), noise=DATA_SHEET, forces=np.array([3.0, 0.0, 0.0]))
    pushed = gated(data, kind="gyro")
    pitch = np.degrees(to_euler(pushed.q)[:, 1])
    assert abs(pitch[-1] - pitch[0]) < 0.5
    assert np.degrees(pushed.sigma_rad[-1, 0]) < 1.0


@pytest.mark.parametrize(
    ("params", "says"),
    [({"kp": 1.0}, "kp"), ({"kind": "p", "ki": 1.0}, "ki"), ({"kind": "gyro", "kp": 1.0}, "kp"),
     ({"kind": "pid", "tau_s": 2.0}, "tau_s"), ({"kind": "velocity", "relearn_s": 10.0}, "relearn_s"),
     ({"tau_s": 0.0}, "tau_s"), ({"relearn_s": 1.0}, "relearn_s"), ({"kind": "pid", "kp": -1.0}, "kp")],
)  # fmt: skip
def test_a_value_that_the_kind_has_no_use_for_is_an_error(params, says):
    with pytest.raises(SettingsError, match=says):
        FilterParams(**params)


def test_rate_beyond_its_range_is_believed():
    """A turn of which the gyroscope saw a part: gravity has it right again soon, where the flag says why."""
    rate_deg_s = np.concatenate([np.zeros(3000), np.full(30, 300.0), np.zeros(300)])
    data = noisy(rate_deg_s, noise=DATA_SHEET, axis=0)
    seen = replace(data, gyro_rad_s=np.clip(data.gyro_rad_s, -np.radians(250.0), np.radians(250.0)))
    clipped = np.where(np.abs(data.gyro_rad_s[:, 0]) > np.radians(250.0), np.uint32(Flag.GYRO_CLIPPED), np.uint32(0))
    errors = []
    for flags in (clipped, np.zeros_like(clipped)):
        q = gated(replace(seen, flags=flags), kind="velocity").q
        errors.append(float(np.degrees(inclination_between(gated(data, kind="velocity").q, q))[-200:].mean()))
    assert errors[0] < 0.3 * errors[1]
