"""Who is told what to do: a person at a terminal or behind a pipe, and a fake board that follows by itself."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager

from rich.console import Console

from quavelet.bench.session import View
from quavelet.bench.session_conduct import Operator
from quavelet.bench.session_words import in_words
from quavelet.bus.protocol import FollowsInstructions, I2CBus
from quavelet.cli.calibrate_panel import SessionPanel
from quavelet.cli.run import talk
from quavelet.core.instruction import Instruction
from quavelet.core.mounting import AS_THE_CHIP


class Lines:
    """Talks in lines, where there is no terminal; a fake board hears it."""

    def __init__(self, bus: FollowsInstructions | None, *, then: Operator | None = None) -> None:
        self._bus = bus
        self._then = then
        self._told: tuple[int, str] = (-1, "")
        self._status = ""
        self._axes = AS_THE_CHIP

    def ask(self, instruction: Instruction) -> None:
        if self._bus is not None:
            self._bus.follow(instruction)
        if self._then is not None:
            self._then.ask(instruction)
        else:
            talk(f"{in_words(instruction, self._axes)} ({self._status})")

    def show(self, view: View) -> None:
        self._status, self._axes = view.status, view.axes
        if self._then is not None:
            self._then.show(view)
        elif self._told != (told := (view.at, view.notice)):
            if view.at != self._told[0] and view.at < len(view.steps):
                talk(f"step {view.at + 1} of {len(view.steps)}: {view.steps[view.at][1]}")
            if view.notice:
                talk(view.notice)
            self._told = told


@contextmanager
def operator_for(i2c: I2CBus, *, quiet: bool) -> Iterator[Operator]:
    """A panel on a terminal, else lines on stderr; a bus whose board moves by itself is told as well."""
    follows = i2c if isinstance(i2c, FollowsInstructions) else None
    if quiet or not sys.stderr.isatty():
        yield Lines(follows)
        return
    with SessionPanel(Console(stderr=True), src=i2c.name) as panel:
        yield Lines(follows, then=panel) if follows else panel
