"""Buses by name: "linux:1", "fake:tilt", or any other kind that an installed package adds."""

from __future__ import annotations

from importlib.metadata import EntryPoint, entry_points
from typing import Protocol, cast

from quavelet.bus.data_ready import open_data_ready
from quavelet.bus.protocol import DataReady, HasDataReady, I2CBus
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


def open_line(name: str, *, bus: I2CBus, address: int) -> DataReady | None:
    """The data-ready line called `name` from the chip at `address`, "LABEL:LINE" of a GPIO or what `bus` itself calls
    one of its own; None for "". Raises as `open_data_ready`."""
    if not name:
        return None
    return bus.data_ready(name, address=address) if isinstance(bus, HasDataReady) else open_data_ready(name)
