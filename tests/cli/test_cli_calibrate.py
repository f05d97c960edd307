"""`quavelet calibrate` as it is installed: on the fake bench against known truth, interrupted, refused, replayed."""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
from pathlib import Path

import msgspec
import numpy as np
import pytest
from program import PROGRAM, Done, quavelet

from hw_fakes.wire.bench import BenchBus
from quavelet.calibration.record_file import file_name, load_record, save_record
from quavelet.cli import exits
from quavelet.core.clock import VirtualClock
from quavelet.core.units import DEG_PER_RAD, STANDARD_GRAVITY_M_S2

BENCH = ("calibrate", "--bus", "fake:bench:7", "--yes", "--virtual-time")


@pytest.fixture(scope="module")
def calibrated(tmp_path_factory: pytest.TempPathFactory) -> tuple[Done, Path]:
    """The whole usual session on one board, in virtual time."""
    out = tmp_path_factory.mktemp("calibrated") / "board.toml"
    report = tmp_path_factory.mktemp("report") / "page.html"
    done = quavelet(*BENCH, "--out", out, "--json", "--report", report)
    out.with_suffix(".page").symlink_to(report)
    return done, out


def test_the_tool_finds_the_fake_boards_truth_and_saves_it(calibrated):
    done, out = calibrated
    assert done.code == exits.OK, done.err
    told = json.loads(done.out)
    assert (told["verdict"], told["saved"], told["reason"]) == ("good", str(out), "")
    found, truth = load_record(out).calibration(), BenchBus(clock=VirtualClock(), seed=7).sensor
    left = np.array(found.accel_offset_m_s2) - truth.accel_bias_m_s2
    assert np.abs(left).max() < 3e-3 * STANDARD_GRAVITY_M_S2
    accel = np.array(found.accel_matrix) @ (np.diag(truth.accel_scale) + np.array(truth.accel_cross_axis))
    gyro = np.array(found.gyro_matrix) @ (np.diag(truth.gyro_scale) + np.array(truth.gyro_cross_axis))
    for product in (accel, gyro):
        assert np.diag(product) == pytest.approx(1.0, abs=3e-3)
        assert np.abs(product - np.diag(np.diag(product))).max() * DEG_PER_RAD < 0.3
    warm = 30.0
    bias = np.array(truth.gyro_bias_rad_s) + (warm - truth.bias_temp_degc) * np.array(truth.gyro_bias_rad_s_degc)
    assert found.gyro_bias_curve is not None
    assert found.gyro_bias_curve.at(np.array([warm]))[0] * DEG_PER_RAD == pytest.approx(bias * DEG_PER_RAD, abs=0.02)


def test_the_session_is_told_on_stderr_step_by_step_and_its_file_is_gone(calibrated):
    done, out = calibrated
    assert any("step 1 of 6: Warm-up" in line for line in done.said)
    assert any("Stand it on edge so that the arrow printed X points straight down" in line for line in done.said)
    assert sorted(path.name for path in out.parent.iterdir()) == ["board.page", "board.toml"]


def test_the_page_stands_by_itself_and_shows_every_step_with_its_verdict(calibrated):
    page = calibrated[1].with_suffix(".page").read_text()
    for title in ("Verdict", "Accelerometer", "Gyroscope bias", "Gyroscope scale"):
        assert f"<h2>{title}</h2>" in page
    assert page.count("<svg") == 4 + 5 + 1
    assert not re.search(r"""(src|href)\s*=\s*["']?(https?:)?//""", page)
    assert "NOT A REAL ONE" in page
    assert "held out" in page


def test_before_and_after_are_of_poses_held_out_and_of_the_data_sheet(calibrated):
    told = json.loads(calibrated[0].out)
    figures = {finding["name"]: finding["figures"] for finding in told["findings"] if finding["figures"]}
    assert figures["accelerometer"]["after_mg"] < 1.0 < 10.0 < figures["accelerometer"]["before_mg"]
    assert figures["gyroscope bias"]["after_dps"] < 0.02 < 1.0 < figures["gyroscope bias"]["before_dps"]


