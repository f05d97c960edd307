"""The settings of the defaults, a TOML file and the command line, each value with its origin."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import cast

import msgspec

from quavelet.core.errors import SettingsError
from quavelet.core.toml import read_toml
from quavelet.settings.checking import parse_settings
from quavelet.settings.tables import Settings

Value = str | int | float | bool
Table = dict[str, "Value | Table"]
Tables = dict[str, Table]


@dataclass(frozen=True, slots=True)
class LoadedSettings:
    """The settings and where each value came from: origin["chip.dlpf"] is "default", a file, or an option."""

    settings: Settings
    origin: Mapping[str, str]


def load_settings(path: Path | None = None, *, options: Mapping[str, Value] | None = None) -> LoadedSettings:
    """Defaults, then the file's values, then `options` ("bus.name" to value), the later ones winning.

    Raises SettingsError with a line for each mistake, naming the file and the key.
    """
    settings, origin = Settings(), {}
    if path is not None:
        tables = _read_toml(path)
        settings = parse_settings(tables, where=str(path))
        origin = dict.fromkeys(_names(tables), str(path))
    if options:
        given: Tables = {}
        for name, value in options.items():
            table, _, key = name.partition(".")
            given.setdefault(table, {})[key] = value
        # By itself, so that the file is not blamed for an option.
        settings = parse_settings(given, where="command line", base=settings)
        origin |= dict.fromkeys(options, "command line")
    return LoadedSettings(settings, {name: origin.get(name, "default") for name in _names(as_tables(settings))})


def as_tables(settings: Settings) -> Tables:
    """Plain tables that `parse_settings` makes these settings of; [output.NAME.mqtt] only where there is a broker."""
    tables = cast(Tables, msgspec.to_builtins(settings))
    for name, output in settings.output.items():
        if not output.is_mqtt:
            del cast(Table, tables["output"][name])["mqtt"]
    return tables


def _names(table: Mapping[str, object], place: str = "") -> list[str]:
    """The full name of each value in a table, and in those below it."""
    names = []
    for key, value in table.items():
        name = f"{place}.{key}" if place else key
        names += _names(value, name) if isinstance(value, dict) else [name]
    return names


def _read_toml(path: Path) -> dict[str, object]:
    try:
        return read_toml(path)
    except OSError as error:
        raise SettingsError(f"{path}: cannot be read ({error.strerror}): give the path of a TOML file") from error
    except ValueError as error:
        raise SettingsError(f"{path}: is not TOML: {error}") from error
