"""The settings file with every key, its default and what it means, as text made from the structs themselves.

What a key means is its entry in the struct's docstring; what it may be is what the struct says of an absurd value, or
the values its type names. So there is one place for each, and the sample cannot differ from the program.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from inspect import cleandoc
from textwrap import wrap
from typing import Literal, get_args, get_origin

import msgspec

from quavelet.core.errors import SettingsError
from quavelet.settings.hot import is_hot
from quavelet.settings.outputs import MqttSettings, OutputSettings
from quavelet.settings.tables import Settings

HEAD = """\
# Settings of quavelet: /etc/quavelet/NAME.toml for the service quavelet@NAME.
# Every key is here with its default, so each may be left out. A misspelt key is an error, never ignored.
# `quavelet config --config FILE` shows the settings in force and where each comes from.
# "restart": a change needs `systemctl restart`; "reload": `systemctl reload` puts it in force, the attitude goes on.
"""
OUTPUTS = """\
# Each output has a table with a name of its own: letters, digits, _ and -. Without one only the local socket is there.
# Take the # away from the lines that begin with one and no space. (reload)
[output]
"""
EXAMPLES = {
    "phone": OutputSettings(to="udp:192.168.1.20:5555", rate_hz=10.0),
    "home": OutputSettings(to="mqtts:broker.local", rate_hz=1.0),
}
_HEX = ("address", "accept_id", "who_am_i")
_ABSURD = 10**15
_WIDTH = 120


def example() -> str:
    """A settings file with every key at its default under a comment: meaning, bounds, and what a change needs."""
    defaults = Settings()
    tables = [
        "\n".join(_table(name, getattr(defaults, name)))
        for name in defaults.__struct_fields__
        if isinstance(getattr(defaults, name), msgspec.Struct)
    ]
    return "\n".join([HEAD, *(f"{table}\n" for table in tables), OUTPUTS + "\n".join(_outputs())]) + "\n"


def toml_value(key: str, value: object) -> str:
    """A value as it stands in a TOML file."""
    if key in _HEX and isinstance(value, int):
        return f"0x{value:02x}" if value else "0"
    # A TOML value of these types (text, numbers, booleans, lists of numbers) is written as in JSON, but for DEL.
    return msgspec.json.encode(value).decode().replace("\x7f", "\\u007f")


def meanings(struct: type[msgspec.Struct]) -> tuple[str, dict[str, list[str]]]:
    """What a table is, and the lines of each key; one that is explained together with the one before has none."""
    head, *rest = cleandoc(struct.__doc__ or "").split("\n\n")
    lines: dict[str, list[str]] = {}
    last: list[str] = []
    column = 0
    for line in "\n".join(rest).splitlines():
        entry = re.match(r"(\w+)((?:, \w+)*) {2,}(?=\S)", line)
        if entry and entry[1] in struct.__struct_fields__:
            column = entry.end()
            last = lines[entry[1]] = [line[column:]]
            lines |= {key: [] for key in entry[2].split(", ")[1:]}
        else:
            last.append(line[column:] if not line[:column].strip() else line.strip())
    return " ".join(head.split()), lines


def bounds(table: msgspec.Struct, key: str, kind: object) -> str:
    """What the key may be: the names its type has, or what the table says of an absurd number; "" where neither."""
    if get_origin(kind) is Literal:
        return "one of " + ", ".join(toml_value(key, value) for value in get_args(kind))
    number = next((type_ for type_ in (int, float) if type_ in (kind, *get_args(kind))), None)
    if number is None or get_origin(kind) is tuple:
        return ""
    said = {_said_of(table, key, number(absurd)) for absurd in (_ABSURD, -_ABSURD)}
    return said.pop() if len(said) == 1 else ""


def _said_of(table: msgspec.Struct, key: str, value: float) -> str:
    try:
        msgspec.structs.replace(table, **{key: value})
    except SettingsError as error:
        return str(error).rpartition(": ")[2]
    return ""


def _table(name: str, table: msgspec.Struct) -> Iterator[str]:
    head, lines = meanings(type(table))
    yield from _commented(wrap(head, _WIDTH - 2), "reload" if is_hot(name) else "restart")
    yield f"[{name}]"
    yield from _keys(table, lines)


def _keys(table: msgspec.Struct, lines: dict[str, list[str]], mark: str = "") -> Iterator[str]:
    for field in msgspec.structs.fields(table):
        value = getattr(table, field.name)
        if isinstance(value, msgspec.Struct):
            continue
        yield from _commented(lines.get(field.name, []), bounds(table, field.name, field.type))
        yield f"{mark}{field.name} = {toml_value(field.name, value)}"


def _outputs() -> Iterator[str]:
    for name, output in EXAMPLES.items():
        yield f"#[output.{name}]"
        if output.is_mqtt:
            yield f'#to = "{output.to}"'
            yield f"#[output.{name}.mqtt]"
            yield from _keys(MqttSettings(), meanings(MqttSettings)[1], "#")
        else:
            yield from _keys(output, meanings(OutputSettings)[1], "#")


def _commented(lines: list[str], remark: str) -> list[str]:
    """Comment lines, the remark in brackets behind the last one or below it."""
    if remark and lines and len(lines[-1]) + len(remark) + 5 <= _WIDTH:
        lines = [*lines[:-1], f"{lines[-1]} ({remark})"]
    elif remark:
        lines = [*lines, f"({remark})"]
    return [f"# {line}" for line in lines]
