"""The program of the room's README runs, and what it names is there."""

from __future__ import annotations

import re
from importlib import import_module
from pathlib import Path

ROOM = Path(__file__).resolve().parents[2] / "src/quavelet/alignment"
README = (ROOM / "README.md").read_text(encoding="utf-8")


def test_the_program_prints_a_heading_and_how_good_it_is():
    (program,) = re.findall(r"```python\n(.*?)```", README, re.DOTALL)
    said: list[str] = []
    exec(compile(program, "README.md", "exec"), {"print": lambda *words: said.append(" ".join(map(str, words)))})
    (line,) = said
    assert line.startswith("observed [0.3 0.3 ")
    assert "uT of error in 1" in line or "uT of error in 2" in line


def test_everything_the_readme_names_is_there():
    names = re.findall(r"`([a-z_]+)\.(\w+)`", README)
    assert len(names) > 5
    for module, name in names:
        if module != "quavelet":
            assert hasattr(import_module(f"quavelet.alignment.{module}"), name), (module, name)
