"""A recorder whose clock may be stepped, drains for it, and what its files then hold."""

from collections.abc import Callable
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path

from recorded import INFO, SETTINGS, drains

from quavelet.core.clock import VirtualClock
from quavelet.core.units import NS_PER_S
from quavelet.core.wall_clock import unix_ns_of
from quavelet.mpu6050.drain import Drain
from quavelet.mpu6050.stream import StreamInfo
from quavelet.recording.format import MAGIC
from quavelet.recording.reader import RecordingReader
from quavelet.recording.recorder import RotatingRecorder
from quavelet.recording.rotation import Bounds
from quavelet.recording.writer import FLUSH_NS

HOUR_NS = 3600 * NS_PER_S
NOON = datetime(2026, 11, 22, 12, tzinfo=UTC)
SMALL = Bounds(file_bytes=12_000, file_ns=HOUR_NS, total_bytes=40_000)
WIDE = replace(SMALL, total_bytes=10_000_000)
OTHERS = {
    "notes.txt": b"mine",
    "imu-000007-20250101T000000Z.qrec": b"not a recording, though it is called so",
    "other-000001-20261122T120000Z.qrec": MAGIC + bytes(5000),
    "imu-000007-20250101T000000Z.qrec.bak": MAGIC,
    "imu-1-20261122T120000Z.qrec": MAGIC,
    "holiday.qrec": MAGIC + bytes(50),
}


class Rig:
    """A recorder, what it told, and a clock of UTC that may be stepped."""

    def __init__(self, folder: Path, bounds: Bounds, *, fsync_s: float = 0.0) -> None:
        self.folder, self.told, self.utc = folder, list[str](), NOON
        self.recorder = RotatingRecorder(
            folder,
            name="imu",
            bounds=bounds,
            settings=SETTINGS,
            clock=VirtualClock(),
            tell=self.told.append,
            offset_ns=lambda: unix_ns_of(self.utc),
            fsync_s=fsync_s,
        )

    @property
    def files(self) -> list[Path]:
        return [path for path in sorted(self.folder.glob("imu-??????-*Z.qrec")) if path.name not in OTHERS]

    @property
    def total(self) -> int:
        return sum(path.stat().st_size for path in self.files)

    def write(self, *items: StreamInfo | Drain) -> None:
        for item in items:
            self.recorder.write(item)

    def close(self) -> None:
        self.recorder.close()


MakeRig = Callable[..., Rig]


def slow_drains(n: int, *, first: int = 0, every_ns: int = FLUSH_NS) -> list[Drain]:
    """So far apart that each is in the file at once."""
    return [
        replace(drain, before_ns=drain.seq * every_ns, after_ns=drain.seq * every_ns + 1)
        for drain in drains(n, first=first, frames=20)
    ]


def drains_in(paths: list[Path]) -> list[Drain]:
    items = []
    for path in paths:
        reader = RecordingReader(path)
        info, *rest = reader
        reader.check()
        assert info == INFO
        assert rest
        items += [item for item in rest if isinstance(item, Drain)]
    return items
