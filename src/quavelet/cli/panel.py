"""The live panel on a terminal: what a person wants to know at a glance."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from types import TracebackType
from typing import Self

from rich.console import Console, Group, RenderableType
from rich.live import Live
from rich.panel import Panel
from rich.table import Table
from rich.text import Text

from quavelet.core.health import Health
from quavelet.core.units import DEG_PER_RAD, NS_PER_MS
from quavelet.loop.deadline import LoopStats
from quavelet.sinks.message import Message

REDRAW_S = 0.1
_BAR_HALF_WIDTH = 13


@dataclass(frozen=True, slots=True)
class Status:
    """What the panel shows beside the attitude: the measured sample rate, the counters, the loop."""

    rate_hz: float | None
    health: Health
    loop: LoopStats | None


class LivePanel:
    """A sink that redraws at most ten times a second on `console`; `status` is asked at each redraw."""

    def __init__(self, console: Console, *, status: Callable[[], Status]) -> None:
        self._status = status
        self._live = Live(console=console, auto_refresh=False, transient=False)
        self._drawn_s = 0.0
        self._last: Message | None = None

    def __enter__(self) -> Self:
        self._live.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._live.stop()

    def write(self, message: Message) -> None:
        self._last = message
        if time.monotonic() - self._drawn_s >= REDRAW_S:
            self._draw(message)

    def close(self) -> None:
        """Show the last message, however soon it came after the one before."""
        if self._last is not None:
            self._draw(self._last)

    def _draw(self, message: Message) -> None:
        self._drawn_s = time.monotonic()
        self._live.update(render(message, self._status()), refresh=True)


def render(message: Message, status: Status) -> RenderableType:
    """The panel's picture of one message."""
    angles = Table.grid(padding=(0, 2))
    rows = (
        ("roll  about x", message.roll_deg, message.sigma_deg[0]),
        ("pitch about y", message.pitch_deg, message.sigma_deg[1]),
        (f"yaw   about z ({message.yaw})", message.yaw_deg, message.sigma_deg[2]),
    )
    for name, degrees, sigma in rows:
        angles.add_row(name, Text(f"{degrees:+8.2f}°", style="bold"), f"± {sigma:6.2f}°", _bar(degrees))
    x, y, z = (DEG_PER_RAD * rate for rate in message.gyro_rad_s)
    fx, fy, fz = message.accel_m_s2
    facts = Table.grid(padding=(0, 2))
    facts.add_row("rate", f"{x:+7.2f} {y:+7.2f} {z:+7.2f} °/s")
    facts.add_row("force", f"{fx:+7.3f} {fy:+7.3f} {fz:+7.3f} m/s²")
    facts.add_row(
        "chip", f"{message.temp_degc:.1f} °C, {_rate(status.rate_hz)}, {'still' if message.still else 'moving'}"
    )
    health = status.health
    facts.add_row(
        "lost", f"{health.samples_lost} of {health.samples + health.samples_lost} samples in {health.gaps} gaps"
    )
    if status.loop is not None:
        late = status.loop
        facts.add_row(
            "loop",
            f"late {late.lateness_p50_ns / NS_PER_MS:.2f} ms p50, {late.lateness_p99_ns / NS_PER_MS:.2f} ms p99, "
            f"{late.missed} missed",
        )
    flags = Text(", ".join(message.flags) or "all well", style="yellow" if message.flags else "green")
    fake = "fake:" in message.src
    # First, for a long name is cut.
    title = f"NOT A REAL CHIP — {message.src}" if fake else message.src
    return Panel(Group(angles, "", facts, "", flags), title=title, border_style="magenta" if fake else "blue", width=80)


def _rate(rate_hz: float | None) -> str:
    return "rate not measured yet" if rate_hz is None else f"{rate_hz:.2f} samples/s"


def _bar(degrees: float) -> str:
    """A needle between -180 and +180 degrees."""
    cells = ["·"] * (2 * _BAR_HALF_WIDTH + 1)
    cells[_BAR_HALF_WIDTH] = "|"
    cells[round((degrees + 180.0) / 360.0 * (len(cells) - 1))] = "█"
    return "".join(cells)
