"""Waiting for what other threads and processes do, in real time and bounded."""

from __future__ import annotations

import time
from collections.abc import Callable


def eventually(what: Callable[[], bool], *, within_s: float = 10.0, look_s: float = 0.02) -> bool:
    """Whether it comes about."""
    deadline_s = time.monotonic() + within_s
    while not what():
        if time.monotonic() > deadline_s:
            return False
        time.sleep(look_s)
    return True
