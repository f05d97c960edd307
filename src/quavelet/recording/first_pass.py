"""A recording gone through once from end to end, for what is to be known before it can be played from anywhere."""

from __future__ import annotations

import threading
from collections.abc import Callable

from quavelet.core.blocks import RawBlock
from quavelet.core.errors import ImuError
from quavelet.core.units import NS_PER_S
from quavelet.pipeline import Pipeline
from quavelet.recording.checkpoint import Checkpoint, Checkpoints, Replaying
from quavelet.recording.overview import Overview, OverviewSoFar
from quavelet.recording.reader import RecordingReader

TOGETHER = 64
"""Drains that go through the pipeline in one piece: the results are the same, and it takes a third of the time."""


class FirstPass:
    """Goes through the recording of `reader`, once, and keeps checkpoints and an overview of it.

    `run` is for a thread of its own, or `step` is called until it says that all is done; all else may be asked from any
    thread. The reader must be nobody else's.

    known_ns   recorded time up to which it has come
    done       there is nothing more that could be read
    says       what is wrong with the file, "" while nothing is
    """

    def __init__(
        self,
        reader: RecordingReader,
        *,
        make_pipeline: Callable[[], Pipeline],
        checkpoints: Checkpoints | None = None,
    ) -> None:
        self.checkpoints = checkpoints or Checkpoints()
        self.known_ns = 0
        self.done = False
        self.says = ""
        self._replaying = Replaying(reader, make_pipeline=make_pipeline)
        self._size_bytes = reader.size_bytes()
        self._overview = OverviewSoFar()
        self._lock = threading.Lock()
        self._last_ns = reader.last_ns()
        self._first_ns: int | None = None
        self.checkpoints.keep(self._replaying.checkpoint())

    @property
    def length_ns(self) -> int:
        """Recorded time from the first drain to the last, guessed by the file's length until it is known."""
        if self.done:
            return self.known_ns
        if self._last_ns is not None and self._first_ns is not None:
            return max(self.known_ns, self._last_ns - self._first_ns)
        come = self._replaying.reader.position.byte
        return max(self.known_ns, round(self.known_ns * (self._size_bytes / come)))

    def overview(self) -> Overview:
        """The recording as far as it is known."""
        with self._lock:
            return self._overview.overview()

    def before(self, at_ns: int) -> Checkpoint:
        """The last checkpoint that is not after `at_ns`."""
        return self.checkpoints.before(at_ns)

    def run(self, stopped: Callable[[], bool]) -> None:
        """Go through all of it."""
        while not stopped() and self.step():
            pass

    def step(self) -> bool:
        """Go on by a few drains. False once all is done."""
        if self.done:
            return False
        try:
            more = self._take(TOGETHER)
        except ImuError as error:
            # A later header of a chip that is not known, a disk that cannot be read on: what came before is there.
            self.says, more = str(error), False
        if not more:
            self.says = self.says or self._damage()
            self.done = True
        return more

    def _take(self, most: int) -> bool:
        replaying, blocks = self._replaying, list[RawBlock]()
        more = True
        while len(blocks) < most and replaying.at_ns - self.known_ns < NS_PER_S:
            raw = replaying.read()
            if raw is None:
                more = False
                break
            blocks.append(raw)
            if len(raw):
                with self._lock:
                    self._overview.see_raw(raw, since_ns=replaying.since_ns)
        attitude = replaying.process(blocks)
        if attitude is not None:
            with self._lock:
                self._overview.see(attitude, since_ns=replaying.since_ns)
        if self._first_ns is None and replaying.source.last_drain is not None:
            self._first_ns = replaying.since_ns
        if replaying.at_ns >= self.checkpoints.wanted_ns:
            self.checkpoints.keep(replaying.checkpoint())
        self.known_ns = replaying.at_ns
        return more

    def _damage(self) -> str:
        try:
            self._replaying.reader.check()
        except ImuError as error:
            return str(error)
        return ""
