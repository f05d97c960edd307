"""Heading from the field: right where the field is the Earth's, withheld where it is not, and honest about both."""

from __future__ import annotations

import logging

import numpy as np
import pytest

from hw_fakes import EarthField
from hw_fakes.world.motion_base import to_body
from quavelet.attitude.doubt import Residual
from quavelet.attitude.heading import CLEAR_S, INSIST_S, Heading, HeadingParams
from quavelet.core.blocks import AttitudeBlock, Flag, YawFrom
from quavelet.core.errors import SettingsError
from quavelet.core.euler import from_euler, to_euler
from quavelet.core.quaternion import from_rotation_vector, multiply

RESIDUAL = Residual(tilt_rad=0.0, gyro_bias_rad_s=2e-4, gyro_bias_rad_s_degc=1e-3, gyro_scale=0.01)
PERFECT = HeadingParams(hard_iron_ut=(0.0, 0.0, 0.0), hard_iron_sigma_ut=0.2)
PERIOD_S = 0.01
EARTH = EarthField(declination_deg=4.0)


class Board:
    """A board that sways and turns, its filter's attitude with a wrong azimuth that drifts, and its field."""

    def __init__(self, seconds: float, *, earth: EarthField = EARTH, yaw_deg_s: float = 20.0, drift_dps: float = 0.02):
        self.n = n = round(seconds / PERIOD_S)
        t_s = np.arange(n) * PERIOD_S
        self.t_s = t_s
        angles = np.radians(np.stack([25 * np.sin(t_s), 20 * np.sin(0.7 * t_s), 40 + yaw_deg_s * t_s], 1))
        self.truth = from_euler(angles)
        turned = np.zeros((n, 3))
        turned[:, 2] = np.radians(-70.0 + drift_dps * t_s)
        self.filtered = multiply(from_rotation_vector(turned), self.truth)
        self.field_ut = to_body(self.truth, np.broadcast_to(earth.world_ut, (n, 3)))
        self.field_ut += np.random.default_rng(1).normal(0.0, 0.3, (n, 3))
        self.gyro = np.zeros((n, 3))
        self.gyro[:, 2] = np.radians(yaw_deg_s)
        self.flags = np.zeros(n, dtype=np.uint32)
        self.gap_ns = np.zeros(n, dtype=np.int64)
        self.yaw_sigma = np.radians(0.01) * t_s
        self.degc = np.full(n, 30.0)

    def block(self) -> AttitudeBlock:
        tilt = np.full(self.n, np.radians(0.1))
        return AttitudeBlock(
            t_ns=np.round(self.t_s * 1e9).astype(np.int64) + np.cumsum(self.gap_ns),
            period_s=np.full(self.n, PERIOD_S),
            gap_ns=self.gap_ns,
            flags=self.flags,
            q=self.filtered,
            sigma_rad=np.stack([tilt, tilt, self.yaw_sigma], 1),
            gyro_rad_s=self.gyro,
            accel_m_s2=np.zeros((self.n, 3)),
            temp_degc=self.degc,
            gyro_bias_rad_s=np.zeros((self.n, 3)),
            still=np.zeros(self.n, dtype=np.bool_),
        )

    def headed(self, params: HeadingParams = PERFECT) -> AttitudeBlock:
        return Heading(params, residual=RESIDUAL).process(self.block(), self.field_ut)

    def yaw_error_deg(self, out: AttitudeBlock, *, declination_deg: float = 0.0) -> np.ndarray:
        """Of each row, where yaw counts from a north that lies so far east of the true one."""
        error = to_euler(out.q)[:, 2] - to_euler(self.truth)[:, 2] - np.radians(declination_deg)
        return np.degrees(np.angle(np.exp(1j * error)))

    def disturb(self, start_s: float, end_s: float, by_ut: float = 30.0) -> None:
        """A magnet in the room, which comes and goes within a fifth of a second."""
        size = np.clip((self.t_s - start_s) / 0.2, 0, 1) * np.clip((end_s - self.t_s) / 0.2, 0, 1)
        self.field_ut += to_body(self.truth, size[:, None] * np.array([by_ut, 0.0, 0.0]))


def test_heading_of_a_turning_board_is_wrong():
    board = Board(30.0)
    out = board.headed()
    fixed = out.yaw_from == YawFrom.MAGNETIC
    first = int(np.argmax(fixed))
    assert first == pytest.approx(1.0 / PERIOD_S, abs=2)
    assert fixed[first:].all() and not fixed[:first].any()
    error = board.yaw_error_deg(out, declination_deg=EARTH.declination_deg)
    assert np.abs(error[first:]).max() < 1.0
    # What it says of itself is neither a boast nor an excuse.
    sigma = np.degrees(out.sigma_rad[first:, 2])
    assert sigma.max() < 2.0
    assert np.sqrt(np.mean(error[first:] ** 2)) < 2 * np.median(sigma)
    assert (out.flags == 0).all()


