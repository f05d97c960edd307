"""`quavelet reproduce`: rows on stdout, talk on stderr, and an exit code that says whether all held."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from program import quavelet
from typer.testing import CliRunner

from quavelet.cli import exits
from quavelet.cli.app import app
from quavelet.study import papers

STUDY = str(Path(__file__).resolve().parents[1] / "study")


@pytest.fixture
def fakes(monkeypatch):
    """Two small experiments in place of papers 000 and 001; 001 has a row outside its band."""
    monkeypatch.syspath_prepend(STUDY)
    import fake_experiments as fake

    found = {"000": fake.WELL, "001": fake.OUTSIDE}
    monkeypatch.setattr(papers, "NUMBERS", tuple(found))
    monkeypatch.setattr(papers, "experiment", found.__getitem__)
    return fake


def reproduce(*arguments: object):
    return CliRunner().invoke(app, ["reproduce", *map(str, arguments)])


@pytest.mark.usefixtures("fakes")
def test_rows_are_printed_beside_what_the_paper_prints():
    done = reproduce("000")
    assert done.exit_code == exits.OK, done.output
    (line,) = [line for line in done.stdout.splitlines() if line.startswith("T1.1")]
    assert line.split("  ")[0] == "T1.1"
    for words in ("method 1, largest error, pitch", ".0412", "0.601 deg", "refuted"):
        assert words in line
    assert "- Eq. 4 lacks a factor 2." in done.stdout.splitlines()


@pytest.mark.usefixtures("fakes")
def test_a_row_outside_its_band_is_exit_code_6_and_is_named():
    done = reproduce("all")
    assert done.exit_code == exits.VERDICT_FAILED
    assert "outside its band: 0b noise of method 3. It should be less." in done.stdout
    assert "quavelet: 1 rows are outside their bands: 001 0b" in done.stderr


@pytest.mark.usefixtures("fakes")
def test_json_has_one_object_a_row_and_no_number_is_invented():
    done = reproduce("--json", "--quick")
    rows = [json.loads(line) for line in done.stdout.splitlines()]
    assert [(row["paper"], row["id"]) for row in rows] == [
        ("000", "T1.1"), ("000", "0a"), ("000", "0n"), ("000", "1a"), ("001", "0a"), ("001", "0b"),
    ]  # fmt: skip
    by_id = {row["id"]: row for row in rows}
    assert by_id["0n"]["got"] is None
    assert by_id["1a"]["low"] is None
    assert by_id["1a"]["what"] == "mean of the quick run"
    assert [row["id"] for row in rows if not row["passed"]] == ["0b"]


@pytest.mark.usefixtures("fakes")
def test_out_gets_the_page_and_each_figure_twice(tmp_path):
    done = reproduce("000", "--out", tmp_path / "new" / "folder")
    assert done.exit_code == exits.OK, done.output
    names = sorted(file.name for file in (tmp_path / "new" / "folder").iterdir())
    assert names == ["000-walk.png", "000-walk.svg", "index.html"]
    assert "refuted" in (tmp_path / "new" / "folder" / "index.html").read_text()


@pytest.mark.usefixtures("fakes")
def test_without_matplotlib_the_tables_are_printed_and_only_out_is_refused(monkeypatch, tmp_path):
    monkeypatch.delitem(sys.modules, "quavelet.drawing.plot", raising=False)
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    assert "0.601 deg" in reproduce("000").stdout
    done = reproduce("000", "--out", tmp_path)
    assert "pip install 'quavelet[report]'" in str(done.exception)
    assert done.stdout == ""


def test_a_paper_that_does_not_exist_is_a_usage_error():
    done = quavelet("reproduce", "007")
    assert (done.code, done.out) == (exits.USAGE, "")
    assert done.said == [
        "quavelet: Invalid value: '007' is not a paper: give 000, 001, 002, 003, 004 or all, "
        "see `quavelet reproduce --help`"
    ]


def test_ctrl_c_ends_all_of_it_without_a_trace():
    script = (
        "import sys; sys.path.insert(0, sys.argv.pop(1));"
        "import fake_experiments as fake; from quavelet.study import papers; from quavelet.cli.app import main;"
        "papers.experiment = lambda number: fake.named(number, fake.endless if number == '001' else fake.well);"
        "main()"
    )
    command = [sys.executable, "-c", script, STUDY, "reproduce", "000", "001"]
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, process_group=0
    ) as process:
        assert process.stdout is not None
        assert process.stdout.readline().startswith("000")
        time.sleep(0.2)
        os.killpg(process.pid, signal.SIGINT)
        _, said = process.communicate(timeout=20)
    assert process.returncode == exits.INTERRUPTED
    assert said == ""


def judged(*arguments: object) -> list[dict]:
    """The rows of the real papers, all of which must be in their bands."""
    done = CliRunner().invoke(app, ["reproduce", "--json", *map(str, arguments)])
    rows = [json.loads(line) for line in done.stdout.splitlines()]
    outside = [(row["paper"], row["id"], row["what"], row["got"]) for row in rows if not row["passed"]]
    assert outside == []
    assert done.exit_code == exits.OK, done.output
    return rows


def test_a_paper_of_the_study_is_in_its_bands_in_its_quick_form():
    rows = judged("004", "--quick")
    assert {row["verdict"] for row in rows} >= {"", "reproduced", "refuted", "only under a reading"}


@pytest.mark.slow
def test_all_papers_are_in_their_bands_in_their_quick_form():
    assert {row["paper"] for row in judged("all", "--quick")} == set(papers.NUMBERS)


@pytest.mark.slow
@pytest.mark.timeout(1800)
def test_all_papers_are_in_their_bands(tmp_path):
    rows = judged("all", "--out", tmp_path)
    ids = {row["id"] for row in rows}
    wanted = {
        f"{paper}{letter}"
        for paper, letters in (
            ("G", "123"),
            ("0", "abcdefghij"),
            ("1", "abcde"),
            ("2", "abcdef"),
            ("3", "abcde"),
            ("4", "abcde"),
        )
        for letter in letters
    }
    assert wanted - ids == set()
    assert (tmp_path / "index.html").stat().st_size < 10e6
