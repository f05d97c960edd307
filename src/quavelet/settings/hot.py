"""Which settings a reload puts in force at once; all others need a restart."""

from __future__ import annotations

HOT_TABLES = ("output",)
"""Tables that are put in force without a restart: nothing in the loop is made of them."""


def is_hot(name: str) -> bool:
    """Whether a change of that key or table ("output.phone.rate_hz", "chip") needs no restart."""
    return name.partition(".")[0] in HOT_TABLES
