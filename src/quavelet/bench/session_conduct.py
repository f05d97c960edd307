"""Leads a session through on a live chip: drains it, tells the operator, keeps what was measured."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Protocol

from quavelet.bench.session import Session, View
from quavelet.bench.session_store import SessionStore
from quavelet.core.clock import Clock
from quavelet.core.errors import CalibrationError
from quavelet.core.flow import BlockSource
from quavelet.core.instruction import Instruction
from quavelet.core.units import NS_PER_S
from quavelet.loop.deadline import FixedStepLoop
from quavelet.settings import Settings

LOOKS_HZ = 20.0
"""Often enough for a person to see the board follow; at 200 Hz ten frames wait in the FIFO, which has room for 73."""
KEPT_EACH_S = 20.0
SILENT_S = 1.0
SILENT = "the chip gives nothing: look at its plug and wires; nothing that is measured is lost"


class Operator(Protocol):
    """Who moves the board: a person at a terminal, or a fake board that follows by itself."""

    def ask(self, instruction: Instruction, /) -> None:
        """Do this now."""
        ...

    def show(self, view: View, /) -> None:
        """This is how it stands."""
        ...


def conduct(
    session: Session,
    source: BlockSource,
    *,
    settings: Settings,
    clock: Clock,
    operator: Operator,
    store: SessionStore,
    stopped: Callable[[], bool] = lambda: False,
    patience_s: float = float("inf"),
    looks_hz: float = LOOKS_HZ,
) -> bool:
    """Until all steps are done; False where `stopped` says so before. Whatever ends it, what was measured is kept.

    patience_s   so long a step may take with nobody there. Raises CalibrationError after it, DeviceLost as the source.
    looks_hz     how often the chip is drained and shown, more often where its FIFO needs it
    """
    rate_hz = max(looks_hz, settings.chip.sample_rate_hz / 35.0)
    loop = FixedStepLoop(clock, period_ns=round(NS_PER_S / rate_hz))
    asked, begun, kept_ns = 0, (-1, 0), clock.now_ns()
    fed_ns = kept_ns
    try:
        for now_ns in loop.deadlines():
            if stopped():
                return False
            block = source.read()
            if block is None:
                raise CalibrationError("the samples ended before the session did: resume it with the board")
            session.feed(block)
            fed_ns = now_ns if len(block) else fed_ns
            view = session.view()
            if now_ns - fed_ns > SILENT_S * NS_PER_S:
                view = replace(view, notice=SILENT)
            elif store.failure:
                view = replace(view, notice=view.notice or store.failure)
            operator.show(view)
            if view.asked != asked and view.instruction is not None and view.seen is not None:
                asked = view.asked
                operator.ask(view.instruction)
            if session.done:
                return True
            if view.at != begun[0]:
                begun = view.at, now_ns
                store.keep(session.evidence)
            elif now_ns - begun[1] > patience_s * NS_PER_S:
                name = view.steps[view.at][1]
                raise CalibrationError(f"'{name}' does not come to its end ({view.notice or view.status}): look there")
            if now_ns - kept_ns > KEPT_EACH_S * NS_PER_S:
                kept_ns = now_ns
                store.keep(session.evidence)
        return False
    finally:
        store.keep(session.evidence)
