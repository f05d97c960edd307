"""A disk that takes no more, by the kernel's own limit on a file's size: nothing is lost, and it is said what to do."""

from __future__ import annotations

import resource
import tempfile
from pathlib import Path

import msgspec
import pytest
from full_disk import files_up_to
from session_rig import Bench
from typer.testing import CliRunner

from quavelet.bench.session_store import SessionStore
from quavelet.calibration.record_file import load_record
from quavelet.cli import calibrate, exits
from quavelet.cli.app import app
from quavelet.core.errors import CalibrationError

FULL_BYTES = 1000


@pytest.fixture
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The user's own folder; temporary ones are beside it."""
    for name in ("home", "temporary"):
        (tmp_path / name).mkdir()
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "temporary"))
    return tmp_path / "home"


def measured(bench: Bench, faces: int) -> None:
    assert not bench.conduct(stopped=lambda: len(bench.evidence.placed) == faces)


def test_a_disk_that_fills_up_in_the_middle_leaves_the_session_from_before_to_go_on_with(tmp_path):
    out = tmp_path / "out" / "c.toml"
    out.parent.mkdir()
    first = Bench(["faces"], out=out)
    measured(first, 2)
    with files_up_to(FULL_BYTES):
        measured(first, 8)
    assert any(f"{out}.session cannot be written (File too large): make room" in told for told in first.notices)
    assert [path.name for path in out.parent.iterdir()] == ["c.toml.session"]
    kept = SessionStore(out).load(first.chip)
    assert len(kept.placed) == 2
    second = Bench(["faces"], out=out, evidence=kept)
    assert second.conduct()
    assert second.evidence.placed[:2] == first.evidence.placed[:2]


def test_room_that_is_made_in_time_saves_all(tmp_path):
    out = tmp_path / "c.toml"
    bench = Bench(["faces"], out=out)
    with files_up_to(FULL_BYTES):
        measured(bench, 2)
    assert bench.store.last_words(then="go on") == f"what was measured is kept in {out}.session: go on"
    assert SessionStore(out).load(bench.chip) == bench.evidence


def test_a_session_that_its_folder_does_not_take_is_kept_in_another(tmp_path, home):
    out = tmp_path / "c.toml"
    bench = Bench(["faces"], out=out)
    beside = out.with_name("c.toml.session.new")
    beside.mkdir()
    measured(bench, 2)
    words = bench.store.last_words(then="go on")
    assert f"{out}.session cannot be written" in words
    assert f"kept in {home / 'c.toml.session'}; make room, move it there, and go on" in words
    beside.rmdir()
    (home / "c.toml.session").rename(out.with_name("c.toml.session"))
    assert SessionStore(out).load(bench.chip) == bench.evidence


def test_a_session_that_nothing_takes_is_not_said_to_be_kept(tmp_path, home):
    bench = Bench(["faces"], out=tmp_path / "c.toml")
    with files_up_to(100):
        measured(bench, 1)
        words = bench.store.last_words(then="go on")
    assert words.endswith("nor anywhere else: what was measured is lost; make room, and begin anew")
    assert list(home.iterdir()) == []
    assert list(tmp_path.glob("temporary/*")) == []


def test_a_calibration_that_cannot_be_saved_is_saved_by_resuming_without_measuring_again(tmp_path, monkeypatch):
    out = tmp_path / "c.toml"
    out.write_text("of before")
    command = ["calibrate", "--bus", "fake:bench:7", "--yes", "--virtual-time", "--steps", "warm-up,rest"]
    old = resource.getrlimit(resource.RLIMIT_FSIZE)
    conduct = calibrate.conduct

    def fills_up(*arguments, **others):
        finished = conduct(*arguments, **others)
        resource.setrlimit(resource.RLIMIT_FSIZE, (FULL_BYTES, old[1]))
        return finished

    monkeypatch.setattr(calibrate, "conduct", fills_up)
    try:
        done = CliRunner().invoke(app, [*command, "--out", str(out)])
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, old)
    monkeypatch.undo()
    assert "cannot be written (File too large)" in str(done.exception)
    assert out.read_text() == "of before"
    assert f"{out}.session: the same command with --resume goes on with it" in done.stderr
    again = CliRunner().invoke(app, [*command, "--out", str(out), "--resume"])
    assert again.exit_code == exits.OK, again.output
    assert "Lean" not in again.stderr
    assert load_record(out).gyro_bias is not None
    assert sorted(path.name for path in tmp_path.iterdir()) == ["c.toml"]


def test_a_session_in_which_nothing_was_measured_leaves_no_file(tmp_path):
    bench = Bench(["poses"], out=tmp_path / "c.toml")
    assert not bench.conduct(stopped=lambda: bench.s > 6.0)
    assert bench.evidence.count() == 0
    assert bench.store.last_words(then="go on") == ""
    assert list(tmp_path.iterdir()) == []


def test_a_session_is_gone_on_with_on_whatever_bus_its_chip_is_plugged_in(tmp_path):
    bench = Bench(["faces"], out=tmp_path / "c.toml")
    known = msgspec.structs.replace(bench.chip.identity, fingerprint="0a0b")
    bench.evidence.chip = msgspec.structs.replace(bench.chip, identity=known)
    measured(bench, 2)
    elsewhere = msgspec.structs.replace(known, bus="fake:other", address=0x69)
    chip = msgspec.structs.replace(bench.chip, identity=elsewhere)
    kept = SessionStore(tmp_path / "c.toml").load(chip)
    assert (len(kept.placed), kept.chip) == (2, chip)
    for changed in ({"fingerprint": "0a0c"}, {"bus": "linux:1"}, {"who_am_i": 0x70}):
        other = msgspec.structs.replace(chip, identity=msgspec.structs.replace(elsewhere, **changed))
        with pytest.raises(CalibrationError, match="another chip"):
            SessionStore(tmp_path / "c.toml").load(other)
