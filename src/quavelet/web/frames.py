"""What goes to the page, as frames of a websocket: each is made once, whoever gets it.

A frame of a server is not masked (RFC 6455, 5.2), so its bytes are the same for every viewer.
"""

from __future__ import annotations

from collections.abc import Mapping

import msgspec

from quavelet.core.units import NS_PER_US
from quavelet.loop.histogram import BINS_PER_DECADE, EDGES_NS, Histogram
from quavelet.sinks.message import Message

VERSION = 1
_TEXT = 0x81
"""FIN, and the opcode of a text frame."""
_MERGED = BINS_PER_DECADE // 5
"""Bins of the loop's histogram that make one of the page's: five a decade can be told apart on a telephone."""
_encoder = msgspec.json.Encoder()


def text_frame(payload: bytes) -> bytes:
    """One whole frame of text."""
    length = len(payload)
    if length < 126:
        return bytes((_TEXT, length)) + payload
    if length < 65_536:
        return bytes((_TEXT, 126)) + length.to_bytes(2, "big") + payload
    return bytes((_TEXT, 127)) + length.to_bytes(8, "big") + payload


def frame(kind: str, **fields: object) -> bytes:
    """{"is": kind, ...}. Raises TypeError, ValueError or RecursionError for what JSON cannot hold."""
    return text_frame(_encoder.encode({"is": kind, **fields}))


def message_frame(message: Message, *, now_ns: int) -> bytes:
    """A message; now_ns is the time of the same clock at which it goes."""
    return text_frame(b'{"is":"message","now_ns":%d,"m":%b}' % (now_ns, _encoder.encode(message)))


def ability_frame(name: str, state: bytes) -> bytes:
    """How an ability stands; `state` is JSON already."""
    return text_frame(b'{"is":"ability","name":%b,"state":%b}' % (_encoder.encode(name), state))


def encoded(value: object) -> bytes:
    """Any value as JSON. Raises as `frame` does."""
    return _encoder.encode(value)


def lateness_of(histogram: Histogram) -> Mapping[str, list[float]]:
    """How late the loop woke, for bars: counts[i] are those from edges_us[i] to edges_us[i + 1], without empty ends.

    What was below 1 us or above 10 s is in the first and the last bin.
    """
    below, *counts = histogram.counts
    over = counts.pop()
    merged = [sum(counts[i : i + _MERGED]) for i in range(0, len(counts), _MERGED)]
    edges = [edge_ns / NS_PER_US for edge_ns in EDGES_NS[::_MERGED]]
    merged[0] += below
    merged[-1] += over
    used = [i for i, count in enumerate(merged) if count]
    if not used:
        return {"edges_us": [], "counts": []}
    first, last = used[0], used[-1] + 1
    return {"edges_us": edges[first : last + 1], "counts": [float(n) for n in merged[first:last]]}
