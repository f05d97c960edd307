"""The one thing a driver needs of a bus: move bytes to and from an address."""

from __future__ import annotations

from types import TracebackType
from typing import Protocol, Self


class I2CBus(Protocol):
    """An I2C bus. Every failure is a `BusError` or a kind of it; a transfer of no bytes is a ValueError.

    `name` is what the bus was opened by ("linux:1", "fake:tilt"); it goes into every output as `src`.
    """

    @property
    def name(self) -> str: ...

    def write(self, address: int, data: bytes) -> None:
        """One transaction: START, address, all bytes of `data`, STOP. `data` is not empty."""
        ...

    def write_read(self, address: int, data: bytes, n: int) -> bytes:
        """One transaction: write `data`, repeated START, read `n` bytes (1 to 8192), STOP."""
        ...

    def close(self) -> None:
        """Let go of the bus; a closed bus refuses every transfer. May be called twice."""
        ...

    def __enter__(self) -> Self: ...

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None, /
    ) -> None: ...
