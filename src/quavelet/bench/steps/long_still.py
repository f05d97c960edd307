"""The step in which the board lies for minutes: its noise, as an Allan deviation."""

from __future__ import annotations

import numpy as np

from quavelet.bench.session_evidence import Evidence, StillRun
from quavelet.bench.session_watch import Seen
from quavelet.bench.steps.lying import MOVED
from quavelet.bench.steps.step import Step
from quavelet.core.blocks import CountArray
from quavelet.core.instruction import Instruction

LONG_S = 300.0
"""Five minutes show averages up to 75 s: the noise density well, the bias's instability roughly."""


class LongStill(Step):
    """One stretch without a disturbance or a lost sample; after one it begins anew, for no two can be joined."""

    name = "allan"
    title = "Long still run"

    def __init__(self, evidence: Evidence) -> None:
        super().__init__(evidence)
        self._parts: list[CountArray] = []
        self._periods_s: list[float] = []
        self._elapsed_s = 0.0

    @property
    def instruction(self) -> Instruction:
        return Instruction(action="rest")

    @property
    def progress(self) -> float:
        return 1.0 if self.evidence.still is not None else min(0.999, self._elapsed_s / LONG_S)

    @property
    def status(self) -> str:
        return f"{self._elapsed_s:.0f} of {LONG_S:.0f} s"

    def take(self, seen: Seen) -> None:
        if seen.still_s == 0.0 or seen.lost:
            if self._elapsed_s > 5.0:
                self.notice = MOVED if not seen.lost else "samples were lost: the run begins anew"
            self._parts, self._periods_s, self._elapsed_s = [], [], 0.0
            return
        self._parts.append(seen.raw.counts[:, [0, 1, 2, 4, 5, 6]])
        self._periods_s += seen.raw.period_s.tolist()
        self._elapsed_s += float(seen.raw.period_s.sum())
        if self._elapsed_s > 10.0:
            self.notice = ""
        if self._elapsed_s >= LONG_S:
            counts = np.ascontiguousarray(np.concatenate(self._parts))
            self.evidence.still = StillRun(period_s=float(np.mean(self._periods_s)), counts=counts.tobytes())
