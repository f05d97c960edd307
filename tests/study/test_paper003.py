"""Paper 003's rows are in their bands, and the simulated board is what its sensors say."""

from __future__ import annotations

import numpy as np
import pytest
from paper_rows import assert_sound
from scipy.spatial.transform import Rotation

from quavelet.study.experiment import Effort, Result, silent
from quavelet.study.paper003 import BIAS, CF_PI, EXPERIMENT, NONE, SHIPPED, SIX_30, SWAY
from quavelet.study.paper003_simulation import BIAS_RAD_S, RATE_HZ, errors_deg, recording

IDS = {"3a", "3b", "3c", "3d", "3e", "claim"}


@pytest.fixture(scope="module")
def quick() -> Result:
    return EXPERIMENT.run(Effort.QUICK, silent)


def test_the_quick_form_is_within_its_bands(quick):
    assert_sound(quick, ids=IDS)


@pytest.mark.slow
def test_the_full_form_is_within_its_bands():
    assert_sound(EXPERIMENT.run(Effort.FULL, silent), ids=IDS)


def test_the_shipped_filter_is_the_best_of_the_table_under_sway(quick):
    table = {(row.id, row.what): row.got for row in quick.rows if row.id.startswith("table")}
    sway = {what: got for (case, what), got in table.items() if case == f"table, {SWAY}"}
    assert min(sway, key=sway.get) == f"{SHIPPED}, tilt"
    assert sway[f"{SIX_30}, tilt"] < sway[f"{CF_PI}, tilt"] / 4
    assert table[f"table, {NONE}", f"{SHIPPED}, tilt"] < 0.03
    assert table[f"table, {BIAS}", f"{SHIPPED}, tilt"] < 0.03


def test_the_boards_rates_turn_it_as_the_truth_says():
    data = recording(0, biased=True, sway=False).without_spikes()
    q = Rotation.from_quat(np.roll(data.q, -1, axis=1))
    turned = (q[:-1].inv() * q[1:]).as_rotvec() * RATE_HZ
    left = data.gyro_rad_s[1:] - turned - BIAS_RAD_S
    assert np.degrees(np.abs(left.mean(axis=0))).max() < 0.01
    assert np.degrees(left.std(axis=0)) == pytest.approx(0.0354, rel=0.1)
    up = q.apply(data.accel_m_s2)
    assert up.mean(axis=0) == pytest.approx([0.0, 0.0, 9.80665], abs=0.01)


def test_the_error_is_the_rotation_from_estimate_to_truth_in_the_world():
    data = recording(0, biased=False, sway=False)
    turn = Rotation.from_rotvec(np.radians([1.0, -2.0, 5.0]))
    found = np.roll((turn.inv() * Rotation.from_quat(np.roll(data.q, -1, axis=1))).as_quat(), 1, axis=1)
    assert errors_deg(data, -found) == pytest.approx(np.tile([1.0, -2.0, 5.0], (9000, 1)), abs=1e-9)
