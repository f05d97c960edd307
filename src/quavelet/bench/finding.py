"""One thing looked at, and what to do about it."""

from __future__ import annotations

import msgspec


class Finding(msgspec.Struct, frozen=True, kw_only=True):
    """What was found, in words and in figures (names with their units), and the one thing to do next.

    Advice on something that is not ok has to be taken; on something that is ok it may be: a note.
    """

    name: str
    ok: bool
    found: str
    advice: str = ""
    figures: dict[str, float] = {}
