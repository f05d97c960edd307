"""`quavelet config --reference`: the same keys as in the file, in tables, and the copy that a reader finds."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

import msgspec
import pytest

import quavelet.settings
from quavelet.settings import Settings, is_hot
from quavelet.settings.outputs import MqttSettings, OutputSettings
from quavelet.settings.reference_page import reference_page, unit_of

COPY = Path(quavelet.settings.__file__).with_name("REFERENCE.md")
COLUMNS = ["key", "default", "allowed", "unit", "a change needs", "meaning"]


def sections() -> dict[str, list[list[str]]]:
    """The rows of each section's table, as a reader of Markdown takes them apart."""
    found = {}
    for text in re.split(r"(?m)^## ", reference_page())[1:]:
        name = text.partition("\n")[0].strip("[]")
        rows = [line for line in text.splitlines() if line.startswith("|")]
        cells = [[cell.strip() for cell in re.split(r"(?<!\\)\|", row)[1:-1]] for row in rows]
        assert cells[0] == COLUMNS
        found[name] = cells[2:]
    return found


def test_the_copy_is_what_the_program_prints() -> None:
    assert COPY.read_text() == reference_page(), "quavelet config --reference > src/quavelet/settings/REFERENCE.md"


def test_every_key_of_every_section_stands_there_with_its_default() -> None:
    found = sections()
    defaults = msgspec.to_builtins(Settings())
    del defaults["output"]
    defaults["output.NAME"] = msgspec.to_builtins(OutputSettings(to="stdout"))
    defaults["output.NAME.mqtt"] = defaults["output.NAME"].pop("mqtt")
    assert set(found) == set(defaults)
    for name, rows in found.items():
        keys = {row[0].strip("`"): row[1].strip("`") for row in rows}
        assert keys.pop("to", "–") == "–", "an output's `to` has no default"
        written = tomllib.loads("\n".join(f"{key} = {value}" for key, value in keys.items()))
        assert msgspec.json.encode(written) == msgspec.json.encode(
            {key: value for key, value in defaults[name].items() if key != "to"}
        )


def test_each_row_says_what_is_allowed_what_a_change_needs_and_what_it_means() -> None:
    for name, rows in sections().items():
        for row in rows:
            _, _, allowed, _, needs, meaning = row
            assert needs == ("reload" if is_hot(name) else "restart")
            assert allowed and meaning, row


def test_every_number_with_a_unit_in_its_meaning_has_it_in_its_name() -> None:
    """rate_hz in Hz, still_s in s: a unit that the name does not tell is told by nothing else."""
    units = {key: unit for rows in sections().values() for key, _, _, unit, *_ in rows}
    assert {key.strip("`"): unit for key, unit in units.items() if unit}.items() >= {
        "gyro_range_dps": "deg/s", "accel_range_g": "g", "tau_s": "s", "file_minutes": "min",
        "integral_limit_rad_s": "rad/s", "dead_band_deg": "deg", "field_ut": "uT", "file_mb": "MB", "rate_hz": "Hz",
    }.items()  # fmt: skip
    for rows in sections().values():
        for key, _, allowed, unit, *_ in rows:
            if said := re.search(r"\d (s|uT|Hz|deg|g)$", allowed):
                assert unit == said[1], key


@pytest.mark.parametrize("struct", [MqttSettings, OutputSettings])
def test_a_key_without_a_unit_has_none(struct: type[msgspec.Struct]) -> None:
    assert {key for key in struct.__struct_fields__ if unit_of(key)} <= {"rate_hz", "dead_band_deg", "expire_after_s"}
