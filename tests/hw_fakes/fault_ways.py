"""The three ways a fault comes about: by hand, by a plan, by a line of text."""

from __future__ import annotations

from typing import Any

from hw_fakes.faults.base import Fault, Happened
from hw_fakes.faults.plan import FaultEntry, parse

WAYS = ("by hand", "by plan", "by text")
LATER_S = 0.005


def let_happen(board: Any, way: str, kind: Fault, **when: Any) -> None:
    """Let a fault begin; planned ones begin 5 ms later, and those 5 ms pass."""
    faults = board.bus.adapter.faults
    if way == "by hand":
        faults.now(kind, **when)
        return
    at_s = board.clock.now_ns() / 1e9 + LATER_S
    entry = FaultEntry(kind, at_s=at_s, **when)
    faults.add(entry if way == "by plan" else parse(str(entry)))
    board.wait_ms(1000 * LATER_S)


def happened(board: Any) -> list[Happened]:
    return list(board.bus.adapter.faults.history)


def names(board: Any) -> list[str]:
    return [one.kind.name for one in happened(board)]
