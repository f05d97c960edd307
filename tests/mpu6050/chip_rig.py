"""What the tests of this folder share: a source on a fake chip whose frames name their own sample, and bus faults."""

from __future__ import annotations

import errno
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hw_fakes import FakeBus, FakeDataReady, FakeMpu6050
from hw_fakes.chip.samples import Run
from hw_fakes.chip.setup import Setup
from quavelet.bus.faults import bus_error
from quavelet.core.blocks import Flag, RawBlock, concat
from quavelet.core.clock import VirtualClock
from quavelet.core.health import Health
from quavelet.core.units import NS_PER_MS, NS_PER_S
from quavelet.mpu6050.config import ChipConfig
from quavelet.mpu6050.source import ChipSource

ADDRESS = 0x68


def config(rate_hz: float = 200.0, *, dlpf: int = 3, gyro: int = 500, accel: int = 4) -> ChipConfig:
    return ChipConfig(gyro_range_dps=gyro, accel_range_g=accel, dlpf=dlpf, sample_rate_hz=rate_hz)


class NumberedSamples:
    """A `SampleSource` whose frame number m says m in all of its seven words, and in no other frame's way.

    A chip that was reset counts on as if it had gone on sampling meanwhile.
    """

    def __init__(self) -> None:
        self.run: Run | None = None
        self.first: Run | None = None

    def words(self, run: Run, _setup: Setup, chunk: int, /) -> NDArray[np.int16]:
        self.run = run
        self.first = self.first or run
        return numbered(self.begun(run) + np.arange(chunk * run.chunk, (chunk + 1) * run.chunk))

    def begun(self, run: Run) -> int:
        """The number of the first sample of a run."""
        assert self.first is not None
        return -(-(run.start_ns - self.first.start_ns) // round(run.period_ns))

    def limit(self, _run: Run, /) -> int | None:
        return None

    def fifo_begins(self, _run: Run, _sample: int, /) -> None:
        return

    def forget(self) -> None:
        return

    def true_ns(self, numbers: NDArray[np.int64]) -> NDArray[np.float64]:
        """When the chip took these samples."""
        assert self.run is not None
        return self.run.start_ns + (numbers - self.begun(self.run) + 1) * self.run.period_ns


_MIX = ((104_729, 5), (1299_709, 77), (15_485_863, 1), (32_452_843, 400))


def numbered(m: NDArray[np.int64]) -> NDArray[np.int16]:
    low, high, *mixed = [m % 30_000, m // 30_000, *((m * k + c) % 60_001 - 30_000 for k, c in _MIX)]
    # The temperature of a real chip does not jump, and the driver does not believe one that does.
    words = [low, high, mixed[0], (m * 7919) % 300, *mixed[1:4]]
    return np.stack(words, 1).astype(np.int16)


def numbers_of(counts: NDArray[np.int16]) -> NDArray[np.int64]:
    """Which samples these frames are. Fails where one is not a frame the chip has put in."""
    m = counts[:, 0].astype(np.int64) + 30_000 * counts[:, 1].astype(np.int64)
    assert np.array_equal(numbered(m), counts), "a frame the chip never put in"
    return m


@dataclass(frozen=True)
class Transfer:
    """One transaction as it went over the bus: what was written after the register, or how much was read."""

    at_ns: int
    register: int
    written: bytes
    n: int

    @property
    def is_read(self) -> bool:
        return self.n > 0


class WatchedBus:
    """A bus that keeps a list of its transfers and can spoil some.

    spoil(k, transfer)   called with the number of the transfer; True makes it fail
    errno                what it fails with
    late                 a spoilt transfer reaches the chip and only its answer is lost
    alter(k, transfer, answer)   the answer as the driver gets it
    """

    def __init__(self, inner: FakeBus) -> None:
        self.inner = inner
        self.trace: list[Transfer] = []
        self.spoil: Callable[[int, Transfer], bool] = lambda _k, _transfer: False
        self.errno = errno.EIO
        self.late = False
        self.alter: Callable[[int, Transfer, bytes], bytes] = lambda _k, _transfer, answer: answer

    @property
    def name(self) -> str:
        return self.inner.name

    def write(self, address: int, data: bytes) -> None:
        self._transfer(address, data, 0)

    def write_read(self, address: int, data: bytes, n: int) -> bytes:
        return self._transfer(address, data, n)

    def close(self) -> None:
        self.inner.close()

    def __enter__(self) -> WatchedBus:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _transfer(self, address: int, data: bytes, n: int) -> bytes:
        k, transfer = len(self.trace), Transfer(self.inner.clock.now_ns(), data[0], data[1:], n)
        self.trace.append(transfer)
        spoilt = self.spoil(k, transfer)
        answer = b""
        if self.late or not spoilt:
            if n:
                answer = self.inner.write_read(address, data, n)
            else:
                self.inner.write(address, data)
        if spoilt:
            raise bus_error(self.errno, bus=self.name, address=address, register=data[0])
        return self.alter(k, transfer, answer)


class Rig:
    """A chip, the bus to it, and a source that drains it; `wired` with its INT pin at a line."""

    def __init__(
        self,
        chip_config: ChipConfig | None = None,
        *,
        chip_type: type[FakeMpu6050] = FakeMpu6050,
        speed_hz: int = 400_000,
        wired: bool = False,
        **chip_arguments: Any,
    ) -> None:
        self.clock = VirtualClock(5 * NS_PER_S)
        self.samples = NumberedSamples()
        if "motion" not in chip_arguments:
            chip_arguments.setdefault("source", self.samples)
        self.chip = chip_type(self.clock, **chip_arguments)
        self.fake_bus = FakeBus({ADDRESS: self.chip}, clock=self.clock, name="fake:rig", speed_hz=speed_hz)
        self.bus = WatchedBus(self.fake_bus)
        self.line = FakeDataReady(self.chip, clock=self.clock) if wired else None
        self.health = Health()
        self.config = chip_config or config()
        self.source = self.new_source()
        self.blocks: list[RawBlock] = []

    def new_source(self) -> ChipSource:
        return ChipSource(
            self.bus, address=ADDRESS, config=self.config, clock=self.clock, health=self.health, line=self.line
        )

    def start(self) -> Rig:
        self.source.wait_until_streaming()
        return self

    def wait_ms(self, ms: float) -> None:
        self.clock.advance_ns(round(ms * NS_PER_MS))

    def drain(self, after_ms: float = 0.0) -> RawBlock:
        self.wait_ms(after_ms)
        block = self.source.read()
        self.blocks.append(block)
        return block

    def run(self, seconds: float, *, every_ms: float = 10.0) -> None:
        """Drain at fixed deadlines."""
        first_ns = self.clock.now_ns()
        for k in range(1, round(seconds * 1e3 / every_ms) + 1):
            self.clock.sleep_until_ns(first_ns + round(k * every_ms * NS_PER_MS))
            self.drain()

    @property
    def got(self) -> RawBlock:
        """All samples so far."""
        return concat(self.blocks)

    @property
    def numbers(self) -> NDArray[np.int64]:
        """The chip's numbers of all samples so far."""
        return numbers_of(self.got.counts)

    def taken_now(self) -> int:
        """Samples the chip has taken in this run up to this moment."""
        run = self.samples.run
        assert run is not None
        return self.samples.begun(run) + run.samples_by(self.clock.now_ns())

    def wr(self, register: int, value: int) -> None:
        """A write behind the driver's back."""
        self.fake_bus.write(ADDRESS, bytes([register, value]))


def check_honest(rig: Rig) -> NDArray[np.int64]:
    """Every frame is one the chip put in, in order, and each missing one is told of. Gives their numbers."""
    got, numbers = rig.got, rig.numbers
    steps = np.diff(numbers)
    assert (steps >= 1).all(), "a frame was given twice"
    unsaid = (steps > 1) & (got.flags[1:] & Flag.GAP == 0)
    assert not unsaid.any(), f"samples are missing without a flag after {numbers[:-1][unsaid][:5]}"
    assert (np.diff(got.t_ns) > 0).all(), "time does not go forward"
    return numbers


class StubbornChip(FakeMpu6050):
    """A chip that takes a byte otherwise than it is written: `stubborn(register, byte)`, None to lose it."""

    stubborn: Callable[[int, int], int | None] = staticmethod(lambda _register, byte: byte)

    def _store(self, register: int, value: int) -> None:
        taken = self.stubborn(register, value)
        if taken is None:
            self.written.append((register, value))
        else:
            super()._store(register, taken)
