"""What a paper's module exports: an `Experiment`, and what its run gives: rows, charts, remarks.

A module `study/paperNNN.py` has one public name, `EXPERIMENT`. Its `run` is a module-level function (it goes
to another process), draws only from generators seeded with the row's own figure, and gives the same rows
in every process.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import KW_ONLY, dataclass
from enum import Enum
from math import inf, isfinite

from quavelet.drawing.chart import Chart


class Verdict(Enum):
    """What became of a figure that the paper prints."""

    REPRODUCED = "reproduced"
    """As the paper says it, within the band."""
    READING = "only under a reading"
    """Reached only by one reading of several, or with a noise model that was tuned to it: `reading` says which."""
    REFUTED = "refuted"
    """What the paper says does not follow, or is a slip."""
    NONE = ""
    """A row of ours, which the paper does not print: an acceptance row."""


class Effort(Enum):
    """How much is simulated. QUICK is within 20 s of one core a paper, with fewer runs: a row whose band needs
    all the runs is left out or has no band then, its band is never made wider."""

    FULL = "full"
    QUICK = "quick"


Progress = Callable[[float, str], None]
"""Called now and then with the share done, 0 to 1, and what is being done, in a few words."""


def silent(_share: float, _what: str) -> None:
    """A `Progress` that tells nobody."""


@dataclass(frozen=True, slots=True)
class Row:
    """One number of a paper's table, or one of our own acceptance rows, beside what this program got.

    A row is one number: three axes are three rows with the same `id`, and `what` names the axis.
    """

    id: str
    """The acceptance row ("0e") or the place in the paper ("T2.5": table 2, line 5)."""
    what: str
    """What the number is, in words: "method 5B, largest error, pitch"."""
    _: KW_ONLY
    got: float
    """What this program got; NaN where there is no such number (heading of an accelerometer)."""
    unit: str
    """"deg", "deg/h", "" for a ratio."""
    printed: str = ""
    """What the paper prints, as text; "" where it prints nothing."""
    low: float = -inf
    """The band `got` must be in, both ends included; by itself infinite: the row is shown, not judged."""
    high: float = inf
    verdict: Verdict = Verdict.NONE
    note: str = ""
    """One sentence: why the verdict, or what the row documents."""
    reading: str = ""
    """The reading or the tuning that `READING` speaks of."""

    @property
    def judged(self) -> bool:
        """Has the row a band?"""
        return isfinite(self.low) or isfinite(self.high)

    @property
    def passed(self) -> bool:
        """Is the number within its band? True of a row without one."""
        return not self.judged or self.low <= self.got <= self.high


@dataclass(frozen=True, slots=True, eq=False)
class Result:
    """What a run gave. `remarks` are sentences: corrections to the paper, what could not be reproduced and why."""

    rows: tuple[Row, ...]
    charts: tuple[Chart, ...] = ()
    remarks: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Experiment:
    """One paper: `title` says what it proposes, `headline` what it claims and what came of that, in a sentence."""

    paper: str
    """"000" to "004"."""
    title: str
    headline: str
    run: Callable[[Effort, Progress], Result]
