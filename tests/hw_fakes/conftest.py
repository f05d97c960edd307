"""A fake chip on a bus in virtual time, and short words for what one does with it."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from hw_fakes import PERFECT, FakeBus, FakeMpu6050
from quavelet.core.clock import VirtualClock

ALL_WORDS = 0xF8


class Board:
    """One chip at 0x68; registers are given by number so that the tests lean on no table of the fake's."""

    def __init__(self, *, open_bus: Callable[[VirtualClock], FakeBus] | None = None, **chip: Any) -> None:
        self.clock = VirtualClock()
        if open_bus is None:
            chip = {"imperfections": PERFECT, "pll_error": 0.0, "internal_error": 0.0, **chip}
            self.bus = FakeBus({0x68: FakeMpu6050(self.clock, **chip)}, clock=self.clock)
        else:
            self.bus = open_bus(self.clock)

    @property
    def chip(self) -> Any:
        return self.bus.targets[0x68]

    def wr(self, register: int, *values: int) -> None:
        self.bus.write(0x68, bytes([register, *values]))

    def rd(self, register: int, n: int = 1) -> bytes:
        return self.bus.write_read(0x68, bytes([register]), n)

    def byte(self, register: int) -> int:
        return self.rd(register)[0]

    def wait_ms(self, ms: float) -> None:
        self.clock.advance_ns(round(ms * 1e6))

    def wake(self, *, dlpf: int = 1, div: int = 0, gyro: int = 0, accel: int = 0, clksel: int = 1) -> None:
        for register, value in ((0x6B, clksel), (0x19, div), (0x1A, dlpf), (0x1B, gyro), (0x1C, accel)):
            self.wr(register, value)

    def start_fifo(self, mask: int = ALL_WORDS) -> None:
        self.wr(0x6A, 0x04)
        self.wr(0x23, mask)
        self.wr(0x6A, 0x40)

    def fifo_count(self) -> int:
        return int.from_bytes(self.rd(0x72, 2), "big")

    def drain(self, words: int = 7) -> NDArray[np.int16]:
        """All whole frames in the FIFO, (N, words)."""
        n = self.fifo_count() // (2 * words)
        return frames(self.rd(0x74, 2 * words * n), words) if n else np.zeros((0, words), dtype=np.int16)

    def collect(self, seconds: float, *, step_ms: float = 20.0, words: int = 7) -> NDArray[np.int16]:
        """What comes out of the FIFO within `seconds`, drained every `step_ms`."""
        end_ns = self.clock.now_ns() + round(seconds * 1e9)
        parts = []
        while self.clock.now_ns() < end_ns:
            self.wait_ms(step_ms)
            parts.append(self.drain(words))
        return np.concatenate(parts)

    def sensors(self) -> NDArray[np.int16]:
        """The seven words of the sensor registers."""
        return frames(self.rd(0x3B, 14), 7)[0]


def frames(data: bytes, words: int) -> NDArray[np.int16]:
    return np.frombuffer(data, dtype=">i2").astype(np.int16).reshape(-1, words)


@pytest.fixture
def make_board() -> Callable[..., Board]:
    return Board


@pytest.fixture
def board() -> Board:
    """A perfect chip, powered up, asleep."""
    return Board()
