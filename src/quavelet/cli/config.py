"""`quavelet config`: every setting, its value, and where the value comes from."""

from __future__ import annotations

import sys
from typing import Annotated, cast

import msgspec
import typer

from quavelet.cli import options
from quavelet.settings import LoadedSettings, Tables
from quavelet.sinks.message import Message

Schema = Annotated[bool, typer.Option("--schema", help="The JSON schema of the messages, instead.")]
AsJson = Annotated[bool, typer.Option("--json", help="As JSON, each value with its origin.")]


def config(
    bus: options.Bus = None,
    address: options.Address = None,
    config: options.Config = None,
    json: AsJson = False,
    schema: Schema = False,
) -> None:
    """Show the settings in force as a TOML file, each with its origin; what it prints can be used as one."""
    if schema:
        _print_json(msgspec.json.schema(Message))
        return
    loaded = options.settings_of(bus, address, config)
    tables = cast(Tables, msgspec.to_builtins(loaded.settings))
    if json:
        _print_json(
            {
                table: {key: {"value": value, "origin": loaded.origin[f"{table}.{key}"]} for key, value in keys.items()}
                for table, keys in tables.items()
            }
        )
        return
    print("\n\n".join(_toml_table(table, tables, loaded) for table in tables))


def _toml_table(table: str, tables: Tables, loaded: LoadedSettings) -> str:
    lines = [f"[{table}]"]
    for key, value in tables[table].items():
        origin = loaded.origin[f"{table}.{key}"]
        # A TOML value of these types (text, numbers, booleans, lists of numbers) is written as in JSON.
        text = f"0x{value:02x}" if key == "address" else msgspec.json.encode(value).decode()
        lines.append(f"{f'{key} = {text}':<36}# {origin}")
    return "\n".join(lines)


def _print_json(value: object) -> None:
    sys.stdout.write(msgspec.json.format(msgspec.json.encode(value), indent=2).decode() + "\n")