def test_rows_before_the_first_fix_are_changed():
    board = Board(0.9)
    out = board.headed()
    assert out.q.tobytes() == board.filtered.tobytes()
    assert (out.yaw_from == YawFrom.RELATIVE).all()


def test_tilt_is_turned_with_the_yaw():
    board = Board(10.0)
    out = board.headed()
    up, before = (to_euler(q)[:, :2] for q in (out.q, board.filtered))
    assert np.abs(up - before).max() < 1e-9
    assert (out.q[:, 0] >= 0).all()
    assert (out.sigma_rad[:, :2] == board.block().sigma_rad[:, :2]).all()


@pytest.mark.parametrize("declination_deg", [0.0, 4.0, -17.5])
def test_true_north_is_on_the_other_side_of_the_magnetic_one(declination_deg):
    board = Board(5.0, earth=EarthField(declination_deg=declination_deg))
    out = board.headed(
        HeadingParams(hard_iron_ut=(0.0, 0.0, 0.0), hard_iron_sigma_ut=0.2, declination_deg=declination_deg)
    )
    assert (out.yaw_from[150:] == YawFrom.TRUE).all()
    assert np.abs(board.yaw_error_deg(out)[150:]).max() < 1.0


def test_calibration_is_applied_the_wrong_way_round():
    board = Board(5.0)
    iron = np.array([[1.1, 0.03, -0.02], [0.03, 0.93, 0.01], [-0.02, 0.01, 1.02]])
    hard = np.array([30.0, -55.0, 12.0])
    board.field_ut = board.field_ut @ np.linalg.inv(iron).T + hard
    out = board.headed(HeadingParams(hard_iron_ut=tuple(hard.tolist()), soft_iron=tuple(iron.ravel().tolist())))
    assert np.abs(board.yaw_error_deg(out, declination_deg=4.0)[150:]).max() < 1.0


@pytest.mark.parametrize("yaw_deg_s", [0.0, 20.0])
def test_magnet_near_by_steers_the_heading(yaw_deg_s):
    board = Board(40.0, yaw_deg_s=yaw_deg_s)
    board.disturb(10.0, 25.0)
    out = board.headed()
    assert np.abs(board.yaw_error_deg(out, declination_deg=4.0)[150:]).max() < 1.0
    disturbed = out.flags & Flag.FIELD_DISTURBED != 0
    assert disturbed[1030:2470].all()
    assert not disturbed[:1000].any()
    assert not disturbed[round((25.0 + CLEAR_S) / PERIOD_S) + 5 :].any()
    # It is carried on by the gyroscope, and says how sure that is.
    sigma = np.degrees(out.sigma_rad[:, 2])
    assert (out.yaw_from[150:] == YawFrom.MAGNETIC).all()
    assert (np.diff(sigma[1100:2400]) > 0).all()
    assert sigma[2400] > sigma[1000] + (0.02 if yaw_deg_s == 0.0 else 2.0)
    assert sigma[3500] < sigma[2400]


def test_drift_while_disturbed_is_more_than_sigma_says_or_stays_for_ever():
    """The bias changes by ten times its sigma as the chip warms, and sigma knows the temperature."""
    board = Board(120.0, drift_dps=0.1)
    board.degc = 30.0 + 5.0 * np.clip((board.t_s - 10.0) / 20.0, 0, 1)
    board.disturb(10.0, 80.0)
    out = board.headed()
    error, sigma = board.yaw_error_deg(out, declination_deg=4.0), np.degrees(out.sigma_rad[:, 2])
    assert 5.0 < abs(error[7900]) < 3 * sigma[7900]
    assert np.abs(error[9500:]).max() < 1.5


def test_start_near_a_magnet_gives_a_heading():
    board = Board(20.0)
    board.disturb(-1.0, 10.0, by_ut=60.0)
    out = board.headed()
    assert (out.yaw_from[:1000] == YawFrom.RELATIVE).all()
    assert (out.flags[250:900] & Flag.FIELD_DISTURBED).all()
    assert (out.yaw_from[1300:] == YawFrom.MAGNETIC).all()
    assert np.abs(board.yaw_error_deg(out, declination_deg=4.0)[1300:]).max() < 1.0
    assert not (out.flags[1300:] & Flag.FIELD_DISTURBED).any()


def test_heading_is_given_at_the_magnetic_pole(caplog):
    board = Board(10.0, earth=EarthField(strength_ut=58.0, inclination_deg=86.0))
    out = board.headed()
    assert (out.yaw_from == YawFrom.RELATIVE).all()
    assert out.q.tobytes() == board.filtered.tobytes()
    assert sum("nearly vertical" in record.message for record in caplog.records) == 1


