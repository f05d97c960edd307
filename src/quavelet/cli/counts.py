"""What was counted, in words for the person who reads it."""

from __future__ import annotations

from collections.abc import Iterator

from quavelet.core.health import EXPECTED, WORDS, Health


def in_words(health: Health) -> Iterator[str]:
    """A line for each thing that happened and is not as usual: how often, what, and the counter's name."""
    for name, n in health.as_dict().items():
        if n and name not in EXPECTED:
            yield f"{n} x {WORDS.get(name, 'counted')} ({name})"
