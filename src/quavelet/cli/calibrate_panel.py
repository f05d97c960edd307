"""What a person at the bench sees: the steps, what to do now, the board as it is, and what went wrong."""

from __future__ import annotations

import time
from textwrap import wrap
from types import TracebackType
from typing import Self

from rich.console import Console, Group, RenderableType
from rich.live import Live
from rich.panel import Panel
from rich.table import Table
from rich.text import Text

from quavelet.bench.session import View
from quavelet.bench.session_watch import Seen
from quavelet.bench.session_words import in_words
from quavelet.core.instruction import Instruction
from quavelet.core.mounting import Axes, called

REDRAW_S = 0.1
WIDTH = 80
INSTRUCTION_LINES = 3
SHOWN_DEG = 10.0
_BAR = 20


class SessionPanel:
    """Draws at most ten times a second, on the terminal."""

    def __init__(self, console: Console, *, src: str) -> None:
        self._live = Live(console=console, auto_refresh=False, transient=False)
        self._src = src
        self._drawn_s = 0.0
        self._at = -1

    def __enter__(self) -> Self:
        self._live.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._live.stop()

    def ask(self, instruction: Instruction) -> None:
        """Ring the bell: a person turns the board with his eyes on it."""
        del instruction
        self._live.console.bell()

    def show(self, view: View) -> None:
        if view.at != self._at or time.monotonic() - self._drawn_s >= REDRAW_S:
            self._at, self._drawn_s = view.at, time.monotonic()
            self._live.update(render(view, self._src), refresh=True)


def render(view: View, src: str) -> RenderableType:
    """The picture of one moment."""
    steps = Table.grid(padding=(0, 2))
    for k, (_, title, progress) in enumerate(view.steps):
        if k == view.at:
            steps.add_row(
                Text("▶", style="bold cyan"),
                Text(title, style="bold"),
                _bar(progress, "cyan"),
                Text(view.status.replace("degC", "°C"), overflow="ellipsis", no_wrap=True),
            )
        elif progress >= 1.0:
            steps.add_row(Text("✓", style="green"), title, Text("done", style="green"), "")
        else:
            steps.add_row(Text("·", style="dim"), Text(title, style="dim"), "", "")
    rows: list[RenderableType] = [steps, ""]
    if view.instruction is None:
        rows.append(Text("All is measured.", style="bold green"))
    else:
        lines = wrap(in_words(view.instruction, view.axes), WIDTH - 4)
        # As high whatever is asked: nothing jumps under the eyes.
        rows.append(Text("\n".join(lines + [""] * (INSTRUCTION_LINES - len(lines))), style="bold"))
    rows.append("")
    if view.seen is not None:
        rows.append(_board(view.seen, view.needs_s, view.instruction, view.axes))
    rows += ["", Text(view.notice.replace("degC", "°C") or "all well", style="yellow" if view.notice else "green")]
    fake = "fake:" in src
    title = f"NOT A REAL CHIP — calibrating {src}" if fake else f"calibrating {src}"
    return Panel(
        Group(*rows),
        title=title,
        subtitle="Ctrl-C stops; what is measured is kept",
        border_style="magenta" if fake else "blue",
        width=WIDTH,
    )


def _board(seen: Seen, needs_s: float, asked: Instruction | None, axes: Axes) -> RenderableType:
    facts = Table.grid(padding=(0, 2))
    if seen.still_s > 0.0:
        still: RenderableType = Text("still", style="bold green")
        if needs_s:
            still = Table.grid(padding=(0, 1))
            part = min(1.0, seen.still_s / needs_s)
            still.add_row(
                Text("still ", style="bold green"),
                _bar(part, "green"),
                f"{min(seen.still_s, needs_s):.1f} of {needs_s:g} s",
            )
    else:
        whole = f" of {_asked_turn(asked.turn_deg)}" if asked is not None and asked.turn_deg else ""
        turned = f", turned by {seen.turned_deg:+.0f}°{whole}" if abs(seen.turned_deg) >= SHOWN_DEG else ""
        still = Text(f"moving{turned}", style="bold yellow")
    facts.add_row("board", still)
    facts.add_row("up", _face(seen.face, asked.face if asked is not None else "", axes))
    trend = "" if seen.trend_degc_min is None else f", {seen.trend_degc_min:+.2f} °C/min"
    facts.add_row("chip", f"{seen.temp_degc:.1f} °C{trend}")
    return facts


def _asked_turn(turn_deg: float) -> str:
    """A whole turn goes one way; half round is the same either way."""
    return f"{turn_deg:+.0f}°" if abs(turn_deg) >= 360.0 else f"{abs(turn_deg):.0f}°"


def _face(face: str | None, asked: str, axes: Axes) -> Text:
    """Which is up, beside the one asked for, "" where none is."""
    style = "dim" if not face else "bold green" if face == asked else "bold"
    up = Text(called(face, axes) if face else "no face", style=style)
    if not asked or face == asked:
        return up
    return up.append(f"  (asked for: {called(asked, axes)})", style="not bold dim")


def _bar(part: float, style: str) -> Text:
    full = round(_BAR * part)
    return Text("█" * full, style=style) + Text("─" * (_BAR - full), style="dim")