def test_run_finds_the_calibration_by_the_chip_and_says_so(calibrated, tmp_path):
    record = load_record(calibrated[1])
    place = tmp_path / "quavelet" / "calibration" / file_name(record.chip)
    place.parent.mkdir(parents=True)
    place.write_bytes(calibrated[1].read_bytes())
    env = {**os.environ, "XDG_CONFIG_HOME": str(tmp_path)}
    done = quavelet("run", "--bus", "fake:bench:7", "--virtual-time", "--duration", 4, env=env)
    assert any(str(place) in line and record.made.utc in line for line in done.said), done.err
    forces = np.mean([json.loads(line)["accel_m_s2"] for line in done.lines[-100:]], axis=0)
    assert float(np.linalg.norm(forces)) == pytest.approx(STANDARD_GRAVITY_M_S2, rel=3e-3)
    other = quavelet("run", "--bus", "fake:bench:8", "--virtual-time", "--duration", 1, env=env)
    assert not any(str(place) in line for line in other.said)


def test_a_calibration_that_is_worse_is_not_put_in_the_place_of_a_better_one_unasked(calibrated, tmp_path):
    better = calibrated[1].read_bytes()
    out = tmp_path / "board.toml"
    out.write_bytes(better)
    done = quavelet(*BENCH, "--out", out, "--steps", "rest")
    assert done.code == exits.VERDICT_FAILED
    assert "its bias is known over" in done.out
    assert "nothing is saved" in done.out
    assert out.read_bytes() == better
    done = quavelet(*BENCH, "--out", out, "--steps", "rest", "--resume", "--force")
    forced, before = load_record(out), load_record(calibrated[1])
    assert forced.gyro_bias != before.gyro_bias
    assert forced.accelerometer == before.accelerometer


def test_some_steps_over_an_older_calibration_keep_what_they_do_not_measure(calibrated, tmp_path):
    out, older = tmp_path / "board.toml", load_record(calibrated[1])
    loose = msgspec.structs.replace(older.gyro_scale, scale_sigma=0.01)
    save_record(msgspec.structs.replace(older, gyro_scale=loose), out)
    done = quavelet(*BENCH, "--out", out, "--steps", "turns", "--json")
    told = json.loads(done.out)
    assert (done.code, told["verdict"]) == (exits.OK, "good"), done.out
    found = {finding["name"]: finding["found"] for finding in told["findings"]}
    for part in ("accelerometer", "gyroscope bias"):
        assert found[part] == f"kept from {older.made.utc}"
    record = load_record(out)
    assert (record.accelerometer, record.gyro_bias) == (older.accelerometer, older.gyro_bias)
    assert record.made_of("gyro_bias") == older.made
    # Three faces do not show the gyroscope's axes: they are known from before.
    truth = BenchBus(clock=VirtualClock(), seed=7).sensor
    gyro = np.array(record.gyro_scale.matrix) @ (np.diag(truth.gyro_scale) + np.array(truth.gyro_cross_axis))
    assert np.diag(gyro) == pytest.approx(1.0, abs=3e-3)
    assert np.abs(gyro - np.diag(np.diag(gyro))).max() * DEG_PER_RAD < 0.3
    nothing = quavelet(*BENCH, "--out", out, "--steps", "warm-up")
    assert "nothing was measured" in nothing.out
    assert load_record(out) == record


def test_an_older_calibration_for_another_range_is_not_mixed_with_some_steps(calibrated, tmp_path):
    out, older = tmp_path / "board.toml", load_record(calibrated[1])
    save_record(msgspec.structs.replace(older, made=msgspec.structs.replace(older.made, gyro_range_dps=250)), out)
    before = out.read_bytes()
    done = quavelet(*BENCH, "--out", out, "--steps", "rest")
    assert any("nothing is kept of the calibration that is there: it was made at 250 deg/s" in x for x in done.said)
    assert (done.code, out.read_bytes()) == (exits.VERDICT_FAILED, before)


