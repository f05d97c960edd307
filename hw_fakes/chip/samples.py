"""When samples fall, and what a source of them must be able to do."""

from __future__ import annotations

from dataclasses import dataclass
from math import ceil
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from hw_fakes.chip.setup import Setup

CountArray = NDArray[np.int16]


@dataclass(frozen=True, slots=True)
class Run:
    """A stretch of even sampling: one oscillator, one rate. Sample n = 0, 1, ... falls n + 1 periods after the start.

    number          how many runs there were before
    start_ns        clock time it began
    awake_since_ns  clock time the chip woke
    tick_ns         true time between two outputs of the gyroscope
    nominal_hz      outputs of the gyroscope a second, by the chip's own clock: 1000, 8000 or 32000
    divider         outputs of the gyroscope a sample
    """

    number: int
    start_ns: int
    awake_since_ns: int
    tick_ns: float
    nominal_hz: int
    divider: int

    @property
    def period_ns(self) -> float:
        """True time between two samples."""
        return self.tick_ns * self.divider

    def time_ns(self, ticks: int) -> int:
        """When the gyroscope gives its output number `ticks`, counted from 1."""
        return self.start_ns + ceil(ticks * self.tick_ns)

    def samples_by(self, now_ns: int) -> int:
        """How many samples have fallen by `now_ns`."""
        return int((now_ns - self.start_ns) / self.tick_ns) // self.divider

    @property
    def chunk(self) -> int:
        """Samples that are computed together: some 4000 ticks or a second's, and whole ones of the accelerometer."""
        return 8 * max(1, max(4096, self.nominal_hz) // 8 // self.divider)


class SampleSource(Protocol):
    """Where the words of samples come from."""

    def words(self, run: Run, setup: Setup, chunk: int, /) -> CountArray:
        """Words (run.chunk, 7) of the samples from chunk * run.chunk on, the same whenever they are asked for."""
        ...

    def limit(self, run: Run, /) -> int | None:
        """How many samples the run can have before the source is exhausted; None for a source without end."""
        ...

    def fifo_begins(self, run: Run, sample: int, /) -> None:
        """The FIFO was switched on for the first time; `sample` will be the first in it."""
        ...

    def forget(self) -> None:
        """Words that were computed ahead are not valid any more."""
        ...
