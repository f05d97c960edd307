"""The page's example runs, and the tests it names are there."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import hw_fakes
from hw_fakes.faults.plan import KINDS
from hw_fakes.scenarios import MOTIONS

PAGE = Path(hw_fakes.__file__).with_name("README.md").read_text(encoding="utf-8")
TESTS = Path(__file__).resolve().parents[1]


def test_example_of_the_page_passes():
    (example,) = [code for part in PAGE.split("```python\n")[1:] if "VirtualClock()" in (code := part.split("```")[0])]
    names: dict[str, Any] = {}
    exec(example, names)
    tests = [value for name, value in names.items() if name.startswith("test_")]
    assert tests
    for test in tests:
        test()


def test_page_names_a_test_that_is_not_there():
    written = {name for path in TESTS.rglob("test_*.py") for name in re.findall(r"def (test_\w+)", path.read_text())}
    named = set(re.findall(r"`(test_\w+)`", PAGE))
    assert len(named) > 50
    assert named <= written


def test_page_leaves_out_a_fault_or_a_scenario():
    rows = [line.split("|")[1] for line in PAGE.splitlines() if line.startswith("| `")]
    words = {word for row in rows for name in re.findall(r"`([^`]+)`", row) for word in name.split()[:1]}
    assert {*KINDS, *MOTIONS} <= words