def test_another_chips_calibration_is_not_measured_over(calibrated, tmp_path):
    out = tmp_path / "board.toml"
    out.write_bytes(calibrated[1].read_bytes())
    done = quavelet("calibrate", "--bus", "fake:bench:8", "--yes", "--virtual-time", "--out", out, "--steps", "rest")
    assert (done.code, done.out) == (exits.FAILED, "")
    assert done.said == [f"quavelet: {out}: is the calibration of another chip: give another place with --out"]


def test_whether_it_can_be_saved_is_known_before_anything_is_measured(tmp_path):
    done = quavelet(*BENCH, "--out", tmp_path)
    assert (done.code, done.out) == (exits.FAILED, "")
    assert done.said == [f"quavelet: {tmp_path}: is a folder: give the path of a file"]


def test_ctrl_c_keeps_what_was_measured_and_resume_goes_on_with_it(tmp_path):
    out = tmp_path / "board.toml"
    command = [PROGRAM, "calibrate", "--bus", "fake:bench:7", "--yes", "--out", str(out), "--steps", "faces"]
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True) as running:
        assert running.stderr is not None
        said = ""
        while "half round" not in said:  # asked for once the first face is measured
            line = running.stderr.readline()
            assert line, said
            said += line
        running.send_signal(signal.SIGINT)
        said += running.stderr.read()
    assert running.returncode == exits.INTERRUPTED
    assert "--resume" in said
    assert not out.exists()
    assert out.with_name("board.toml.session").exists()
    refused = quavelet(*BENCH, "--out", out, "--steps", "faces")
    assert refused.code == exits.FAILED
    assert "holds what was measured before" in refused.said[-1]
    done = quavelet(*BENCH, "--out", out, "--steps", "faces", "--resume", "--json")
    assert done.code == exits.OK, done.err
    assert sum("Leave Z pointing up" in line for line in done.said) <= 1
    assert [path.name for path in tmp_path.iterdir()] == ["board.toml"]


def test_a_fake_bench_without_yes_is_not_waited_for(tmp_path):
    done = quavelet("calibrate", "--bus", "fake:bench", "--out", tmp_path / "c.toml")
    assert done.code == exits.SETTINGS
    assert done.said == ["quavelet: nobody moves the board of fake:bench by hand: give --yes, and it moves itself"]


def test_a_step_that_there_is_not_is_a_settings_error(tmp_path):
    done = quavelet(*BENCH, "--out", tmp_path / "c.toml", "--steps", "faces,dance")
    assert done.code == exits.SETTINGS
    assert "there is no step 'dance'" in done.said[0]


def test_a_recording_stands_in_for_the_board(tmp_path):
    recording, out = tmp_path / "faces.qrec", tmp_path / "c.toml"
    config = tmp_path / "slow.toml"
    config.write_text("[chip]\nsample_rate_hz = 100.0\n[loop]\nrate_hz = 10.0\n")
    made = quavelet(
        "run", "--bus", "fake:faces", "--virtual-time", "--duration", 75, "--record", recording, "--config", config
    )
    assert made.code == exits.OK
    done = quavelet("calibrate", "--from", recording, "--out", out, "--json")
    told = json.loads(done.out)
    assert told["src"] == "replay:fake:faces"
    assert done.code == exits.OK, told["reason"]
    figures = {finding["name"]: finding["figures"] for finding in told["findings"]}
    assert figures["accelerometer"]["after_mg"] < 3.0 < 10.0 < figures["accelerometer"]["before_mg"]
    assert load_record(out).accelerometer.frame == "sensor"
    nowhere = quavelet("calibrate", "--from", recording)
    assert nowhere.code == exits.USAGE
    assert "give --out" in nowhere.said[0]


def test_lines_for_a_person_end_with_the_verdict(tmp_path):
    done = quavelet(*BENCH, "--out", tmp_path / "c.toml", "--steps", "faces")
    assert done.code == exits.OK, done.out
    assert done.lines[0].startswith("ok   accelerometer")
    assert done.lines[-1].startswith("ok   verdict")
    assert "NOT A REAL ONE" in done.lines[-1]
