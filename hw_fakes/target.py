"""What sits at an address of an I2C bus."""

from __future__ import annotations

from typing import Protocol


class Nack(Exception):
    """A chip does not acknowledge its address."""


class Target(Protocol):
    """A chip on the wires: the messages of a transaction one by one, then `stop`. Raises `Nack` where it is silent."""

    def write(self, data: bytes) -> None: ...

    def read(self, n: int) -> bytes: ...

    def stop(self) -> None: ...
