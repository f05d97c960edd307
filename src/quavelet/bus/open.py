"""Buses by name: "linux:1", "fake:tilt", or any other kind that an installed package adds."""

from __future__ import annotations

from importlib.metadata import EntryPoint, entry_points
from typing import Protocol, cast

from quavelet.bus.protocol import I2CBus
from quavelet.core.clock import Clock
from quavelet.core.errors import SettingsError

GROUP = "quavelet.buses"


class BusOpener(Protocol):
    """What an entry point of the group `quavelet.buses` names."""

    def __call__(self, which: str, /, *, clock: Clock) -> I2CBus: ...


def open_bus(name: str, *, clock: Clock) -> I2CBus:
    """Open the bus called `name`, "KIND:WHICH"; KIND is an entry point of the group `quavelet.buses`.

    Raises SettingsError for a name that is no bus, BusError where the bus cannot be opened.
    There is no fall-back: a fake is opened only by its own name.
    """
    kind, colon, which = name.partition(":")
    kinds: dict[str, EntryPoint] = {point.name: point for point in entry_points(group=GROUP)}
    if not colon or kind not in kinds:
        raise SettingsError(f"'{name}' is not a bus: write one of {', '.join(f'{k}:...' for k in sorted(kinds))}")
    opener = cast(BusOpener, kinds[kind].load())
    return opener(which, clock=clock)
