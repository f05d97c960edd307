"""An output to standard output, as [output.NAME] with to = "stdout" has it."""

from __future__ import annotations

from typing import BinaryIO

from quavelet.sinks.encoding import Encoding
from quavelet.sinks.message import Message
from quavelet.sinks.thinning import Thinning


class Stdout:
    """A sink of the hub, on a thread of its own, since a pipe may block; each message is flushed."""

    def __init__(self, stream: BinaryIO, encoding: Encoding, thinning: Thinning) -> None:
        self._stream = stream
        self._encoding = encoding
        self._thinning = thinning

    def write(self, message: Message) -> None:
        taken = self._thinning.take(message)
        if taken is not None:
            self._stream.write(self._encoding.encode(taken))
            self._stream.flush()

    def close(self) -> None:
        self._stream.flush()
