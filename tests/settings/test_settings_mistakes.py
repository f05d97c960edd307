"""All mistakes of a settings file are told at once, a line each, whatever they are."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from pathlib import Path

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from quavelet.core.errors import SettingsError
from quavelet.settings import OutputSettings, Settings, Value, as_tables, load_settings, parse_settings

Mistake = tuple[str, str, str]
"""Table, key, and what is written behind it."""

OUTPUTS = {"there": OutputSettings(to="tcp:h:1"), "home": OutputSettings(to="mqtt:h")}
NEEDED = {"output.there": 'to = "tcp:h:1"', "output.home": 'to = "mqtt:h"'}


def leaves(table: object, place: str = "") -> Iterator[tuple[str, str, Value]]:
    assert isinstance(table, dict)
    for key, value in table.items():
        if isinstance(value, dict):
            yield from leaves(value, f"{place}.{key}".lstrip("."))
        else:
            yield place, key, value


LEAVES = list(leaves(as_tables(Settings(output=OUTPUTS))))


def mistakes() -> Iterator[Mistake]:
    """Of every key there is: of another type, no finite number, absurd; and keys and tables that are not there."""
    for table, key, value in LEAVES:
        yield table, key, "[true]" if isinstance(value, str | list | tuple) else '"words"'
        if isinstance(value, int | float) and not isinstance(value, bool):
            yield table, key, "1" + 15 * "0" + (".0" if isinstance(value, float) else "")
        if isinstance(value, float):
            yield table, key, "nan"
            yield table, key, "-inf"
            yield table, key, "1e999"
        yield table, f"{key}x", "1"
    yield "nosuch", "key", "1"
    yield "loopp", "key", "1"


MISTAKES = list(mistakes())


def text_of(planted: list[Mistake]) -> str:
    lines: dict[str, list[str]] = {}
    for table, key, value in planted:
        if table.startswith("output."):
            name = ".".join(table.split(".")[:2])
            lines.setdefault(name, [] if (name, "to") in {m[:2] for m in planted} else [NEEDED[name]])
        lines.setdefault(table, []).append(f"{key} = {value}")
    return "\n".join("\n".join([f"[{table}]", *content]) for table, content in lines.items())


def told(text: str) -> list[str]:
    with tempfile.NamedTemporaryFile("w", suffix=".toml") as file:
        file.write(text)
        file.flush()
        with pytest.raises(SettingsError) as caught:
            load_settings(Path(file.name))
        lines = str(caught.value).splitlines()
        assert all(line.startswith(f"{file.name}: ") for line in lines)
        return [line.removeprefix(f"{file.name}: ") for line in lines]


@given(st.lists(st.sampled_from(MISTAKES), min_size=1, max_size=12, unique_by=lambda mistake: mistake[:2]))
def test_so_many_mistakes_give_so_many_lines_and_each_names_its_key(planted: list[Mistake]) -> None:
    lines = told(text_of(planted))
    assert len(lines) == len(planted), "\n".join(lines)
    for table, key, _ in planted:
        named = f"[{table}]" if table in ("nosuch", "loopp") else key
        assert [line for line in lines if table in line and named in line], (table, key, lines)


def test_a_range_in_words_is_not_taken_for_the_key_that_is_called_to() -> None:
    lines = told("[output.home]\nto = [true]\nrate_hz = 1e15\n")
    assert len(lines) == 2
    assert "output.home: rate_hz = 1e+15" in lines[1]


def test_a_word_that_is_not_known_is_told_with_those_that_are() -> None:
    (line,) = told('[output.a]\nto = "udp:h:1"\nencoding = "nmeaa"\n')
    assert line.endswith("give 'json' or 'nmea' or 'signalk' or 'influx' or 'opentrack' or 'mavlink'")


@pytest.mark.parametrize("to", ["tcp:127.0.0.1:10110", "unix:/run/a.sock"])
def test_two_outputs_that_would_listen_at_one_place_are_one_mistake(to: str) -> None:
    (line,) = told(f'[output.a]\nto = "{to}"\n[output.b]\nto = "{to}"\n')
    assert line == f"outputs 'a' and 'b' both listen at {to}: give one another"


@pytest.mark.parametrize("mistake", MISTAKES, ids=lambda mistake: f"{mistake[0]}.{mistake[1]}={mistake[2][:8]}")
def test_each_mistake_by_itself_gives_one_line(mistake: Mistake) -> None:
    assert len(told(text_of([mistake]))) == 1


def test_values_that_do_not_go_together_are_told_beside_the_others() -> None:
    lines = told(
        '[filter]\nkind = "velocity"\nrelearn_s = 30.0\nkp = 1.0\n[mounting]\nx = "q"\ny = "w"\n[chip]\n'
        'sample_rate_hz = 1000.0\n[loop]\nrate_hz = 20.0\n[output.a]\nto = "stdout"\n[output.b]\nto = "stdout"\n'
        '[output."c d"]\nto = "tcp:h:1"\n[output.e]\nto = "tcp:h:1"\nencoding = "opentrack"\n'
    )
    assert [line.split(" ")[:2] for line in lines] == [
        ["filter:", "relearn_s"],
        ["filter:", "kp"],
        ["mounting.x:", "'q'"],
        ["mounting.y:", "'w'"],
        ["output.e:", "encoding"],
        ["loop.rate_hz", "="],
        ["[output.'c", "d']:"],
        ["outputs", "'a'"],
    ]


def test_what_follows_from_a_mistake_is_not_told() -> None:
    # With dlpf = 0 the rate could be made.
    (line,) = told("[chip]\ndlpf = 7\nsample_rate_hz = 888.8888888888889\n")
    assert line.startswith("chip: dlpf = 7")
    (line,) = told('[loop]\nrate_hz = "fast"\n[chip]\nsample_rate_hz = 1000.0\n')
    (line,) = told("[output.a]\n[output.b]\nrate_hz = 5.0\nto = 7\n[output.c]\nto = 'stdout'\n")[1:]
    assert line.startswith("output.b.to: ")


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("[chip]\ndlfp = 3", "did you mean dlpf?"),
        ("[chip]\naccel_range = 4", "did you mean accel_range_g?"),
        ("[chip]\npriority = 4", "it belongs under [loop]"),
        ("[magnetometre]", "did you mean [magnetometer]?"),
        ("[output.there]\nto = 'tcp:h:1'\nencodin = 'json'", "did you mean encoding?"),
    ],
)
def test_a_misspelt_name_is_told_with_the_nearest(text: str, words: str) -> None:
    (line,) = told(text)
    assert words in line


def test_a_key_over_several_lines_is_one_line() -> None:
    (line,) = told('[chip]\n"a\\nb\\u001b[31m" = 1\n')
    assert "a?b?[31m" in line


def test_no_value_goes_on_for_pages() -> None:
    lines = told(
        f'[bus]\nname = "{100_000 * "x"}"\naddress = 0x{10_000 * "f"}\n[start]\ngyro_bias_dps = [{5000 * "1,"}]\n'
    )
    assert len(lines) == 3
    assert max(map(len, lines)) < 200


def test_plain_tables_of_any_depth_are_refused_by_their_key() -> None:
    nested: list[object] = []
    for _ in range(5000):
        nested = [nested]
    with pytest.raises(SettingsError, match=r"^here: start\.gyro_bias_dps is a list of lists"):
        parse_settings({"start": {"gyro_bias_dps": nested}}, where="here")
    table: dict[str, object] = {}
    for _ in range(5000):
        table = {"start": table}
    with pytest.raises(SettingsError, match=r"^here: unknown key start\.start"):
        parse_settings(table, where="here")


def test_the_structs_refuse_by_themselves_what_a_file_may_not_have() -> None:
    for table, key, value in LEAVES:
        if isinstance(value, float) and not table.startswith("output"):
            struct = getattr(Settings(), table)
            for bad in (1e15, float("nan")):
                with pytest.raises(SettingsError):
                    msgspec.structs.replace(struct, **{key: bad})
