"""A time span as a person says it."""

from __future__ import annotations


def span_in_words(seconds: float) -> str:
    """In its two largest units: "59 min 3 s", "7305 d 4 h"."""
    minutes, s = divmod(max(0, int(seconds)), 60)
    hours, m = divmod(minutes, 60)
    days, h = divmod(hours, 24)
    if days:
        return f"{days} d {h} h"
    if h:
        return f"{h} h {m} min"
    return f"{m} min {s} s" if m else f"{s} s"
