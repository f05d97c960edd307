"""The bench session as a state machine: samples in, what to do next out. No terminal, no clock, no file in it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from quavelet.bench.session_evidence import Evidence
from quavelet.bench.session_watch import Seen, Watch
from quavelet.bench.steps.faces import Check, Faces, Poses
from quavelet.bench.steps.field import Field
from quavelet.bench.steps.long_still import LongStill
from quavelet.bench.steps.lying import Rest, Temperature, WarmUp
from quavelet.bench.steps.step import Step
from quavelet.bench.steps.turns import Turns
from quavelet.core.blocks import RawBlock
from quavelet.core.errors import SettingsError
from quavelet.core.instruction import Instruction
from quavelet.core.mounting import AS_THE_CHIP, Axes

KINDS: tuple[type[Step], ...] = (WarmUp, Rest, Faces, Turns, Poses, LongStill, Temperature, Field, Check)
STEPS = tuple(kind.name for kind in KINDS)
"""In the order in which they are done; the noise before the heat, for the drift of a board that cools hides it."""
USUAL = (WarmUp.name, Rest.name, Faces.name, Turns.name, Poses.name, Check.name)


@dataclass(frozen=True, slots=True)
class View:
    """All that is to be shown.

    steps        name, title and progress (0 to 1) of each
    at           number of the present step; as many as there are once all is done
    status       its progress in words
    instruction  what the person is to do, None once all is done
    notice       what went wrong last and what to do; "" where all is well
    seen         the board as it is, None before the first samples
    needs_s      for how long it must be still, 0 where that is not what is waited for
    asked        another number each time the person is to be told anew
    axes         how the chip is mounted: faces are the chip's here, and the person's in words
    """

    steps: tuple[tuple[str, str, float], ...]
    at: int
    status: str
    instruction: Instruction | None
    notice: str
    seen: Seen | None
    needs_s: float
    asked: int
    axes: Axes = AS_THE_CHIP


class Session:
    """The steps one after another. What is measured is in `evidence`; one that holds it already goes on from there."""

    def __init__(self, names: Sequence[str], evidence: Evidence, *, axes: Axes = AS_THE_CHIP) -> None:
        """Raises SettingsError for a step that there is not, or no step at all."""
        self.evidence = evidence
        self._steps = [kind(evidence) for kind in KINDS if kind.name in checked(names)]
        for step in self._steps:
            step.axes = axes
        self._axes = axes
        self._watch = Watch()
        self._seen: Seen | None = None
        self._at = 0
        self._asked: tuple[int, int, Instruction | None] = (0, 0, None)
        self._go_on()

    @property
    def done(self) -> bool:
        return self._at == len(self._steps)

    @property
    def step(self) -> Step | None:
        """The present one, None once all is done."""
        return None if self.done else self._steps[self._at]

    def feed(self, raw: RawBlock) -> None:
        """Look at the newest samples."""
        if self.done or not len(raw):
            return
        self._seen = self._watch.seen(raw)
        step = self._steps[self._at]
        step.take(self._seen)
        if step.progress >= 1.0:
            self.evidence.done.append(step.name)
            self._go_on()

    def view(self) -> View:
        """What is to be shown at this moment."""
        step = self.step
        wanted = step.asks if step else 0, step.instruction if step else None
        if wanted != self._asked[1:]:
            self._asked = self._asked[0] + 1, *wanted
        return View(
            steps=tuple((one.name, one.title, self._progress(one)) for one in self._steps),
            at=self._at,
            status=step.status if step else "",
            instruction=step.instruction if step else None,
            notice=step.notice if step else "",
            seen=self._seen,
            needs_s=step.needs_s if step else 0.0,
            asked=self._asked[0],
            axes=self._axes,
        )

    def _progress(self, step: Step) -> float:
        return 1.0 if step.name in self.evidence.done else step.progress

    def _go_on(self) -> None:
        while not self.done and (
            self._steps[self._at].name in self.evidence.done or self._steps[self._at].progress >= 1.0
        ):
            self._at += 1


NEED_CHECK = (Rest.name, Faces.name, Turns.name, Poses.name, Temperature.name)
"""What they calibrate is judged by poses that no fit sees, so the check goes with them."""


def with_check(names: Sequence[str]) -> tuple[str, ...]:
    """The names, and the check where there will be something to be judged by it. Raises SettingsError."""
    names = checked(names)
    return (*names, Check.name) if Check.name not in names and set(names) & set(NEED_CHECK) else names


def checked(names: Sequence[str]) -> tuple[str, ...]:
    """The names, where each is one of a step. Raises SettingsError."""
    for name in names:
        if name not in STEPS:
            raise SettingsError(f"there is no step '{name}': take some of {', '.join(STEPS)}")
    if not names:
        raise SettingsError(f"a session without a step measures nothing: take some of {', '.join(STEPS)}")
    return tuple(names)
