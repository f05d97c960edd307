"""A wire from a fake chip's INT pin to a GPIO that does not exist."""

from __future__ import annotations

import errno
from collections import deque

from hw_fakes.chip.mpu6050 import FakeMpu6050
from quavelet.bus.protocol import Edge
from quavelet.core.clock import Clock
from quavelet.core.closing import Closing
from quavelet.core.errors import BusError
from quavelet.core.units import NS_PER_S

STEP_NS = 100_000
QUEUE = 1024


class FakeDataReady(Closing):
    """The rising edges of a chip's INT pin; implements `quavelet.bus.protocol.DataReady`.

    Their times are exact; who waits is woken up to 0.1 ms after one. Edges nobody asks for are lost as in the kernel:
    the oldest of more than 1024.
    """

    def __init__(self, chip: FakeMpu6050, *, clock: Clock, name: str = "fake:int") -> None:
        self.chip = chip
        self._clock = clock
        self._name = name
        self._until_ns = clock.now_ns()
        self._seq = 0
        self._kept: deque[Edge] = deque(maxlen=QUEUE)
        self._closed = False

    @property
    def name(self) -> str:
        return self._name

    def wait(self, timeout_s: float) -> list[Edge]:
        if timeout_s < 0:
            raise ValueError(f"cannot wait {timeout_s:g} s: give 0 or more")
        if self._closed:
            raise BusError(f"the line {self._name} is closed: open it again", errno=errno.EBADF)
        end_ns = self._clock.now_ns() + round(timeout_s * NS_PER_S)
        self._look()
        while not self._kept and (now_ns := self._clock.now_ns()) < end_ns:
            self._clock.sleep_until_ns(min(now_ns + STEP_NS, end_ns))
            self._look()
        edges = list(self._kept)
        self._kept.clear()
        return edges

    def _look(self) -> None:
        since_ns, self._until_ns = self._until_ns + 1, self._clock.now_ns()
        for edge in self.chip.int_edges(since_ns):
            if edge.high and edge.t_ns <= self._until_ns:
                self._seq += 1
                self._kept.append(Edge(edge.t_ns, self._seq))

    def close(self) -> None:
        self._closed = True
