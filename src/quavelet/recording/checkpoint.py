"""A recording on its way through decoder and pipeline, which can be left anywhere and gone on with to the same bit."""

from __future__ import annotations

import pickle
from bisect import bisect_right
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TypeVar

from quavelet.core.blocks import AttitudeBlock, Block, RawBlock, concat
from quavelet.core.health import Health
from quavelet.core.units import NS_PER_S
from quavelet.pipeline import Pipeline, PipelineState
from quavelet.recording.reader import RecordingReader
from quavelet.recording.replay import ReplaySource, ReplayState

B = TypeVar("B", bound=Block)

STEP_NS = 10 * NS_PER_S
MOST_CHECKPOINTS = 2000
MOST_BYTES = 40_000_000


@dataclass(frozen=True, slots=True)
class Checkpoint:
    """All memory after a drain.

    at_ns   recorded time from the first drain to this one
    source  the reader's position, the decoder's memory and the counters
    packed  what the pipeline remembers, and the last row it gave, in one piece: as objects it takes four times as much
    """

    at_ns: int
    source: ReplayState
    packed: bytes


class Replaying:
    """Reads a recording drain by drain, and knows how long after its first drain it is.

    at_ns   recorded time of the drain read last. It never goes back: where the recorded clock does, no time passes
    last    the last row the pipeline gave, None before the first
    """

    def __init__(self, reader: RecordingReader, *, make_pipeline: Callable[[], Pipeline]) -> None:
        self.reader = reader
        self.health = Health()
        self.source = ReplaySource(reader, health=self.health)
        self.at_ns = 0
        self.last: AttitudeBlock | None = None
        self._pipeline = make_pipeline()

    @property
    def since_ns(self) -> int:
        """By so much a recorded time is later than its distance from the first drain."""
        drain = self.source.last_drain
        return (drain.after_ns if drain else 0) - self.at_ns

    def read(self) -> RawBlock | None:
        """The samples of the next drain, None at the end. Raises RecordingError where the file cannot be read on."""
        before = self.source.last_drain
        block = self.source.read()
        now = self.source.last_drain
        if block is not None and before is not None and now is not None:
            self.at_ns += max(0, now.after_ns - before.after_ns)
        return block

    def process(self, blocks: Sequence[RawBlock]) -> AttitudeBlock | None:
        """What the pipeline makes of these, in one piece; None where it gives no row."""
        given = [block for run in _alike(blocks) if len(block := self._pipeline.process(_one(run)))]
        if not given:
            return None
        attitude = _one(given)
        self.last = attitude[-1:]
        return attitude

    def checkpoint(self) -> Checkpoint:
        """The state at this moment; all that was read must have been processed."""
        packed = pickle.dumps((self._pipeline.state(), self.last), protocol=pickle.HIGHEST_PROTOCOL)
        return Checkpoint(self.at_ns, self.source.state(), packed)

    def go_on_from(self, checkpoint: Checkpoint) -> None:
        """Be as it was at `checkpoint`, which may be of another `Replaying` of the same file and settings."""
        state: PipelineState
        state, self.last = pickle.loads(checkpoint.packed)
        self._pipeline.restore(state)
        self.source.restore(checkpoint.source)
        self.at_ns = checkpoint.at_ns


class Checkpoints:
    """Checkpoints every so often, in bounded memory: of too many every second one goes, and they are kept half as often
    from then on.

    One thread keeps them, any may ask for one.
    """

    def __init__(self, *, most: int = MOST_CHECKPOINTS, most_bytes: int = MOST_BYTES, step_ns: int = STEP_NS) -> None:
        self.step_ns = step_ns
        self._most = most
        self._most_bytes = most_bytes
        self._bytes = 0
        self._kept: list[Checkpoint] = []

    def __len__(self) -> int:
        return len(self._kept)

    @property
    def wanted_ns(self) -> int:
        """From when on the next one is to be kept."""
        return self._kept[-1].at_ns + self.step_ns if self._kept else 0

    def keep(self, checkpoint: Checkpoint) -> None:
        self._kept.append(checkpoint)
        self._bytes += len(checkpoint.packed)
        if len(self._kept) > self._most or self._bytes > self._most_bytes:
            # A list of its own: whoever looks through the other one goes on doing so.
            self._kept = self._kept[::2]
            self._bytes = sum(len(kept.packed) for kept in self._kept)
            self.step_ns *= 2

    def before(self, at_ns: int) -> Checkpoint:
        """The last one that is not after `at_ns`; the first one for what is before all. One must have been kept."""
        kept = self._kept
        return kept[max(0, bisect_right(kept, at_ns, key=lambda checkpoint: checkpoint.at_ns) - 1)]


def _one(blocks: list[B]) -> B:
    return blocks[0] if len(blocks) == 1 else concat(blocks)


def _alike(blocks: Sequence[RawBlock]) -> list[list[RawBlock]]:
    """The blocks with rows, those of one scale one after the other together."""
    runs: list[list[RawBlock]] = []
    for block in blocks:
        if not len(block):
            continue
        if runs and runs[-1][0].scale == block.scale:
            runs[-1].append(block)
        else:
            runs.append([block])
    return runs
