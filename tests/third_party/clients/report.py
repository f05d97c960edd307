"""What a client of a driver tells: one JSON object, with vectors in m/s^2 and deg/s, a temperature in degC."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Iterable


def readings(set_range: Callable[[int], object], ranges: Iterable[int], read: Callable[[], Iterable[float]]) -> dict:
    """What `read` gives at each range; samples come in real time."""
    result = {}
    for full_scale in ranges:
        set_range(full_scale)
        time.sleep(0.05)
        result[full_scale] = list(read())
    return result


def tell(**what: object) -> None:
    print(json.dumps(what))
