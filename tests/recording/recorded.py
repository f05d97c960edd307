"""What the tests of this folder share: hand-made drains, recordings of them, and of the fake chip."""

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from hypothesis import strategies as st

from hw_fakes import FakeBus
from hw_fakes.faults.plan import parse
from quavelet.bus.open import open_bus, open_line
from quavelet.bus.protocol import Edge
from quavelet.core.blocks import Block, RawBlock, array_fields
from quavelet.core.clock import VirtualClock
from quavelet.core.health import Health
from quavelet.core.units import NS_PER_MS
from quavelet.mpu6050.drain import Drain, Loss
from quavelet.mpu6050.source import ChipSource
from quavelet.mpu6050.stream import StreamInfo
from quavelet.recording.format import MAGIC
from quavelet.recording.writer import RecordingWriter
from quavelet.settings import Settings, parse_settings

INFO = StreamInfo(src="fake:hand", address=0x68, who_am_i=0x68, config=3, gyro_config=8, accel_config=8, smplrt_div=4)
SETTINGS = Settings()
PERIOD_NS = 10 * NS_PER_MS

TIMES_NS = st.integers(-(2**63), 2**63 - 1)
EDGES = st.lists(st.builds(Edge, t_ns=TIMES_NS, seq=st.integers(0, 2**64 - 1)), max_size=30).map(tuple)
ANY_DRAIN = st.builds(
    Drain,
    seq=st.integers(0, 2**64 - 1),
    before_ns=TIMES_NS,
    after_ns=TIMES_NS,
    int_status=st.integers(0, 255),
    fifo_count=st.integers(0, 65535),
    data=st.binary(max_size=1024),
    loss=st.sampled_from(Loss),
    edges=st.just(()) | EDGES,
)
STREAM_INFO = st.builds(
    StreamInfo,
    src=st.text(max_size=20),
    address=st.integers(0x08, 0x77),
    who_am_i=st.just(0x68),
    config=st.integers(0, 255),
    gyro_config=st.integers(0, 255),
    accel_config=st.integers(0, 255),
    smplrt_div=st.integers(0, 255),
)


def drains(n: int, *, first: int = 0, frames: int = 2) -> list[Drain]:
    """`n` drains, 10 ms apart, of frames whose bytes differ from drain to drain."""
    return [
        Drain(
            seq=seq,
            before_ns=seq * PERIOD_NS,
            after_ns=seq * PERIOD_NS + 100_000,
            int_status=0,
            fifo_count=14 * frames,
            data=bytes((seq * 31 + i) % 256 for i in range(14 * frames)),
        )
        for seq in range(first, first + n)
    ]


def record(path: Path, items: Iterable[StreamInfo | Drain]) -> Path:
    """A closed recording of `items`."""
    with RecordingWriter(path, settings=SETTINGS, overwrite=True) as writer:
        for item in items:
            writer.write(item)
    return path


def first_drain_byte(recording: bytes) -> int:
    """Where the first stream's drains begin: behind both copies of its header."""
    length = int.from_bytes(recording[len(MAGIC) + 5 : len(MAGIC) + 9], "little")
    return len(MAGIC) + 2 * (13 + length)


@dataclass
class Live:
    """A run on the fake: what was recorded, what came out, what was counted, and the drains."""

    path: Path
    settings: Settings
    blocks: list[RawBlock]
    health: Health
    items: list[StreamInfo | Drain]


def record_fake(
    path: Path, *, n: int, stall_at: int | None = None, stall_ns: int = 0, int_line: str = "", fault: str = ""
) -> Live:
    """`n` drains of the fake turntable at 200 Hz, 10 ms apart but for one stall before drain `stall_at`; `fault` is of
    `hw_fakes.faults.plan`."""
    settings = parse_settings({"bus": {"name": "fake:turntable", "int_line": int_line}}, where="test")
    clock, health, items = VirtualClock(), Health(), list[StreamInfo | Drain]()
    blocks = []
    with open_bus(settings.bus.name, clock=clock) as bus, RecordingWriter(path, settings=settings, clock=clock) as file:

        def keep(item: StreamInfo | Drain) -> None:
            items.append(item)
            file.write(item)

        if fault:
            assert isinstance(bus, FakeBus)
            bus.adapter.faults.add(parse(fault))
        line = open_line(int_line, bus=bus, address=0x68)
        source = ChipSource(
            bus,
            address=0x68,
            config=settings.chip,
            clock=clock,
            health=health,
            line=line,
            on_stream=keep,
            on_drain=keep,
        )
        source.wait_until_streaming()
        for i in range(n):
            clock.advance_ns(stall_ns if i == stall_at else PERIOD_NS)
            blocks.append(source.read())
    return Live(path, settings, blocks, health, items)


def assert_identical(a: Block, b: Block) -> None:
    """Every array the same to the bit, and of the same type."""
    assert type(a) is type(b)
    for name in array_fields(type(a)):
        x, y = getattr(a, name), getattr(b, name)
        assert x.dtype == y.dtype, name
        assert x.shape == y.shape, name
        assert np.ascontiguousarray(x).tobytes() == np.ascontiguousarray(y).tobytes(), name
