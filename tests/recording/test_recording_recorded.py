"""Recordings of all kinds become raw blocks, and what is none is refused in one sentence that names it."""

from __future__ import annotations

import numpy as np
import pytest

from quavelet.calibration.calibrate import Calibrate
from quavelet.calibration.model import UNCALIBRATED
from quavelet.core.blocks import Flag
from quavelet.core.errors import RecordingError
from quavelet.recording.recorded import load_recorded

N, FS = 500, 100.0
RNG = np.random.default_rng(1)
GYR = RNG.integers(-3000, 3000, (N, 3)).astype(np.int16)
ACC = RNG.integers(-9000, 9000, (N, 3)).astype(np.int16)
Q_REF = np.tile(np.array([32000, 0, 0, 0], dtype=np.int16), (N, 1))
TRIAL = {"gyr": GYR, "gyr_scale": 1e-3, "acc": ACC, "acc_scale": 2e-3, "fs": FS}


def saved(tmp_path, **arrays):
    path = tmp_path / "trial.npz"
    np.savez(path, **arrays)
    return path


def in_si(recorded):
    (run,) = recorded.runs
    return Calibrate(UNCALIBRATED).process(run)


def test_counts_stay_the_counts_they_are(tmp_path):
    recorded = load_recorded(saved(tmp_path, **TRIAL))
    assert np.array_equal(recorded.runs[0].counts[:, 4:], GYR)
    assert np.array_equal(recorded.runs[0].counts[:, :3], ACC)
    assert in_si(recorded).gyro_rad_s == pytest.approx(GYR * 1e-3)
    assert in_si(recorded).accel_m_s2 == pytest.approx(ACC * 2e-3)
    assert recorded.seconds == pytest.approx((N - 1) / FS)
    assert recorded.truth is None


def test_counts_by_degrees_and_g_and_their_temperature(tmp_path):
    temp = np.full(N, -3400, dtype=np.int16)
    recorded = load_recorded(
        saved(tmp_path, gyr=GYR, acc=ACC, temp=temp, gyr_lsb_per_dps=131, acc_lsb_per_g=4096, rate=FS)
    )
    block = in_si(recorded)
    assert block.gyro_rad_s == pytest.approx(np.radians(GYR / 131))
    assert block.accel_m_s2 == pytest.approx(ACC / 4096 * 9.80665)
    assert block.temp_degc == pytest.approx(26.53)


def test_a_chips_counts_at_the_end_of_the_range_are_flagged_and_scaled_values_are_not(tmp_path):
    clipped = GYR.copy()
    clipped[7, 1] = -32768
    scales = {"gyr_lsb_per_dps": 131, "acc_lsb_per_g": 4096, "rate": FS}
    (run,) = load_recorded(saved(tmp_path, gyr=clipped, acc=ACC, **scales)).runs
    assert np.flatnonzero(run.flags & Flag.GYRO_CLIPPED).tolist() == [7]
    (run,) = load_recorded(saved(tmp_path, **{**TRIAL, "gyr": clipped})).runs
    assert not run.flags.any()


def test_values_in_si_lose_no_more_than_a_chip_would(tmp_path):
    rate, force = RNG.normal(0, 1, (N, 3)), RNG.normal(0, 9, (N, 3))
    block = in_si(load_recorded(saved(tmp_path, gyro_rad_s=rate, acc_m_s2=force, fs=FS)))
    assert np.abs(block.gyro_rad_s - rate).max() <= np.abs(rate).max() / 65533
    assert np.abs(block.accel_m_s2 - force).max() <= np.abs(force).max() / 65533


def test_truth_is_scored_only_where_it_is_valid_and_moves(tmp_path):
    valid, moving = np.arange(N) >= 10, np.arange(N) < 400
    broken = np.where(valid[:, None], Q_REF, 0)
    truth = load_recorded(saved(tmp_path, **TRIAL, q_ref=broken, q_valid=valid, mov=moving)).truth
    assert truth is not None
    assert np.array_equal(truth.scored, valid & moving)
    assert np.linalg.norm(truth.q, axis=1) == pytest.approx(1.0)


def test_truth_that_holds_nowhere_is_none(tmp_path):
    assert load_recorded(saved(tmp_path, **TRIAL, q_ref=Q_REF, q_valid=np.zeros(N, bool))).truth is None


def without(name):
    return {key: value for key, value in TRIAL.items() if key != name}


@pytest.mark.parametrize(
    ("arrays", "complaint"),
    [
        (without("gyr"), "neither 'gyr' nor 'gyro_rad_s'"),
        (without("acc_scale"), "add 'acc_scale'"),
        (without("fs"), "add it as 'fs'"),
        ({**TRIAL, "fs": 0.0}, "'fs' is not one number above 0"),
        ({**TRIAL, "acc": ACC[:400]}, "500 and 400 rows"),
        ({**TRIAL, "gyr": GYR[:, :2]}, "not N rows of three"),
        ({**TRIAL, "gyr": np.where(np.arange(N)[:, None] == 7, np.nan, GYR)}, "not finite"),
        ({**TRIAL, "gyr": GYR[:200], "acc": ACC[:200]}, "200 samples of 2.0 s"),
        ({**TRIAL, "gyr": GYR[:0], "acc": ACC[:0]}, "0 samples"),
        ({**TRIAL, "q_ref": Q_REF[:7]}, "'q_ref' is not 500 rows"),
        ({**TRIAL, "q_ref": Q_REF // 2}, "no unit quaternions"),
        ({**TRIAL, "q_ref": Q_REF, "mov": np.ones(3)}, "'mov' has not 500 rows"),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_an_npz_file_that_is_no_recording_is_refused_by_name(tmp_path, arrays, complaint):
    with pytest.raises(RecordingError) as refused:
        load_recorded(saved(tmp_path, **arrays))
    assert complaint in str(refused.value)
    assert str(refused.value).startswith(str(tmp_path / "trial.npz"))
    assert "\n" not in str(refused.value)


def test_a_cut_npz_file_is_refused(tmp_path):
    path = saved(tmp_path, **TRIAL)
    path.write_bytes(path.read_bytes()[:3000])
    with pytest.raises(RecordingError, match="no npz file that can be read"):
        load_recorded(path)


@pytest.mark.parametrize("content", [b"", b"GARBAGE" * 100, b"PK\x03\x04" + bytes(100)])
def test_what_is_no_recording_at_all_is_refused(tmp_path, content):
    path = tmp_path / "file.qrec"
    path.write_bytes(content)
    with pytest.raises(RecordingError, match=r"file\.qrec"):
        load_recorded(path)
