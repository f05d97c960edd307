"""`quavelet config`: every setting, its value, and where the value comes from."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Annotated

import msgspec
import typer

from quavelet.cli import exits, options
from quavelet.settings import LoadedSettings, Table, Value, as_tables
from quavelet.settings.reference import example as sample
from quavelet.settings.reference import toml_value
from quavelet.settings.reference_page import reference_page
from quavelet.sinks.message import Message

Schema = Annotated[bool, typer.Option("--schema", help="The JSON schema of the messages, instead.")]
Example = Annotated[bool, typer.Option("--example", help="A commented file with every key at its default, instead.")]
Reference = Annotated[bool, typer.Option("--reference", help="Every key in Markdown tables, instead.")]
AsJson = Annotated[bool, typer.Option("--json", help="As JSON, each value with its origin.")]


def config(
    bus: options.Bus = None,
    address: options.Address = None,
    accept_id: options.AcceptId = None,
    config: options.Config = None,
    json: AsJson = False,
    schema: Schema = False,
    example: Example = False,
    reference: Reference = False,
) -> None:
    """Show the settings in force as a TOML file, each with its origin; what it prints can be used as one."""
    if example or reference:
        exits.put((sample() if example else reference_page()).rstrip("\n"))
        return
    if schema:
        _print_json(msgspec.json.schema(Message))
        return
    loaded = options.settings_of(bus, address, config, accept_id)
    if json:
        tables = as_tables(loaded.settings)
        _print_json({table: _with_origins(keys, loaded.origin, table) for table, keys in tables.items()})
        return
    exits.put(as_toml(loaded))


def as_toml(loaded: LoadedSettings) -> str:
    """A settings file that gives these settings; behind each its origin."""
    tables = as_tables(loaded.settings)
    return "\n\n".join(text for table, keys in tables.items() for text in _toml_tables(table, keys, loaded.origin))


def _toml_tables(name: str, table: Table, origin: Mapping[str, str]) -> Iterator[str]:
    """The table and those below it, each a text of its own."""
    values = {key: value for key, value in table.items() if not isinstance(value, dict)}
    if values:
        yield "\n".join(
            [f"[{name}]", *(_toml_line(key, value, origin[f"{name}.{key}"]) for key, value in values.items())]
        )
    for key, value in table.items():
        if isinstance(value, dict):
            yield from _toml_tables(f"{name}.{key}", value, origin)


def _with_origins(table: Table, origin: Mapping[str, str], name: str) -> dict[str, object]:
    return {
        key: _with_origins(value, origin, f"{name}.{key}")
        if isinstance(value, dict)
        else {"value": value, "origin": origin[f"{name}.{key}"]}
        for key, value in table.items()
    }


def _toml_line(key: str, value: Value, origin: str) -> str:
    comment = "".join(c if c.isprintable() else "?" for c in origin)
    return f"{f'{key} = {toml_value(key, value)}':<36}# {comment}"


def _print_json(value: object) -> None:
    exits.put(msgspec.json.format(msgspec.json.encode(value), indent=2).decode())
