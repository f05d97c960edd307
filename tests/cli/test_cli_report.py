"""`quavelet report`: one page for any recordings, figures on stdout, and one sentence for what is none."""

from __future__ import annotations

import json
import re
import sys
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from quavelet.cli import exits
from quavelet.cli.app import app


def report(*arguments: object):
    return CliRunner().invoke(app, ["report", *map(str, arguments)])


@pytest.fixture(scope="module")
def trial(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Twenty seconds at rest, then a roll of 10 deg and back, with the truth beside it."""
    n, fs = 3000, 100.0
    t_s = np.arange(n) / fs
    rng = np.random.default_rng(1)
    roll = np.radians(10.0) * np.sin(2 * np.pi * 0.1 * (t_s - 20.0)) * (t_s > 20.0)
    rate = np.column_stack([np.gradient(roll, t_s), 0 * t_s, 0 * t_s]) + rng.normal(0, np.radians(0.05), (n, 3))
    force = 9.80665 * np.column_stack([0 * t_s, np.sin(roll), np.cos(roll)]) + rng.normal(0, 0.03, (n, 3))
    q = np.column_stack([np.cos(roll / 2), np.sin(roll / 2), 0 * t_s, 0 * t_s])
    path = tmp_path_factory.mktemp("trial") / "trial & <truth>.npz"
    np.savez(path, gyro_rad_s=rate, acc_m_s2=force, fs=fs, q_ref=q)
    return path


def test_a_recording_and_a_trial_become_one_page_with_a_section_each(recording, trial, tmp_path):
    page = tmp_path / "page.html"
    done = report(recording, trial, "--out", page)
    assert (done.exit_code, done.stderr) == (exits.OK, f"quavelet: {page} written\n")
    text = page.read_text()
    assert text.count("<section") == 2
    assert "<truth>" not in text
    assert re.findall(r"\b(?:src|href)=\"(?!#)[^\"]*", text) == []
    assert text.count("Allan deviation of the gyroscope") >= 1
    rows = [line for line in done.stdout.splitlines() if line.startswith("rms tilt error")]
    assert len(rows) == 1


def test_the_figures_are_those_of_the_noise_and_the_tilt_that_went_in(trial, tmp_path):
    done = report(trial, "--json", "--out", tmp_path / "page.html")
    (found,) = [json.loads(line) for line in done.stdout.splitlines()]
    assert found["seconds"] == pytest.approx(29.99)
    by_name = {method["name"]: method for method in found["methods"]}
    assert list(by_name) == ["default", "accelerometer", "gyro", "P", "PID", "wavelet PID", "fusion"]
    assert by_name["accelerometer"]["heading error at the end, deg"] is None
    assert by_name["default"]["rms tilt error, deg"] < 0.5
    assert by_name["default"]["apart from the default, rms deg"] == pytest.approx(0.0, abs=1e-6)
    gyro = [axis for axis in found["noise"] if axis["sensor"] == "gyroscope"]
    for axis in gyro:
        assert np.degrees(axis["density"]["value"]) == pytest.approx(0.05 / np.sqrt(50), rel=0.2)
        assert axis["word"] == "good"


def test_what_is_no_recording_is_one_sentence_and_the_others_are_reported(recording, tmp_path):
    bad = tmp_path / "bad.qrec"
    bad.write_bytes(b"not a recording")
    page = tmp_path / "page.html"
    done = report(bad, recording, "--out", page)
    assert done.exit_code == exits.FAILED
    said = done.stderr.splitlines()
    assert len(said) == 2
    assert str(bad) in said[1]
    assert page.read_text().count("<section") == 1


def test_nothing_to_report_writes_no_page(tmp_path):
    done = report(tmp_path / "missing.qrec", "--out", tmp_path / "page.html")
    assert (done.exit_code, done.stdout) == (exits.FAILED, "")
    assert done.stderr == f"quavelet: there is no recording {tmp_path / 'missing.qrec'}: check the name\n"
    assert not (tmp_path / "page.html").exists()


def test_a_cut_recording_is_reported_as_far_as_it_goes_and_is_a_failure(recording, tmp_path):
    cut = tmp_path / "cut.qrec"
    content = recording.read_bytes()
    cut.write_bytes(content[: len(content) * 9 // 10])
    done = report(cut, "--out", tmp_path / "page.html")
    assert done.exit_code == exits.FAILED
    assert "cut off" in done.stderr
    assert "cut off" in (tmp_path / "page.html").read_text()
    assert "vertical against the accelerometer" in done.stdout


def test_a_page_that_cannot_be_written_is_one_sentence(recording):
    done = report(recording, "--out", recording / "page.html")
    assert "cannot be written" in str(done.exception)


def test_without_matplotlib_it_says_what_to_install(recording, monkeypatch):
    monkeypatch.delitem(sys.modules, "quavelet.drawing.plot", raising=False)
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    done = report(recording)
    assert "pip install 'quavelet[report]'" in str(done.exception)
