"""JSON version 1, one message a line, to a byte stream."""

from __future__ import annotations

from typing import BinaryIO

import msgspec

from quavelet.sinks.message import Message


class JsonLines:
    """A sink on `stream` (standard output); each line is flushed, so that a reader has it at once."""

    def __init__(self, stream: BinaryIO) -> None:
        self._stream = stream
        self._encoder = msgspec.json.Encoder()

    def write(self, message: Message) -> None:
        self._stream.write(self._encoder.encode(message) + b"\n")
        self._stream.flush()

    def close(self) -> None:
        self._stream.flush()
