"""Plain tables to settings: every mistake in them is found, not only the first.

A struct refuses what cannot be at the first value it does not like. To see what else is wrong that value is put aside,
for the default in its place, and the struct is asked again. What it then says of a value that was put aside is a
consequence, and not told.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from difflib import get_close_matches
from math import isfinite
from typing import Literal, TypeVar, get_args, get_origin

import msgspec

from quavelet.core.errors import SettingsError
from quavelet.settings.outputs import OutputSettings
from quavelet.settings.tables import Settings

LONGEST_TEXT = 1000
LARGEST_NUMBER = 2**53
_NEW_OUTPUT = OutputSettings(to="stdout")
_DEFAULTS = Settings()

S = TypeVar("S", bound=msgspec.Struct)


def parse_settings(tables: object, *, where: str, base: Settings | None = None) -> Settings:
    """`Settings` of plain tables; `base` has what they leave out, the defaults unless given.

    Raises SettingsError with a line for each mistake, which begins with `where` and names the key.
    """
    checking = _Checking()
    settings = checking.table(tables, Settings() if base is None else base, "")
    if checking.faults:
        raise SettingsError("\n".join(_printable(f"{where}: {fault}") for fault in checking.faults))
    return settings


class _Checking:
    def __init__(self) -> None:
        self.faults: list[str] = []
        self.aside: set[str] = set()
        """The full names of the values that are put aside."""

    def table(self, given: object, base: S, place: str) -> S:
        """The struct with what is given and can be; `base` has the rest."""
        if not isinstance(given, Mapping):
            self._tell(place, f"{place or 'the whole'} is a table: write [{place}] and its keys below")
            return base
        fields = {field.name: field for field in msgspec.structs.fields(base)}
        values: dict[str, object] = {}
        for key, value in given.items():
            name = f"{place}.{key}" if place else str(key)
            if key not in fields:
                self._tell(name, _unknown(place, str(key), value, fields))
                continue
            default = getattr(base, key)
            if isinstance(default, msgspec.Struct):
                values[key] = self.table(value, default, name)
            elif key == "output":
                values[key] = self._outputs(value)
            else:
                self._value(values, key, value, fields[key].type, name)
        return self._struct(base, values, place)

    def _tell(self, name: str, fault: str) -> None:
        self.faults.append(fault)
        self.aside.add(name)

    def _outputs(self, given: object) -> dict[str, OutputSettings]:
        if not isinstance(given, Mapping):
            self._tell("output", "output is a table: write [output.NAME] for each")
            return {}
        outputs = {}
        for name, output in given.items():
            place, told = f"output.{name}", len(self.faults)
            if isinstance(output, Mapping) and "to" not in output:
                self._tell(f"{place}.to", f"{place}: Object missing required field `to`: say where it goes")
            made = self.table(output, _NEW_OUTPUT, place)
            if len(self.faults) == told:
                outputs[str(name)] = made
        return outputs

    def _value(self, values: dict[str, object], key: str, value: object, kind: object, name: str) -> None:
        wrong = _absurd(value)
        if wrong:
            self._tell(name, f"{name} {wrong}")
            return
        try:
            values[key] = msgspec.convert(value, kind)
        except (msgspec.ValidationError, OverflowError) as error:
            text, _, below = str(error).partition(" - at `$")
            if get_origin(kind) is Literal:
                text = f"{text}: give {' or '.join(map(repr, get_args(kind)))}"
            self._tell(name, f"{name}{below.rstrip('`').replace('[...]', '')}: {text}")

    def _struct(self, base: S, values: dict[str, object], place: str) -> S:
        """The struct with these values, less those that it refuses."""
        while True:
            made = _make(base, values)
            if not isinstance(made, str):
                return made
            aside = {name.removeprefix(f"{place}.") for name in self.aside}
            if not place:
                # What belongs to the whole are mistakes that do not hide each other, a line each.
                self.faults += [line for line in made.splitlines() if not any(_named(line, name) for name in aside)]
                return base
            culprit = _culprit(base, values, made)
            if not any(_named(made, name) for name in aside):
                where = place if culprit is None or _named(made, culprit) else f"{place}.{culprit}"
                self.faults.append(f"{where}: {made}")
            if culprit is None:
                return base
            del values[culprit]
            self.aside.add(f"{place}.{culprit}")


def _make(base: S, values: Mapping[str, object]) -> S | str:
    """The struct with these values on top of `base`'s, or why it cannot be."""
    all_values = {name: getattr(base, name) for name in base.__struct_fields__} | dict(values)
    try:
        return type(base)(**all_values)
    except (ValueError, TypeError, ArithmeticError) as error:
        return str(error)


def _culprit(base: msgspec.Struct, values: dict[str, object], text: str) -> str | None:
    """The value without which this would not have been said; None where it is no single one.

    One that leaves nothing to say comes before one that only changes what is said; among equals, that named first.
    """
    named = {key: match.start() for key in values if (match := _named(text, key))}
    order = sorted(values, key=lambda key: named.get(key, len(text)))
    others = {key: _make(base, {name: value for name, value in values.items() if name != key}) for key in order}
    return next(
        (key for key, made in others.items() if not isinstance(made, str)),
        next((key for key, made in others.items() if made != text), None),
    )


def _named(text: str, key: str) -> re.Match[str] | None:
    # "give 0 to 1000" does not speak of the key `to`.
    end = "(?= =)" if key == "to" else "(?![\\w'\"])"
    return re.search(rf"(?<![\w.+'\"-]){re.escape(key)}{end}", text)


def _unknown(place: str, key: str, value: object, fields: Iterable[str]) -> str:
    known = list(fields)
    near = get_close_matches(key, known, n=1)
    all_known = ", ".join(known)
    if place:
        homes = [f"[{name}]" for name in _DEFAULTS.__struct_fields__ if key in _keys(getattr(_DEFAULTS, name))]
        hint = f"did you mean {near[0]}? " if near else f"it belongs under {' or '.join(homes)}; " if homes else ""
        return f"unknown key {place}.{key}: {hint}[{place}] has {all_known}"
    if not isinstance(value, Mapping):
        return f"{key} stands outside a table: write it under one of {all_known}"
    hint = f"did you mean [{near[0]}]? " if near else ""
    return f"unknown table [{key}]: {hint}the tables are {all_known}"


def _keys(table: object) -> tuple[str, ...]:
    return table.__struct_fields__ if isinstance(table, msgspec.Struct) else ()


def _absurd(value: object) -> str:
    """What is wrong with a value whatever its key; "" where nothing is."""
    if isinstance(value, list | tuple):
        if len(value) > LONGEST_TEXT:
            return f"has {len(value)} values: no setting takes so many"
        if any(isinstance(item, list | tuple) for item in value):
            return "is a list of lists: no setting takes one"
        return next((wrong for wrong in map(_absurd, value) if wrong), "")
    if isinstance(value, float) and not isfinite(value):
        return f"= {value} is not a finite number: give one"
    if isinstance(value, int | float) and abs(value) > LARGEST_NUMBER:
        return "is far too large a number: see `quavelet config --example`"
    if isinstance(value, str) and len(value) > LONGEST_TEXT:
        return f"has {len(value)} characters: no setting takes more than {LONGEST_TEXT}"
    return ""


def _printable(line: str) -> str:
    """One line, whatever was in the file."""
    return "".join(c if c.isprintable() else "?" for c in line)
