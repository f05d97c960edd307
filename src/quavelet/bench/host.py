"""What this machine says of its I2C buses before one is touched: the kernel's own files, read only."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True, slots=True)
class HostBus:
    """A bus /dev/i2c-`number`.

    adapter    what drives it, as the kernel names it
    clock_hz   the bus's clock as the device tree asks for it; None where it says nothing
    """

    number: int
    adapter: str
    clock_hz: int | None = None

    def __str__(self) -> str:
        return f"linux:{self.number} ({self.adapter})" if self.adapter else f"linux:{self.number}"


class Host:
    """This machine; `root` is its /."""

    def __init__(self, root: Path = Path("/")) -> None:
        self._root = root
        self._devices = root / "sys/bus/i2c/devices"

    def buses(self) -> list[HostBus]:
        """The buses a program can open, by number."""
        numbers = [re.fullmatch(r"i2c-([0-9]{1,3})", path.name) for path in (self._root / "dev").glob("i2c-*")]
        return [self._bus(number) for number in sorted(int(found[1]) for found in numbers if found)]

    def _bus(self, number: int) -> HostBus:
        folder = self._devices / f"i2c-{number}"
        try:
            # A device tree's cell: four bytes, the highest first.
            clock_hz: int | None = int.from_bytes((folder / "of_node/clock-frequency").read_bytes()[:4], "big")
        except OSError:
            clock_hz = None
        return HostBus(number, _text(folder / "name"), clock_hz)

    def holder(self, number: int, address: int) -> tuple[str, str]:
        """The device the kernel was told of at this address, and the driver that holds it; "" where there is none."""
        folder = self._devices / f"{number}-{address:04x}"
        driver = folder / "driver"
        return _text(folder / "name"), driver.resolve().name if driver.exists() else ""


def others(buses: Sequence[HostBus], number: int | None) -> str:
    """The buses beside that of this number, in words; "" where there is none."""
    return ", ".join(str(bus) for bus in buses if bus.number != number)


def linux_number(bus: str) -> int | None:
    """N of "linux:N"; None for a bus of another kind."""
    kind, _, which = bus.partition(":")
    return int(which) if kind == "linux" and which.isdecimal() else None


def _text(path: Path) -> str:
    try:
        return path.read_text(errors="replace").strip()
    except OSError:
        return ""
