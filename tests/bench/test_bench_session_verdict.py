"""The verdict: what is not good enough is said to be, and what was not asked for is not judged."""

from __future__ import annotations

from dataclasses import replace

import msgspec
import numpy as np
import pytest
from session_rig import Bench

from quavelet.bench.session_evidence import Evidence
from quavelet.bench.session_recorded import evidence_of
from quavelet.bench.session_result import Result, work_out
from quavelet.bench.session_verdict import verdict
from quavelet.core.units import RAD_PER_DEG, STANDARD_GRAVITY_M_S2


@pytest.fixture(scope="module")
def measured(tmp_path_factory: pytest.TempPathFactory) -> Evidence:
    bench = Bench(["rest", "faces", "turns", "check"], out=tmp_path_factory.mktemp("v") / "c", seed=3)
    assert bench.conduct()
    return bench.evidence


def copied(evidence: Evidence) -> Evidence:
    return msgspec.msgpack.decode(msgspec.msgpack.encode(evidence), type=Evidence)


def worked(evidence: Evidence) -> Result:
    return work_out(evidence, utc="2026-01-01T00:00:00Z", version="0")


def judged(evidence: Evidence) -> dict[str, bool]:
    return {finding.name: finding.ok for finding in verdict(worked(evidence))}


def test_a_board_that_was_measured_well_is_good_in_every_part(measured):
    assert judged(measured) == {"accelerometer": True, "gyroscope bias": True, "gyroscope scale": True}


def test_what_the_file_keeps_gives_the_same_calibration(measured):
    assert worked(copied(measured)).record == worked(measured).record


def test_a_force_that_moved_since_is_not_good_enough(measured):
    moved = copied(measured)
    shift = 0.02 * STANDARD_GRAVITY_M_S2
    moved.check = [
        replace(pose, accel_m_s2=(x + shift, y + shift, z + shift))
        for pose in moved.check
        for x, y, z in [pose.accel_m_s2]
    ]
    assert judged(moved)["accelerometer"] is False


def test_a_bias_that_moved_since_is_not_good_enough(measured):
    moved = copied(measured)
    shift = 0.2 * RAD_PER_DEG
    moved.check = [replace(pose, gyro_rad_s=(x + shift, y, z)) for pose in moved.check for x, y, z in [pose.gyro_rad_s]]
    findings = {finding.name: finding for finding in verdict(worked(moved))}
    assert not findings["gyroscope bias"].ok
    assert findings["gyroscope bias"].advice


def test_without_poses_held_out_nothing_is_called_good(measured):
    unchecked = copied(measured)
    unchecked.check = []
    assert judged(unchecked)["accelerometer"] is False
    assert judged(unchecked)["gyroscope bias"] is False


def test_what_was_not_asked_for_is_neither_kept_nor_judged(measured):
    part = copied(measured)
    part.done.remove("rest")
    part.told, part.moves = [], []
    result = worked(part)
    assert (result.record.gyro_bias, result.record.gyro_scale) == (None, None)
    assert list(judged(part)) == ["accelerometer"]


def test_nothing_measured_is_not_good(measured):
    assert judged(Evidence(chip=measured.chip)) == {"calibration": False}


def test_the_poses_held_out_are_in_no_fit(measured):
    result, without = worked(measured), copied(measured)
    without.check = without.check[:1]
    assert worked(without).record.accelerometer == result.record.accelerometer
    assert worked(without).record.gyro_scale == result.record.gyro_scale


def test_a_recordings_turns_are_found_without_anybody_asking(tmp_path):
    blocks = []
    bench = Bench(["turns"], out=tmp_path / "c", seed=3)
    read = bench.source.read

    def kept():
        blocks.append(read())
        return blocks[-1]

    bench.source.read = kept
    assert bench.conduct()
    found = evidence_of([block for block in blocks if len(block)], bench.chip)
    assert len(found.told) == 6
    for evidence in (found, bench.evidence):
        # Three faces do not calibrate an accelerometer, and one that is degrees off must not bend the turns.
        record = worked(evidence).record
        assert record.accelerometer is None
        scale = np.diag(np.array(record.gyro_scale.matrix))
        assert scale * bench.bus.sensor.gyro_scale == pytest.approx(1.0, abs=3e-3)
