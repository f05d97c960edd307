"""Doubt in words, for encodings that have a field for words, and when to say it again."""

from __future__ import annotations

import re

from quavelet.core.units import NS_PER_S
from quavelet.sinks.message import Message

AGAIN_NS = 10 * NS_PER_S
_PLAIN = re.compile(r"[^A-Za-z0-9_.:/-]")


def plain(name: str) -> str:
    """The name in at most 32 letters, digits and _ . : / -, so that no encoding takes part of it for its own."""
    return _PLAIN.sub("_", name)[:32] or "_"


def in_words(message: Message) -> str:
    """What a reader must know of the message, in plain letters, spaces and semicolons."""
    words = plain(message.src)
    if message.src.startswith("fake:"):
        words += " is not a real chip"
    words += f"; yaw {message.yaw}; "
    return words + (" ".join(map(plain, message.flags)) or "ok")


class Told:
    """Whether to say something: when it changes, and every 10 s, for one who came late or lost it on the way."""

    def __init__(self) -> None:
        self._words = ""
        self._t_ns = 0

    def due(self, words: str, *, t_ns: int) -> bool:
        """Whether `words` are to be said at `t_ns`; if so they are taken to have been."""
        if words == self._words and 0 <= t_ns - self._t_ns < AGAIN_NS:
            return False
        self._words, self._t_ns = words, t_ns
        return True
