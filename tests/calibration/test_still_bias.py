"""The still start: what is taken for a bias, and what must never be."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import settings as hypothesis_settings
from hypothesis import strategies as st
from imu_blocks import imu_block

from quavelet.calibration.still_bias import StillBias
from quavelet.core.blocks import Flag, ImuBlock

G = 9.80665
# What real boards lying still show, per sample at 100 Hz; twice the data sheet's noise.
GYRO_SD_RAD_S, ACCEL_SD_M_S2 = np.radians(0.13), 0.005 * G


def board(rates_dps, forces_g, *, seed: int = 1, period_s: float = 0.01) -> ImuBlock:
    """Samples with real noise on these rates and forces, bias unknown."""
    rng = np.random.default_rng(seed)
    rates, forces = np.radians(np.asarray(rates_dps, dtype=float)), G * np.asarray(forces_g, dtype=float)
    noisy_rates = rates + rng.normal(0.0, GYRO_SD_RAD_S, rates.shape)
    noisy_forces = forces + rng.normal(0.0, ACCEL_SD_M_S2, forces.shape)
    return imu_block(noisy_rates, noisy_forces, period_s=period_s, flags=int(Flag.BIAS_UNKNOWN))


def flat(n: int, value) -> np.ndarray:
    return np.tile(np.asarray(value, dtype=float), (n, 1))


def bias_known(out: ImuBlock) -> np.ndarray:
    return (out.flags & Flag.BIAS_UNKNOWN) == 0


@hypothesis_settings(max_examples=30, deadline=None)
@given(bias=st.tuples(*[st.floats(-20.0, 20.0)] * 3), seed=st.integers(0, 10**6))
def test_any_bias_of_the_data_sheet_is_found_in_the_first_stillness(bias, seed):
    out = StillBias(window_s=2.0).process(board(flat(600, bias), flat(600, [0.0, 0.6, 0.8]), seed=seed))
    known = bias_known(out)
    assert not known[:190].any()
    assert known[205:].all()
    # The mean of 200 samples of 0.13 deg/s is good to 0.009 deg/s.
    assert np.abs(np.degrees(out.gyro_bias_rad_s[-1]) - bias).max() < 0.05
    assert np.allclose(
        out.gyro_rad_s + out.gyro_bias_rad_s, board(flat(600, bias), flat(600, [0, 0.6, 0.8]), seed=seed).gyro_rad_s
    )


@pytest.mark.parametrize(
    ("name", "rates_dps", "forces_g"),
    [
        ("shaken", 5.0 * np.sin(np.arange(1500) / 8.0)[:, None] * [1, 1, 0], flat(1500, [0, 0, 1])),
        ("pushed", flat(1500, [1, 1, 1]), flat(1500, [0, 0, 1]) + 0.1 * np.sin(np.arange(1500) / 8.0)[:, None]),
        ("on a turntable at 33 rpm", flat(1500, [0, 0, 200.0]), flat(1500, [0, 0, 1])),
        ("turning at 30 deg/s from power-on", flat(1500, [0, 0, 30.0]), flat(1500, [0, 0, 1])),
        ("speeding up", np.arange(1500)[:, None] * [0, 0, 0.005], flat(1500, [0, 0, 1])),
        (
            "rolling slowly",
            flat(1500, [1.0, 0, 0]),
            np.column_stack([0 * np.arange(1500), np.sin(np.arange(1500) * 1.7e-4), np.cos(np.arange(1500) * 1.7e-4)]),
        ),
    ],
)
def test_a_moving_board_is_refused(name, rates_dps, forces_g):
    out = StillBias(window_s=2.0).process(board(rates_dps, forces_g))
    assert not bias_known(out).any(), name
    assert not out.gyro_bias_rad_s.any()


def test_a_board_put_down_later_gets_its_bias_then():
    moving = 20.0 * np.sin(np.arange(700) / 15.0)[:, None] * [1, 0.5, 0.2]
    rates = np.vstack([moving, flat(500, [0, 0, 0])]) + [3.0, -2.0, 1.0]
    out = StillBias(window_s=2.0).process(board(rates, flat(1200, [0, 0, 1])))
    known = bias_known(out)
    assert not known[:895].any()
    assert known[910:].all()
    assert np.allclose(np.degrees(out.gyro_bias_rad_s[-1]), [3.0, -2.0, 1.0], atol=0.05)


def test_a_gap_begins_the_window_anew():
    data = board(flat(400, [1, 1, 1]), flat(400, [0, 0, 1]))
    data.flags[150] |= Flag.GAP
    known = bias_known(StillBias(window_s=2.0).process(data))
    assert not known[:340].any()
    assert known[355:].all()


def test_the_bias_follows_the_temperature_while_still_and_stays_while_moving():
    n = 30_000
    drift = np.column_stack([np.arange(n) * 1e-5, 0 * np.arange(n), -np.arange(n) * 5e-6])  # 0.06 deg/s a minute
    rates = drift + [2.0, 0.0, -1.0]
    out = StillBias(window_s=2.0).process(board(rates, flat(n, [0, 0, 1])))
    error_dps = np.degrees(out.gyro_bias_rad_s[-1]) - rates[-1]
    assert np.abs(error_dps).max() < 0.035  # 16 s behind, and noise
    assert np.abs(drift[-1, 0]) > 0.29


def test_a_slow_turn_after_the_start_is_not_taken_for_bias():
    rates = np.vstack([flat(1000, [2, 0, -1]), flat(3000, [2, 0, -0.9])])
    out = StillBias(window_s=2.0).process(board(rates, flat(4000, [0, 0, 1])))
    assert abs(np.degrees(out.gyro_bias_rad_s[-1, 2]) + 1.0) < 0.02


def test_a_known_bias_is_left_alone():
    data = board(flat(800, [1, 1, 1]), flat(800, [0, 0, 1]))
    data.flags[:] = 0
    out = StillBias(window_s=2.0).process(data)
    assert np.array_equal(out.gyro_rad_s, data.gyro_rad_s)
    assert out.still[100:].all()


def test_still_and_moving_are_told_apart_as_they_happen():
    rates = np.vstack([flat(400, [0, 0, 0]), flat(200, [0, 0, 15.0]), flat(400, [0, 0, 0])])
    still = StillBias(window_s=2.0).process(board(rates, flat(1000, [0, 0, 1]))).still
    assert still[100:400].all()
    assert not still[400:440].any()
    assert still[700:].all()


MOVING = 20.0 * np.sin(np.arange(700) / 15.0)[:, None] * [1, 0.5, 0.2]


def test_a_board_that_moves_at_the_start_is_not_waited_for_where_the_calibration_knows_its_bias():
    data = board(MOVING, flat(700, [0, 0, 1]))
    out = StillBias(window_s=2.0, refine=True).process(data)
    assert bias_known(out)[20:].all()
    assert np.array_equal(out.gyro_rad_s, data.gyro_rad_s)


def test_what_the_calibration_leaves_is_measured_at_the_still_start():
    out = StillBias(window_s=2.0, refine=True).process(board(flat(600, [0.2, -0.1, 0.05]), flat(600, [0, 0, 1])))
    assert not bias_known(out)[:190].any()
    assert np.allclose(np.degrees(out.gyro_bias_rad_s[-1]), [0.2, -0.1, 0.05], atol=0.05)


def test_what_the_calibration_leaves_is_measured_later_where_the_board_moved_first():
    rates = np.vstack([MOVING, flat(500, [0, 0, 0])]) + [0.3, 0, 0]
    out = StillBias(window_s=2.0, refine=True).process(board(rates, flat(1200, [0, 0, 1])))
    assert np.allclose(np.degrees(out.gyro_bias_rad_s[-1]), [0.3, 0, 0], atol=0.05)


def test_a_slow_turn_at_the_start_is_no_bias_where_the_calibration_knows_better():
    rates = flat(800, [0, 0, 5.0])
    out = StillBias(window_s=2.0, refine=True).process(board(rates, flat(800, [0, 0, 1])))
    assert bias_known(out)[205:].all()
    assert not out.gyro_bias_rad_s.any()
    # Without a calibration it is taken for one.
    assert StillBias(window_s=2.0).process(board(rates, flat(800, [0, 0, 1]))).gyro_bias_rad_s[-1, 2] > 0.08
