"""The README's program runs, and its commands are what .ci/run runs."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

import quavelet
from quavelet.core.clock import VirtualClock

ROOT = Path(__file__).resolve().parents[1]
README = (ROOT / "README.md").read_text(encoding="utf-8")


class Enough(Exception):
    """The program goes on for ever; the test does not."""


def test_the_first_program_of_the_readme_prints_angles(monkeypatch):
    (program,) = re.findall(r"```python\n(.*?)```", README, re.DOTALL)
    assert len(program.splitlines()) <= 10
    lines: list[str] = []

    def keep(*words: object) -> None:
        lines.append(" ".join(map(str, words)))
        if len(lines) == 1000:
            raise Enough

    real_open = quavelet.open
    monkeypatch.setattr(quavelet, "open", lambda bus: real_open(bus, clock=VirtualClock()))
    with pytest.raises(Enough):
        exec(compile(program, "README.md", "exec"), {"print": keep})
    assert lines[0].startswith("not yet: ")
    assert re.fullmatch(r"roll [+-]\d+\.\d\d pitch [+-]\d+\.\d\d \+- \d\.\d\d deg", lines[-1])


def test_ci_runs_the_readmes_two_commands():
    commands = re.findall(r"^python3 -m venv \.venv && .*$", README, re.MULTILINE)
    assert [("demo" in c, "pytest" in c) for c in commands] == [(True, False), (False, True)]


def test_the_first_screen_has_the_sentence_the_program_and_both_commands():
    assert README.index("python -m pytest") < README.index("## ")
    assert README[: README.index("## ")].count("\n") < 50


def test_every_file_the_readme_names_is_there():
    for link in re.findall(r"\]\((?!http)([^)#]+)\)", README):
        assert (ROOT / link).exists(), link
    for path in re.findall(r"`(tests/[\w/]+\.py)`", README):
        assert (ROOT / path).exists(), path


def test_all_flags_are_explained():
    from quavelet.core.blocks import Flag

    for name in Flag.names(int(sum(Flag))):
        assert f"`{name}`" in README, name
