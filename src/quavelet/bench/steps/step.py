"""What every step of a session is."""

from __future__ import annotations

from abc import ABC, abstractmethod

from quavelet.bench.session_evidence import Evidence
from quavelet.bench.session_watch import Seen
from quavelet.core.instruction import Instruction
from quavelet.core.mounting import AS_THE_CHIP, Axes, called

PATIENCE_POSES = 5
"""Who leaves the board lying is told again after so many poses of 3 s, not after each."""


class Step(ABC):
    """One step. It takes what it needs from what is seen into the evidence, and is done when there is enough.

    What is measured lives in the evidence alone, so a step begun anew on evidence goes on where that ends.

    name      by which it is asked for
    title     what a person calls it
    notice    what went wrong last, and what to do; "" where all is well
    asks      goes up where the same instruction is to be followed once more
    """

    name: str
    title: str

    axes: Axes = AS_THE_CHIP
    """How the chip is mounted: what a person is told of its faces is in the axes of the body."""

    def __init__(self, evidence: Evidence) -> None:
        self.evidence = evidence
        self.notice = ""
        self.asks = 0
        self._idle = 0

    def ask_again(self, *, moved: bool) -> None:
        """The instruction once more, after a pose that was not what it asked for: at once where the board was moved to
        it, else now and then."""
        self._idle = 0 if moved else self._idle + 1
        self.asks += self._idle % PATIENCE_POSES == 0

    @property
    @abstractmethod
    def instruction(self) -> Instruction:
        """What the person is to do."""

    @property
    @abstractmethod
    def progress(self) -> float:
        """0 to 1; the step is done at 1."""

    @abstractmethod
    def take(self, seen: Seen) -> None:
        """Look at the newest samples."""

    def called(self, face: str) -> str:
        """A face as the person knows it."""
        return called(face, self.axes)

    @property
    def status(self) -> str:
        """Progress in words."""
        return f"{100.0 * self.progress:.0f} %"

    @property
    def needs_s(self) -> float:
        """For how long the board must be still to be measured next; 0 where that is not what is waited for."""
        return 0.0
