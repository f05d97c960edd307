"""The step in which the board lies for minutes: its noise, as an Allan deviation."""

from __future__ import annotations

import numpy as np

from quavelet.bench.session_evidence import Evidence, StillRun
from quavelet.bench.session_watch import Seen
from quavelet.bench.steps.lying import MOVED, beyond_sheet
from quavelet.bench.steps.step import Step
from quavelet.core.blocks import CountArray
from quavelet.core.instruction import Instruction

LONG_S = 300.0
"""Five minutes show averages up to 75 s: the noise density well, the bias's instability roughly."""
LEAST_S = 60.0
"""A shorter stretch shows averages up to 15 s at most, and is not kept."""
KEPT_EACH_S = 5.0
LOST = "samples were lost: look at its plug and wires"
EDGE_S = 1.0
"""What ends a stretch may have begun before it is seen: so much of its end is left off."""


class LongStill(Step):
    """Stretches without a disturbance or a lost sample, of a minute or more each, five minutes in all.

    No two can be joined, but what each shows counts. The one under way is in the evidence, so that an interruption
    ends it and loses nothing.
    """

    name = "allan"
    title = "Long still run"

    def __init__(self, evidence: Evidence) -> None:
        super().__init__(evidence)
        self._parts: list[CountArray] = []
        self._periods_s: list[float] = []
        self._elapsed_s = 0.0
        self._under_way = False

    @property
    def instruction(self) -> Instruction:
        return Instruction(action="rest")

    @property
    def progress(self) -> float:
        if self._kept_s >= LONG_S and not self._under_way:
            return 1.0
        return min(0.999, self._all_s / LONG_S)

    @property
    def status(self) -> str:
        return f"{self._all_s:.0f} of {LONG_S:.0f} s"

    @property
    def _kept_s(self) -> float:
        """What there is without the stretch under way."""
        ended = self.evidence.still[:-1] if self._under_way else self.evidence.still
        return sum(run.lasts_s for run in ended if run.lasts_s >= LEAST_S)

    @property
    def _all_s(self) -> float:
        return self._kept_s + self._elapsed_s

    def take(self, seen: Seen) -> None:
        hot = beyond_sheet(seen)
        if seen.still_s == 0.0 or seen.lost or hot:
            if self._elapsed_s > KEPT_EACH_S or hot or seen.lost:
                self.notice = hot or f"{LOST if seen.lost else MOVED}; {self._end()}"
            self._end()
            return
        self._parts.append(seen.raw.counts[:, [0, 1, 2, 4, 5, 6]])
        self._periods_s += seen.raw.period_s.tolist()
        self._elapsed_s += float(seen.raw.period_s.sum())
        if self._elapsed_s > 10.0:
            self.notice = ""
        run = self.evidence.still[-1].lasts_s if self._under_way else 0.0
        # The stretch under way counts once it is a minute long.
        enough = self._all_s - EDGE_S >= LONG_S and self._elapsed_s - EDGE_S >= LEAST_S
        if enough or self._elapsed_s - run > KEPT_EACH_S + EDGE_S:
            self._keep()
        if enough:
            self._under_way = False
            self.evidence.still[:] = [one for one in self.evidence.still if one.lasts_s >= LEAST_S]

    def _keep(self) -> None:
        """Put the stretch under way into the evidence, in place of what there was of it."""
        counts = np.concatenate(self._parts)
        period_s = float(np.mean(self._periods_s))
        counts = counts[: len(counts) - round(EDGE_S / period_s)]
        self._parts = [np.concatenate(self._parts)]
        if self._under_way:
            self.evidence.still.pop()
        self._under_way = True
        self.evidence.still.append(StillRun(period_s=period_s, counts=np.ascontiguousarray(counts).tobytes()))

    def _end(self) -> str:
        """End the stretch under way; says what becomes of it."""
        lasted_s = self.evidence.still[-1].lasts_s if self._under_way else 0.0
        if self._under_way and lasted_s < LEAST_S:
            self.evidence.still.pop()
        self._parts, self._periods_s, self._elapsed_s, self._under_way = [], [], 0.0, False
        return f"the {lasted_s:.0f} s before are kept" if lasted_s >= LEAST_S else "this stretch begins anew"
