"""When faults happen, and the one line of text that says so: `flip every=10 register=0x74 seed=3`."""

from __future__ import annotations

import math
from dataclasses import KW_ONLY, dataclass, fields
from typing import Any

from hw_fakes.faults.base import Fault
from hw_fakes.faults.of_chip import CHIP_FAULTS, ChipFault
from hw_fakes.faults.of_wires import WIRE_FAULTS
from quavelet.core.errors import SettingsError

KINDS: dict[str, type[Fault]] = {kind.name: kind for kind in (*WIRE_FAULTS, *CHIP_FAULTS)}

_IN_HEX = ("register", "value", "address")
_UNITS = ("_s", "_degc")


@dataclass(frozen=True, slots=True)
class FaultEntry:
    """A fault and when it happens; where nothing is said, once and at once.

    at_s        when, in s of the fake world; with `every_s`, `p` or `per_minute`: from when on
    every_s     again and again, 0.001 and more; first at `at_s`, or that long after it is added
    p           with this probability in each transfer
    per_minute  at random, so often in the mean (Poisson)
    for_s       how long it lasts; without, a fault of the wires takes `n` transfers, and one of the chip does not end
    n           how many transfers it spoils (1); with `for_s`, at most that many
    address     of the chip it has to do with; None: any on the wires
    seed        of all that is random; entries of one seed have their own randomness by their place in the plan

    Raises ValueError where that makes no sense.
    """

    kind: Fault
    _: KW_ONLY
    at_s: float | None = None
    every_s: float | None = None
    p: float | None = None
    per_minute: float | None = None
    for_s: float | None = None
    n: int | None = None
    address: int | None = None
    seed: int = 0

    def __post_init__(self) -> None:
        name = self.kind.name
        if sum(often is not None for often in (self.every_s, self.p, self.per_minute)) > 1:
            raise ValueError(f"{name} has more than one of every, p and per_minute: leave one")
        if self.at_s is not None and not 0 <= self.at_s < math.inf:
            raise ValueError(f"at {self.at_s:g} of {name} is no time in s from 0 on")
        for key, time in (("every", self.every_s), ("for", self.for_s), ("per_minute", self.per_minute)):
            if time is not None and not 0 < time < math.inf:
                raise ValueError(f"{key} {time:g} of {name} is not above 0")
        if (self.every_s or 1) < 0.001 or (self.per_minute or 1) > 60_000:
            raise ValueError(f"{name} is to happen more often than once a ms: take p, the share of the transfers")
        if self.p is not None and not 0 < self.p <= 1:
            raise ValueError(f"p {self.p:g} of {name} is no probability above 0 and up to 1")
        if self.n is not None and self.n < 1:
            raise ValueError(f"n {self.n} of {name} is no number of transfers from 1 on")
        if self.n is not None and isinstance(self.kind, ChipFault):
            raise ValueError(f"{name} happens to the chip, not to n transfers: leave n out")
        if self.for_s is not None and not self.kind.lasts:
            raise ValueError(f"{name} is over as soon as it has happened: leave for out")
        if self.address is not None and not 0 <= self.address <= 0x7F:
            raise ValueError(f"address {self.address} of {name} is not of 7 bits")
        if self.seed < 0:
            raise ValueError(f"seed {self.seed} of {name} is below 0")

    def __str__(self) -> str:
        """The text form, which `parse` takes back."""
        return " ".join([self.kind.name, *_words(self, beside="kind"), *_words(self.kind)])


def parse(text: str) -> FaultEntry:
    """The entry of a text: a name of `KINDS`, then key=value of the entry and of the kind, in any order.

    Times are in s, whole numbers may be hexadecimal. Raises SettingsError that names the kinds, or the keys.
    """
    name, *words = text.split() or [""]
    if name not in KINDS:
        raise SettingsError(f"there is no fault '{name}': take one of {', '.join(KINDS)}")
    kind = KINDS[name]
    whens = {_key(field.name): field for field in fields(FaultEntry) if field.name != "kind"}
    whats = {_key(field.name): field for field in fields(kind)}
    when: dict[str, Any] = {}
    what: dict[str, Any] = {}
    for word in words:
        key, equals, value = word.partition("=")
        field = whats.get(key) or whens.get(key)
        if not equals or field is None:
            keys = ", ".join((*whens, *whats))
            raise SettingsError(f"'{word}' says nothing about {name}: write key=value with one of {keys}")
        into = what if key in whats else when
        if field.name in into:
            raise SettingsError(f"{name} has {key} twice: leave one out")
        into[field.name] = _value(str(field.type), value, word)
    try:
        return FaultEntry(kind(**what), **when)
    except ValueError as error:
        raise SettingsError(str(error)) from None


def parse_lines(text: str) -> list[FaultEntry]:
    """The entries of a file: one a line; empty lines, and what stands after a #, are passed over."""
    lines = (line.partition("#")[0].strip() for line in text.splitlines())
    return [parse(line) for line in lines if line]


def own_keys(kind: type[Fault]) -> list[str]:
    """The keys that a kind has in the text form beside those of every entry."""
    return [_key(field.name) for field in fields(kind)]


def _key(field: str) -> str:
    for unit in _UNITS:
        field = field.removesuffix(unit)
    return field


def _value(kind: str, value: str, word: str) -> int | float | str:
    try:
        if "int" in kind:
            return int(value, 0)
        return float(value) if "float" in kind else value
    except ValueError:
        raise SettingsError(f"'{value}' in '{word}' is not a number: write one, as 2 or 0x74") from None


def _words(part: FaultEntry | Fault, *, beside: str = "") -> list[str]:
    return [
        f"{_key(field.name)}={_text(field.name, getattr(part, field.name))}"
        for field in fields(part)
        if field.name != beside and getattr(part, field.name) != field.default
    ]


def _text(field: str, value: int | float | str) -> str:
    if field in _IN_HEX and isinstance(value, int):
        return f"0x{value:02x}"
    return repr(value).removesuffix(".0") if isinstance(value, float) else str(value)