@pytest.mark.parametrize("flag", [Flag.BIAS_UNKNOWN, Flag.SETTLING])
def test_azimuth_that_may_still_jump_is_taken_for_one_that_is_held(flag):
    board = Board(10.0)
    board.flags[:500] = int(flag)
    board.filtered[:500] = board.truth[:500]
    out = board.headed()
    assert (out.yaw_from[:599] == YawFrom.RELATIVE).all()
    assert (out.yaw_from[620:] == YawFrom.MAGNETIC).all()
    assert np.abs(board.yaw_error_deg(out, declination_deg=4.0)[620:]).max() < 1.0


def test_what_a_gap_cost_the_filter_is_not_told_or_not_mended():
    board = Board(30.0)
    board.gap_ns[1500] = 400_000_000
    board.yaw_sigma[1500:] += np.radians(20.0)
    lost = np.zeros((board.n, 3))
    lost[1500:, 2] = np.radians(15.0)
    board.filtered = multiply(from_rotation_vector(lost), board.filtered)
    board.flags[1500:1700] |= int(Flag.SETTLING)
    out = board.headed()
    error, sigma = np.abs(board.yaw_error_deg(out, declination_deg=4.0)), np.degrees(out.sigma_rad[:, 2])
    assert error[1490] < 1.0
    assert error[1600] > 10.0 and sigma[1600] > 15.0
    # As sure as it was of the gyroscope it is of the field: at once.
    assert error[1750:].max() < 1.5


def test_gyroscope_that_slipped_unseen_is_believed_for_ever():
    board = Board(90.0, yaw_deg_s=0.0)
    slipped = np.zeros((board.n, 3))
    slipped[1000:, 2] = np.radians(15.0)
    board.filtered = multiply(from_rotation_vector(slipped), board.filtered)
    out = board.headed()
    error, sigma = np.abs(board.yaw_error_deg(out, declination_deg=4.0)), np.degrees(out.sigma_rad[:, 2])
    assert (out.flags[1100:6900] & Flag.FIELD_DISTURBED).all()
    k = round((10.0 + INSIST_S) / PERIOD_S)
    assert sigma[k + 10] > 10.0
    assert error[k + 200 :].max() < 1.5
    assert not (out.flags[k + 200 :] & Flag.FIELD_DISTURBED).any()


def test_magnetometer_that_gives_nothing_is_waited_for_with_a_sigma_that_stands():
    board = Board(30.0)
    board.field_ut[1000:2000] = np.nan
    out = board.headed()
    sigma = np.degrees(out.sigma_rad[:, 2])
    assert (np.diff(sigma[1000:2000]) > 0).all()
    assert np.abs(board.yaw_error_deg(out, declination_deg=4.0)[150:]).max() < 1.0


def test_sigma_forgets_the_iron_or_the_tilt():
    board = Board(10.0)
    horizontal_ut = 49.0 * np.cos(np.radians(66.0))
    params = HeadingParams(hard_iron_ut=(0.0, 0.0, 0.0), hard_iron_sigma_ut=3.0)
    assert board.headed(params).sigma_rad[500, 2] == pytest.approx(3.0 / horizontal_ut, rel=0.05)
    block = board.block()
    block.sigma_rad[:, :2] = np.radians(2.0)
    out = Heading(PERFECT, residual=RESIDUAL).process(block, board.field_ut)
    assert out.sigma_rad[500, 2] == pytest.approx(np.radians(2.0) * np.tan(np.radians(66.0)), rel=0.05)


def test_heading_without_a_calibration_is_given():
    with pytest.raises(ValueError, match="not calibrated"):
        Heading(HeadingParams(), residual=RESIDUAL)


def test_field_of_other_rows_is_taken():
    board = Board(1.0)
    with pytest.raises(ValueError, match=r"\(5, 3\) where the block has 100 rows"):
        Heading(PERFECT, residual=RESIDUAL).process(board.block(), board.field_ut[:5])


@pytest.mark.parametrize(
    ("bad", "says"),
    [
        ({"hard_iron_ut": (1.0, 2.0)}, "three numbers"),
        ({"hard_iron_ut": (1.0, 2.0, float("nan"))}, "three numbers"),
        ({"soft_iron": (1.0,) * 8}, "nine numbers"),
        ({"soft_iron": (0.0,) * 9}, "determinant"),
        ({"hard_iron_sigma_ut": -1.0}, "hard_iron_sigma_ut = -1"),
        ({"declination_deg": 181.0}, "no angle"),
        ({"tau_s": 0.0}, "tau_s = 0"),
    ],
)
def test_settings_that_cannot_be_are_taken(bad, says):
    with pytest.raises(SettingsError, match=says):
        HeadingParams(**bad)


def test_magnet_goes_unnoticed_by_the_log(caplog):
    """Flags tell of it, once a sample; a log would be full of it."""
    caplog.set_level(logging.WARNING)
    board = Board(10.0)
    board.disturb(3.0, 6.0)
    board.headed()
    assert not caplog.records
