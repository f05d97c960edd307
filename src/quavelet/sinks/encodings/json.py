"""JSON version 1, one message a line. What is no number goes out as null."""

from __future__ import annotations

import msgspec

from quavelet.sinks.message import Message
from quavelet.sinks.plan import OutputPlan


class Json:
    """The message as it is, so with all its doubt: flags, sigma_deg, yaw, gap_ns. Each line ends with a newline."""

    def __init__(self, plan: OutputPlan | None = None) -> None:
        del plan
        self._encoder = msgspec.json.Encoder()

    def encode(self, message: Message) -> bytes:
        return self._encoder.encode(message) + b"\n"
