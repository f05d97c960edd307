"""What a transport is: the place that an output's bytes go to."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol


@dataclass(frozen=True, slots=True)
class TransportStats:
    """What became of what a transport was given.

    state     in words: "listening on ...", "connected", "waiting for the broker: ...", "closed"
    sent      payloads that went out; with many readers, to each of them
    lost      payloads that did not; with many readers, for each of them
    readers   connected at this moment
    refused   readers turned away, since there were too many
    bytes     that went out
    """

    state: str
    sent: int = 0
    lost: int = 0
    readers: int = 0
    refused: int = 0
    bytes: int = 0


class Transport(Protocol):
    """Where bytes go. All methods are called on the network's thread, and none may keep it waiting."""

    async def open(self) -> None:
        """Be ready to send. Raises OSError, or ImuError with what to do."""
        ...

    def send(self, payload: bytes) -> None:
        """Let a payload go, whole or not at all; what cannot go at once is lost and counted. Raises OSError."""
        ...

    async def close(self) -> None:
        """Give back all that is open; also after `open` raised."""
        ...

    def stats(self) -> TransportStats:
        """What became of all payloads so far; may be read from any thread."""
        ...
