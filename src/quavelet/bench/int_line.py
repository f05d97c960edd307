"""The data-ready line: whether a pulse comes with each sample."""

from __future__ import annotations

from collections.abc import Sequence

from quavelet.bench.finding import Finding
from quavelet.bus.protocol import Edge
from quavelet.core.errors import ImuError
from quavelet.core.units import NS_PER_S

NAME = "data-ready line"
RATE_LIMIT = 0.01


def not_opened(line: str, error: ImuError) -> Finding:
    """The line that is set cannot be had."""
    return Finding(
        name=NAME, ok=False, found=f"{line} cannot be opened, samples are timed by counts", advice=str(error)
    )


def pulses(line: str, edges: Sequence[Edge], *, rate_hz: float, listened_s: float) -> Finding:
    """What came from the line, oldest first, while the chip took `rate_hz` samples a second."""
    if len(edges) < 2:
        return Finding(
            name=NAME,
            ok=False,
            found=f"{_pulses(len(edges))} from {line} in {listened_s:g} s, samples are timed by counts",
            advice=f"wire the board's INT to {line}, or set bus.int_line to the line that it is wired to",
        )
    first, last = edges[0], edges[-1]
    pulses_hz = (last.seq - first.seq) * NS_PER_S / max(last.t_ns - first.t_ns, 1)
    found, figures = f"{pulses_hz:.2f} pulses/s from {line}", {"pulses_hz": round(pulses_hz, 4)}
    if abs(pulses_hz / rate_hz - 1.0) > RATE_LIMIT:
        return Finding(
            name=NAME,
            ok=False,
            found=f"{found} where the chip takes {rate_hz:.2f} samples/s",
            advice=f"nothing but INT may be at {line}: look for a wrong or loose wire, and keep it away from motors",
            figures=figures,
        )
    return Finding(name=NAME, ok=True, found=f"{found}, one with each sample", figures=figures)


def _pulses(n: int) -> str:
    return "one pulse" if n else "no pulse"
