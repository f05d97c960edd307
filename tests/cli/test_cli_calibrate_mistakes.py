"""What a person does wrong at `quavelet calibrate`: told at once, in a sentence, with nothing made or lost."""

from __future__ import annotations

from pathlib import Path

import pytest
from program import quavelet

from quavelet.cli import exits

BENCH = ("--bus", "fake:bench:7", "--yes", "--virtual-time")


@pytest.mark.parametrize(
    ("arguments", "code", "reason"),
    [
        ((*BENCH, "--steps", "dance", "--out", "c.toml"), exits.SETTINGS, "there is no step 'dance': take some of"),
        ((*BENCH, "--steps", " , ", "--out", "c.toml"), exits.SETTINGS, "a session without a step measures nothing"),
        ((*BENCH, "--out", "none/deep/c.toml", "--resume"), exits.FAILED, "there is no session none/deep"),
        ((*BENCH, "--out", "/dev/null"), exits.FAILED, "/dev/null: is a device or a pipe"),
        ((*BENCH, "--out", "/proc/c.toml"), exits.FAILED, "/proc/c.toml: cannot be written"),
        ((*BENCH, "--out", "c.toml", "--report", "/proc/page.html"), exits.FAILED, "/proc/page.html cannot be written"),
        ((*BENCH, "--out", "c.toml", "--report", "."), exits.FAILED, ". is a folder"),
        (
            ("--bus", "fake:tilt", "--yes", "--virtual-time", "--steps", "faces", "--out", "c.toml"),
            exits.SETTINGS,
            "somebody must move that of fake:tilt: leave --yes out",
        ),
        (("--bus", "linux:77", "--out", "c.toml", "--yes"), exits.NO_DEVICE, "there is no bus /dev/i2c-77"),
    ],
)
def test_it_is_refused_before_anything_is_measured_or_made(tmp_path, monkeypatch, arguments, code, reason):
    monkeypatch.chdir(tmp_path)
    done = quavelet("calibrate", *arguments)
    assert (done.code, done.out) == (code, ""), done.err
    assert len(done.said) == 1
    assert reason in done.said[0]
    assert list(tmp_path.iterdir()) == []
    assert Path("/dev/null").is_char_device()


def test_a_folder_that_is_not_there_is_made(tmp_path):
    done = quavelet("calibrate", *BENCH, "--steps", "WARM-UP", "--out", tmp_path / "a" / "b" / "c.toml")
    assert done.code in (exits.OK, exits.VERDICT_FAILED), done.err
    assert (tmp_path / "a" / "b").is_dir()


def test_a_session_of_another_board_is_not_gone_on_with_and_stays(tmp_path):
    out = tmp_path / "c.toml"
    done = quavelet("calibrate", *BENCH, "--steps", "rest", "--out", out)
    assert done.code == exits.VERDICT_FAILED, "a board that is not warm"
    kept = out.with_name("c.toml.session").read_bytes()
    other = quavelet("calibrate", "--bus", "fake:bench:8", *BENCH[2:], "--steps", "rest", "--out", out, "--resume")
    assert other.code == exits.FAILED
    assert "is of another chip" in other.said[0]
    assert out.with_name("c.toml.session").read_bytes() == kept
