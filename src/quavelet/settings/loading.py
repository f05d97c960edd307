"""The settings of the defaults, a TOML file and the command line, each value with its origin."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from math import isfinite
from pathlib import Path
from typing import TypeVar, cast

import msgspec

from quavelet.core.errors import SettingsError
from quavelet.settings.outputs import OutputSettings
from quavelet.settings.tables import Settings

Value = str | int | float | bool
Table = dict[str, "Value | Table"]
Tables = dict[str, Table]
T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class LoadedSettings:
    """The settings and where each value came from: origin["chip.dlpf"] is "default", a file, or an option."""

    settings: Settings
    origin: Mapping[str, str]


def load_settings(path: Path | None = None, *, options: Mapping[str, Value] | None = None) -> LoadedSettings:
    """Defaults, then the file's values, then `options` ("bus.name" to value), the later ones winning.

    Raises SettingsError naming the file and the key.
    """
    tables = as_tables(Settings())
    origin = dict.fromkeys(_names(tables), "default")
    if path is not None:
        for table, keys in _read_toml(path).items():
            if not isinstance(keys, dict):
                if table in tables:
                    raise SettingsError(f"{path}: {table} is a table: write [{table}] and its keys below")
                raise SettingsError(f"{path}: {table} stands outside a table: write it under one of {_known(tables)}")
            if table not in tables:
                raise SettingsError(f"{path}: unknown table [{table}]: the tables are {_known(tables)}")
            if table == "output":
                for name, output in keys.items():
                    if not isinstance(output, dict):
                        raise SettingsError(f"{path}: output.{name}: write [output.{name}] and its keys below")
                    new = _new_output(output)
                    tables[table][name] = new
                    origin |= dict.fromkeys(_names(new, f"output.{name}"), "default")
            _merge(tables[table], keys, origin=origin, path=path, place=table)
    settings = parse_settings(tables, where=str(path))
    if options:
        for name, value in options.items():
            table, _, key = name.partition(".")
            tables[table][key] = value
            origin[name] = "command line"
        # By itself, so that the file is not blamed for an option.
        settings = parse_settings(tables, where="command line")
    return LoadedSettings(settings, origin)


def as_tables(settings: Settings) -> Tables:
    """Plain tables that `parse_settings` makes these settings of; [output.NAME.mqtt] only where there is a broker."""
    tables = cast(Tables, msgspec.to_builtins(settings))
    for name, output in settings.output.items():
        if not output.is_mqtt:
            del cast(Table, tables["output"][name])["mqtt"]
    return tables


def parse_settings(tables: object, *, where: str) -> Settings:
    """`Settings` of plain tables. Raises SettingsError that begins with `where` and names the key."""
    outputs = tables.get("output") if isinstance(tables, dict) else None
    if isinstance(outputs, dict):
        # One by one, for msgspec does not tell which key of a dict it complains of.
        for name, output in outputs.items():
            _convert(output, OutputSettings, where=where, place=f"output.{name}")
    return _convert(tables, Settings, where=where, place="")


def _convert(plain: object, to: type[T], *, where: str, place: str) -> T:
    try:
        return msgspec.convert(plain, to)
    except msgspec.ValidationError as error:
        text, _, below = str(error).partition(" - at `$")
        key = (place + below.rstrip("`").replace("[...]", "")).lstrip(".")
        raise SettingsError(f"{where}: {key + ': ' if key else ''}{text}") from error


def _new_output(given: Mapping[str, object]) -> Table:
    """The defaults of an output; without a place to go to where none is given."""
    output = cast(Table, msgspec.to_builtins(OutputSettings(to="stdout")))
    if "to" not in given:
        del output["to"]
    if "mqtt" not in given and not str(given.get("to")).startswith("mqtt"):
        del output["mqtt"]
    return output


def _merge(into: Table, given: Mapping[str, object], *, origin: dict[str, str], path: Path, place: str) -> None:
    """Put each value given at its key, where there is such a one, and its origin down."""
    for key, value in given.items():
        name = f"{place}.{key}"
        known = into.get(key)
        if isinstance(known, dict):
            if not isinstance(value, dict):
                raise SettingsError(f"{path}: {name} is a table: write [{name}] and its keys below")
            _merge(known, value, origin=origin, path=path, place=name)
            continue
        if key not in into:
            raise SettingsError(f"{path}: unknown key {name}: [{place}] has {_known(into)}")
        if not _is_finite(value):
            raise SettingsError(f"{path}: {name} = {value} is not a finite number: give one")
        into[key] = cast(Value, value)
        origin[name] = str(path)


def _names(table: Mapping[str, object], place: str = "") -> list[str]:
    """The full name of each value in a table, and in those below it."""
    names = []
    for key, value in table.items():
        name = f"{place}.{key}" if place else key
        names += _names(value, name) if isinstance(value, dict) else [name]
    return names


def _read_toml(path: Path) -> dict[str, object]:
    try:
        return tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise SettingsError(f"{path}: cannot be read ({error.strerror}): give the path of a TOML file") from error
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise SettingsError(f"{path}: is not TOML: {error}") from error


def _is_finite(value: object) -> bool:
    if isinstance(value, list):
        return all(_is_finite(item) for item in value)
    return not isinstance(value, float) or isfinite(value)


def _known(names: Mapping[str, object]) -> str:
    return ", ".join(names)
