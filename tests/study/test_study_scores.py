"""Figures of attitudes whose error is known."""

from __future__ import annotations

import numpy as np
import pytest

from quavelet.core.blocks import AttitudeBlock, Flag
from quavelet.core.euler import from_euler
from quavelet.core.quaternion import conjugate, multiply, rotate
from quavelet.recording.recorded import Truth
from quavelet.study.scores import drawn_deg, errors_over_time, score, settled_from, still_rows

N = 1000
T_S = np.arange(N) / 100.0
TRUE_Q = from_euler(np.radians(np.column_stack([20 * np.sin(T_S), 10 * np.cos(T_S), 30 * T_S])))
ALL = slice(0, N)


def block(q: np.ndarray, *, flags=0, still=True) -> AttitudeBlock:
    """An attitude beside a perfect accelerometer."""
    return AttitudeBlock(
        t_ns=np.arange(N) * 10_000_000,
        period_s=np.full(N, 0.01),
        gap_ns=np.zeros(N, dtype=np.int64),
        flags=np.broadcast_to(np.asarray(flags, dtype=np.uint32), N).copy(),
        q=q,
        sigma_rad=np.zeros((N, 3)),
        gyro_rad_s=np.zeros((N, 3)),
        accel_m_s2=rotate(conjugate(TRUE_Q), np.array([0.0, 0.0, 9.80665])),
        temp_degc=np.zeros(N),
        gyro_bias_rad_s=np.zeros((N, 3)),
        still=np.broadcast_to(np.asarray(still, dtype=np.bool_), N).copy(),
    )


def turned(by_deg) -> np.ndarray:
    """The truth, turned in the world by roll, pitch, yaw (N, 3) or (3,)."""
    return multiply(from_euler(np.radians(np.broadcast_to(by_deg, (N, 3)))), TRUE_Q)


def scored(q: np.ndarray, **more):
    truth = Truth(TRUE_Q, np.ones(N, dtype=np.bool_))
    return score(block(q), block(TRUE_Q), **{"still": ALL, "start": 0, "truth": truth, **more})


def test_the_truth_itself_has_no_error():
    found = scored(TRUE_Q)
    assert [found.truth, found.truth_max, found.heading, found.gravity, found.apart] == pytest.approx([0] * 5, abs=1e-5)


@pytest.mark.parametrize("tilt", [(2.0, 0.0, 0.0), (0.0, -2.0, 0.0)])
def test_a_tilt_is_found_by_truth_by_gravity_and_beside_the_default(tilt):
    found = scored(turned(tilt))
    assert [found.truth, found.truth_max, found.gravity, found.apart] == pytest.approx([2.0] * 4)


def test_a_heading_that_was_wrong_from_the_start_is_none_and_one_that_drifts_is():
    assert scored(turned((0.0, 0.0, 170.0))).truth == pytest.approx(0.0, abs=1e-5)
    assert scored(turned((0.0, 0.0, 170.0))).heading == pytest.approx(0.0, abs=1e-9)
    drifting = np.column_stack([np.zeros(N), np.zeros(N), np.linspace(100.0, 500.0, N)])
    assert scored(turned(drifting)).heading == pytest.approx(400.0)


def test_no_line_is_drawn_from_one_end_of_the_turn_to_the_other():
    yaw = np.column_stack([np.zeros(N), np.zeros(N), np.linspace(0.0, 890.0, N)])
    drawn = drawn_deg(from_euler(np.radians(yaw)))[:, 2]
    assert np.isnan(drawn).sum() == 2
    assert np.nanmax(np.abs(np.diff(drawn))) < 1.0


def test_an_error_over_time_is_the_rms_of_each_window_and_missing_where_nothing_is_scored():
    truth = Truth(TRUE_Q, np.arange(N) < 500)
    t_s, error = errors_over_time(block(turned((3.0, 0.0, 0.0))), truth, start=100, window=50)
    assert t_s[:2] == pytest.approx([1.25, 1.75], abs=0.01)
    assert error[:8] == pytest.approx([3.0] * 8)
    assert np.isnan(error[8:]).all()
    assert len(error) == 18


def test_only_scored_rows_from_the_start_on_count():
    by = np.zeros((N, 3))
    by[:500, 0], by[800:, 0] = 50.0, 50.0
    half = Truth(TRUE_Q, np.arange(N) < 800)
    assert scored(turned(by), truth=half, start=500).truth == pytest.approx(0.0, abs=1e-5)
    assert np.isnan(scored(TRUE_Q, truth=None).truth)


def test_wander_is_the_departure_from_the_mean_in_the_still_stretch_alone():
    angles = np.zeros((N, 3))
    angles[:, 1] = 0.3 * np.sign(np.sin(40 * T_S))
    angles[:300] = 60.0
    found = score(block(from_euler(np.radians(angles))), block(TRUE_Q), still=slice(300, N), start=0, truth=None)
    assert found.wander == pytest.approx((0.0, 0.3, 0.0), abs=0.01)
    assert found.wander_rms == pytest.approx((0.0, 0.3, 0.0), abs=0.01)
    assert np.isnan(scored(TRUE_Q, still=slice(0, 0)).wander).all()


def test_a_shaken_accelerometer_is_not_believed():
    shaken = block(TRUE_Q)
    shaken.accel_m_s2[::3] = [20.0, 0.0, 0.0]
    assert score(shaken, shaken, still=ALL, start=0, truth=None).gravity == pytest.approx(0.0, abs=1e-5)


def test_the_longest_still_stretch_ends_where_something_was_lost():
    still = np.ones(N, dtype=np.bool_)
    still[100] = False
    flags = np.zeros(N, dtype=np.uint32)
    flags[700] = Flag.GAP
    assert still_rows(block(TRUE_Q, flags=flags, still=still)) == slice(101, 700)
    assert still_rows(block(TRUE_Q, flags=flags, still=still), start=650) == slice(701, N)
    moving = still_rows(block(TRUE_Q, still=False))
    assert moving.start == moving.stop


@pytest.mark.parametrize(("settled", "counts_from"), [(0, 0), (200, 200), (251, 250), (N, 250)])
def test_figures_count_from_where_the_attitude_says_it_is_settled_but_not_only_at_the_end(settled, counts_from):
    flags = np.where(np.arange(N) < settled, int(Flag.SETTLING), 0)
    assert settled_from(block(TRUE_Q, flags=flags)) == counts_from
