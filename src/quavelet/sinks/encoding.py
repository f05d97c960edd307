"""What an encoding is: a message to bytes."""

from __future__ import annotations

from typing import Protocol

from quavelet.sinks.message import Message


class Encoding(Protocol):
    """How a message is written; pure: it opens nothing and waits for nothing."""

    def encode(self, message: Message) -> bytes:
        """The bytes of one message, whole lines where the encoding is text; b"" where there is nothing to say now."""
        ...
