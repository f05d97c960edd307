"""The program of the room's README runs and finds what it put in; every name it gives is there."""

from __future__ import annotations

import re
from pathlib import Path

import quavelet.calibration

ROOM = Path(quavelet.calibration.__file__).parent
README = (ROOM / "README.md").read_text(encoding="utf-8")


def test_the_program_finds_the_offset_it_put_in():
    (program,) = re.findall(r"```python\n(.*?)```", README, re.DOTALL)
    lines: list[str] = []
    exec(compile(program, "README.md", "exec"), {"print": lambda *words: lines.append(" ".join(map(str, words)))})
    x, y, z = map(float, re.findall(r"-?\d+\.\d*", lines[0])[:3])
    assert abs(x - 0.3) < 0.01
    assert abs(y + 0.2) < 0.01
    assert abs(z - 0.5) < 0.01
    assert lines[0].endswith("sensor ()")


def test_every_function_and_file_it_names_is_there():
    source = "".join(path.read_text(encoding="utf-8") for path in ROOM.glob("*.py"))
    for name in re.findall(r"`([a-z]+_[a-z_]+)(?:\([a-z]*\))?`", README):
        assert name in source or name == "uncalibrated_temperature", name
    root = ROOM.parents[2]
    for path in re.findall(r"`(?:python )?(tests/[\w/]+\.py)`", README):
        assert (root / path).exists(), path
