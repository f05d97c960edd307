"""What the tests of the player share: recordings of several kinds, their straight replay, and a player of them."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field, replace
from pathlib import Path

from recorded import PERIOD_NS, Live, record, record_fake

from quavelet.bus.protocol import Edge
from quavelet.core.blocks import AttitudeBlock
from quavelet.core.clock import VirtualClock
from quavelet.core.health import Health
from quavelet.core.units import NS_PER_S
from quavelet.mpu6050.drain import Drain
from quavelet.mpu6050.stream import StreamInfo
from quavelet.pipeline import Pipeline, build_pipeline
from quavelet.recording.checkpoint import Checkpoints
from quavelet.recording.player import Played, Player
from quavelet.recording.reader import RecordingReader
from quavelet.recording.replay import ReplaySource
from quavelet.settings import Settings, parse_settings
from quavelet.sinks.message import Message, message_of

PLAIN = parse_settings({"bus": {"name": "fake:turntable"}}, where="test")
DENOISED = parse_settings({"bus": {"name": "fake:turntable"}, "denoise": {"kind": "wavelet"}}, where="test")
SECONDS = 12
LEAD_NS = 2 * NS_PER_S


def shifted(items: Iterable[StreamInfo | Drain], by_ns: int, **other: int) -> list[StreamInfo | Drain]:
    """The same later, of a chip whose registers stand otherwise."""
    return [
        replace(
            item,
            before_ns=item.before_ns + by_ns,
            after_ns=item.after_ns + by_ns,
            edges=tuple(Edge(t_ns=edge.t_ns + by_ns, seq=edge.seq) for edge in item.edges),
        )
        if isinstance(item, Drain)
        else replace(item, **other)
        for item in items
    ]


def gap_of_2_s(path: Path) -> Live:
    return record_fake(path, n=100 * SECONDS, stall_at=600, stall_ns=2 * NS_PER_S)


def steady(path: Path) -> Live:
    return record_fake(path, n=100 * SECONDS)


def with_line(path: Path) -> Live:
    return record_fake(path, n=100 * SECONDS, int_line="fake:int", fault="int-lost at=5 for=1")


def damaged(path: Path) -> Live:
    live = steady(path)
    data = bytearray(path.read_bytes())
    for part in (0.3, 0.31, 0.8):
        data[int(len(data) * part)] ^= 0x10
    path.write_bytes(data)
    return live


def cut(path: Path) -> Live:
    live = steady(path)
    path.write_bytes(path.read_bytes()[: -path.stat().st_size // 5])
    return live


def two_streams(path: Path) -> Live:
    """The chip comes back after 3 s with other ranges; then once more, the host having been started again."""
    live = record_fake(path, n=100 * SECONDS // 3)
    later = shifted(live.items, 100 * SECONDS // 3 * PERIOD_NS + 3 * NS_PER_S, gyro_config=24)
    record(path, [*live.items, *later, *live.items])
    return live


KINDS: dict[str, Callable[[Path], Live]] = {
    "steady": steady,
    "a gap": gap_of_2_s,
    "a line": with_line,
    "damaged": damaged,
    "cut": cut,
    "two streams": two_streams,
}


def maker(settings: Settings) -> Callable[[], Pipeline]:
    return lambda: build_pipeline(settings)


def straight(path: Path, settings: Settings) -> list[AttitudeBlock]:
    """What a replay from end to end gives, a block a drain."""
    source = ReplaySource(RecordingReader(path), health=Health())
    pipeline, blocks = build_pipeline(settings), list[AttitudeBlock]()
    while (raw := source.read()) is not None:
        if len(block := pipeline.process(raw)):
            blocks.append(block)
    return blocks


def messages_of(blocks: Iterable[AttitudeBlock]) -> list[Message]:
    return [message_of(block, src="replay:fake:turntable") for block in blocks]


@dataclass
class Playing:
    """A player on virtual time that is driven step by step; `given` is what it gave."""

    path: Path
    settings: Settings = PLAIN
    checkpoints: Checkpoints = field(default_factory=lambda: Checkpoints(step_ns=2 * NS_PER_S))
    known: bool = True
    clock: VirtualClock = field(default_factory=VirtualClock)
    given: list[Played] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.player = Player(
            self.path,
            make_pipeline=maker(self.settings),
            clock=self.clock,
            give=self.given.append,
            checkpoints=self.checkpoints,
            lead_ns=LEAD_NS,
        )
        while self.known and self.player.first_pass.step():
            pass

    def arrive(self) -> None:
        """Until what was sought has come."""
        for _ in range(10):
            self.player.step()
            if self.player.state().wanted_s is None:
                return
        raise AssertionError("it never arrives")

    def play(self, seconds: float) -> None:
        """So long by its clock."""
        end_ns = self.clock.now_ns() + round(seconds * NS_PER_S)
        while self.clock.now_ns() < end_ns:
            before_ns = self.clock.now_ns()
            self.player.step()
            if self.clock.now_ns() == before_ns and not self.given and self.player.state().ended:
                return

    def to_the_end(self) -> None:
        while not self.player.state().ended:
            self.player.step()
