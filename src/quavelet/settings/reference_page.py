"""Every setting in a table for each section, as Markdown made from the structs themselves."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Literal, get_args, get_origin

import msgspec

from quavelet.settings.hot import is_hot
from quavelet.settings.outputs import MqttSettings, OutputSettings
from quavelet.settings.reference import bounds, meanings, toml_value
from quavelet.settings.tables import Settings

HEAD = """\
# Every setting

Made by `quavelet config --reference` from the settings' types. Each key may be left out, but for an output's `to`.
A change needs `systemctl reload`, which leaves the attitude going on, or `systemctl restart`.
"""
_UNITS = {
    "_rad_s": "rad/s",
    "_dps": "deg/s",
    "_deg": "deg",
    "_hz": "Hz",
    "_minutes": "min",
    "_mb": "MB",
    "_ut": "uT",
    "_g": "g",
    "_s": "s",
}
"""By how a key ends; those that are longer first."""
_ANY_OUTPUT = OutputSettings(to="stdout")


def reference_page() -> str:
    """The page: for each section its keys with default, what is allowed, unit, what a change needs, and meaning."""
    defaults = Settings()
    named = [(name, getattr(defaults, name)) for name in defaults.__struct_fields__]
    sections = [(name, table) for name, table in named if isinstance(table, msgspec.Struct)]
    sections += [("output.NAME", _ANY_OUTPUT), ("output.NAME.mqtt", MqttSettings())]
    return "\n".join([HEAD, *("\n".join(_section(name, table)) + "\n" for name, table in sections)])


def unit_of(key: str) -> str:
    """The unit that the key's name ends with, "" where it has none."""
    return next((unit for ending, unit in _UNITS.items() if key.endswith(ending)), "")


def _section(name: str, table: msgspec.Struct) -> Iterator[str]:
    head, lines = meanings(type(table))
    needs = "reload" if is_hot(name) else "restart"
    yield f"## [{name}]\n\n{_cell(head)}\n"
    yield "| key | default | allowed | unit | a change needs | meaning |"
    yield "| --- | --- | --- | --- | --- | --- |"
    meaning = ""
    for field in msgspec.structs.fields(table):
        value = getattr(table, field.name)
        if isinstance(value, msgspec.Struct):
            continue
        if own := lines.get(field.name):
            meaning = _prose(own, field.type)
        default = f"`{toml_value(field.name, value)}`" if table is not _ANY_OUTPUT or field.name != "to" else "–"
        cells = (f"`{field.name}`", default, _allowed(table, field), unit_of(field.name), needs, meaning)
        yield f"| {' | '.join(map(_cell, cells))} |"


def _allowed(table: msgspec.Struct, field: msgspec.structs.FieldInfo) -> str:
    said = re.sub(r"^(give|take) ", "", bounds(table, field.name, field.type))
    if said:
        return said
    if get_origin(field.type) is tuple:
        return "numbers"
    return {bool: "true, false", str: "text"}.get(field.type, "a number")


def _prose(lines: list[str], kind: object) -> str:
    """The lines as one, a new one begun only for what a value that the type names is."""
    names = [f'"{value}"' for value in get_args(kind)] if get_origin(kind) is Literal else []
    text = ""
    for line in lines:
        begins = any(line.startswith(name) for name in names) and bool(text)
        text += ("<br>" if begins else " " if text else "") + " ".join(line.split())
    return text


def _cell(text: str) -> str:
    return text.replace("|", "\\|")
