"""A chunk of samples made bytes at once, so that a transaction only slices."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from hw_fakes.chip.samples import CountArray, Run, SampleSource
from hw_fakes.chip.setup import Setup

NO_DATA = bytes(14)
_BIG_ENDIAN = np.dtype(np.int16).newbyteorder(">")


class Prefetch:
    """One chunk of samples as bytes, ready to be sliced; a change of configuration throws it away."""

    def __init__(self, source: SampleSource) -> None:
        self._source = source
        self._chunk = -1
        self._bytes = b""
        self._frames = b""
        self.held = NO_DATA  # what axes in standby go on showing
        self.spoil: Callable[[CountArray], CountArray] | None = None

    def clear(self) -> None:
        self._chunk = -1

    def sample(self, run: Run, setup: Setup, n: int) -> bytes:
        """The 14 sensor bytes of sample n of the run."""
        chunk, row = divmod(n, run.chunk)
        self._fetch(run, setup, chunk)
        sample = self._bytes[14 * row : 14 * row + 14]
        return self._spoilt(sample, range(7)) if self.spoil else sample

    def frames(self, run: Run, setup: Setup, first: int, end: int) -> bytes:
        """The FIFO's frames of samples `first` up to `end` of the run."""
        size = 2 * len(setup.fifo_words)
        out = b""
        while first < end:
            chunk, row = divmod(first, run.chunk)
            self._fetch(run, setup, chunk)
            rows = min(end - first, run.chunk - row)
            if self.spoil:
                out += self._spoilt(self._bytes[14 * row : 14 * (row + rows)], setup.fifo_words)
            else:
                out += self._frames[row * size : (row + rows) * size]
            first += rows
        return out

    def _spoilt(self, samples: bytes, words: Sequence[int]) -> bytes:
        assert self.spoil is not None
        whole = np.frombuffer(samples, dtype=_BIG_ENDIAN).astype(np.int16).reshape(-1, 7)
        return self.spoil(whole)[:, words].astype(_BIG_ENDIAN).tobytes()

    def _fetch(self, run: Run, setup: Setup, chunk: int) -> None:
        if chunk == self._chunk:
            return
        words = self._source.words(run, setup, chunk)
        for word in setup.frozen:
            words[:, word] = int.from_bytes(self.held[2 * word : 2 * word + 2], "big", signed=True)
        self._chunk = chunk
        self._bytes = words.astype(_BIG_ENDIAN).tobytes()
        self._frames = words[:, setup.fifo_words].astype(_BIG_ENDIAN).tobytes()
