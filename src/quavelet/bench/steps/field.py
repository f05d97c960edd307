"""The step in which the board is swung through all attitudes: the magnetometer's sphere."""

from __future__ import annotations

from math import isfinite

import numpy as np

from quavelet.bench.session_watch import Seen
from quavelet.bench.steps.step import Step
from quavelet.calibration.magnetometer import coverage_of
from quavelet.core.blocks import FloatArray
from quavelet.core.instruction import Instruction

FEWEST = 300
COVERED = 0.85
"""The fit asks for 0.7; the middle is known roughly only while the board is turned."""
SOME = 500
"""Looked at while it grows: that many show any gap."""
SILENT_S = 5.0
RESTS_S = 2.0
"""A board that is held still for so long is asked for once more."""


class Field(Step):
    """Until the field was seen from nearly all directions."""

    name = "magnetometer"
    title = "Magnetometer"

    _silent_s = 0.0
    _covered = 0.0
    _rested = False

    @property
    def instruction(self) -> Instruction:
        return Instruction(action="swing")

    @property
    def progress(self) -> float:
        enough = min(1.0, len(self.evidence.field_ut) / FEWEST)
        return min(enough, self._covered / COVERED, 1.0)

    @property
    def status(self) -> str:
        return f"{100.0 * self._covered:.0f} of {100.0 * COVERED:.0f} % of all ways"

    def take(self, seen: Seen) -> None:
        new = [(x, y, z) for x, y, z in seen.raw.field_ut.tolist() if isfinite(x + y + z)]
        self._silent_s = 0.0 if new else self._silent_s + float(seen.raw.period_s.sum())
        self.notice = ""
        if seen.still_s > RESTS_S and not self._rested:
            self.asks += 1
        self._rested = seen.still_s > RESTS_S
        if self._silent_s > SILENT_S:
            self.notice = "the magnetometer gives nothing: leave this step out (--steps), or look at its wires"
        if not new:
            return
        self.evidence.field_ut += new
        self._covered = coverage(np.array(self.evidence.field_ut))


def coverage(field_ut: FloatArray) -> float:
    """What part of all directions the field (N, 3) was seen in, about the middle of its ends, 0 to 1."""
    some = field_ut[:: max(1, len(field_ut) // SOME)]
    away = some - 0.5 * (field_ut.max(axis=0) + field_ut.min(axis=0))
    return coverage_of(away)
