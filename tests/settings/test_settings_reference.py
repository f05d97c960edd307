"""`quavelet config --example`: every key, its default, what it means, what it may be, and what a change needs."""

from __future__ import annotations

import re
import tomllib
from itertools import pairwise
from pathlib import Path

import msgspec
import pytest

from quavelet.settings import HOT_TABLES, Settings, is_hot, load_settings
from quavelet.settings.outputs import MqttSettings, OutputSettings
from quavelet.settings.reference import EXAMPLES, bounds, example, meanings

STRUCTS = [
    *(type(t) for name in Settings.__struct_fields__ if isinstance(t := getattr(Settings(), name), msgspec.Struct)),
    OutputSettings,
    MqttSettings,
]


def test_the_example_is_the_defaults(tmp_path: Path) -> None:
    path = tmp_path / "imu.toml"
    path.write_text(example())
    assert load_settings(path).settings == Settings()
    written = {(table, key) for table, keys in tomllib.loads(example()).items() for key in keys}
    there = {
        (table, field)
        for table in Settings.__struct_fields__
        for field in getattr(getattr(Settings(), table), "__struct_fields__", ())
    }
    assert written == there


def test_the_outputs_in_it_load_once_their_marks_are_taken_away(tmp_path: Path) -> None:
    path = tmp_path / "imu.toml"
    path.write_text(re.sub(r"(?m)^#(?=\S)", "", example()))
    output = load_settings(path).settings.output
    assert list(output) == list(EXAMPLES)
    assert {name: made.to for name, made in output.items()} == {name: made.to for name, made in EXAMPLES.items()}


@pytest.mark.parametrize("struct", STRUCTS, ids=lambda struct: struct.__name__)
def test_every_key_is_explained_in_its_struct_and_nothing_else_is(struct: type[msgspec.Struct]) -> None:
    head, lines = meanings(struct)
    assert head.endswith(".") or ":" in head
    # One that is explained with the one before has an entry all the same, without words.
    assert list(lines) == list(struct.__struct_fields__)
    assert lines[struct.__struct_fields__[0]]
    for key, before in zip(list(lines)[1:], lines, strict=False):
        entry = re.search(rf"(?m)^ *([\w, ]*\b{key}\b[\w, ]*?)  ", struct.__doc__ or "")
        assert entry, key
        assert lines[key] or before in entry[1].split(", "), key


@pytest.mark.parametrize("struct", STRUCTS, ids=lambda struct: struct.__name__)
def test_no_text_has_run_into_that_of_another_key(struct: type[msgspec.Struct]) -> None:
    """A docstring that was wrapped anew loses its columns, and one key's words become another's."""
    keys = "|".join(struct.__struct_fields__)
    for key, text in meanings(struct)[1].items():
        for line in text:
            assert not re.search(rf"(?<![\w\"])({keys}) {{2,}}\S", line), f"{key}: {line}"
    _, _, entries = (struct.__doc__ or "").partition("\n\n")
    column = 0
    for line in entries.rstrip(" ").splitlines():
        entry = re.match(rf" {{4}}(?:{keys})(?:, \w+)* {{2,}}(?=\S)", line)
        column = column if entry is None else entry.end()
        assert not line or line[:column].strip() == "" or entry, f"not at its entry's column: {line}"
        assert not line or line[column:], line


@pytest.mark.parametrize("struct", STRUCTS, ids=lambda struct: struct.__name__)
def test_the_bounds_of_every_number_are_told(struct: type[msgspec.Struct]) -> None:
    table = OutputSettings(to="tcp:h:1") if struct is OutputSettings else getattr(Settings(), _name_of(struct), None)
    table = MqttSettings() if table is None else table
    for field in msgspec.structs.fields(struct):
        value = getattr(table, field.name)
        if isinstance(value, int | float) and not isinstance(value, bool) and field.name != "sample_rate_hz":
            assert re.search(r"\d|odd|who|suits", bounds(table, field.name, field.type)), field.name


def test_every_key_stands_below_a_comment_and_no_line_is_too_long() -> None:
    lines = example().splitlines()
    assert [line for before, line in pairwise(lines) if re.match(r"#?\w+ = ", line) and not before] == []
    assert max(map(len, lines)) <= 120


def test_what_a_change_needs_stands_above_each_table() -> None:
    for before, line in pairwise(example().splitlines()):
        if line.startswith("["):
            assert before.endswith("(reload)" if is_hot(line.strip("[]")) else "(restart)"), line


def test_hot_tables_are_there() -> None:
    assert set(HOT_TABLES) <= set(Settings.__struct_fields__)
    assert is_hot("output.phone.rate_hz")
    assert is_hot("output")
    assert not is_hot("outputs.rate_hz")
    assert not is_hot("loop.rate_hz")


def _name_of(struct: type[msgspec.Struct]) -> str:
    return next((name for name in Settings.__struct_fields__ if type(getattr(Settings(), name)) is struct), "")
