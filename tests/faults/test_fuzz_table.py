"""The table of untrusted inputs names targets that are there."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
ROWS = [
    line.split(" | ")
    for line in (Path(__file__).parent / "README.md").read_text().splitlines()
    if line.startswith("| ") and "tests/" in line
]


@pytest.mark.parametrize("row", ROWS, ids=lambda row: row[0].strip("| "))
def test_every_input_has_targets_that_are_there(row: list[str]) -> None:
    targets = re.findall(r"`(tests/[\w/]+\.py)`", row[-1])
    assert targets
    assert [target for target in targets if "def test_" not in (ROOT / target).read_text()] == []


def test_what_the_service_takes_is_in_the_table() -> None:
    inputs = " ".join(row[0] for row in ROWS)
    assert all(
        word in inputs
        for word in ("settings", "calibration", "state", "recording", "I2C", "socket", "readers", "metrics", "MQTT")
    )
