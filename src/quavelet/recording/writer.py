"""Writing a recording: one file, from the first stream's header to `close`."""

from __future__ import annotations

from collections.abc import Callable
from importlib.metadata import version
from pathlib import Path
from types import TracebackType
from typing import Self, cast

import msgspec

from quavelet.core.clock import Clock, MonotonicClock
from quavelet.core.errors import RecordingError
from quavelet.core.units import NS_PER_S
from quavelet.core.wall_clock import Instant, OffsetNs, offset_from
from quavelet.mpu6050.drain import Drain
from quavelet.mpu6050.stream import StreamInfo
from quavelet.recording.disk_file import DiskFile, Room
from quavelet.recording.format import (
    FRAME_OVERHEAD_BYTES,
    MAGIC,
    Header,
    Kind,
    checksum,
    drain_bytes,
    pack_drain,
    pack_header,
    pack_record,
)
from quavelet.settings import Settings

FLUSH_NS = NS_PER_S
"""Drain time after which all is handed to the operating system: what a kill may cost."""
BUFFER_BYTES = 1 << 16
END_BYTES = FRAME_OVERHEAD_BYTES
"""What `close` adds."""


class RecordingWriter:
    """Writes streams and their drains to `path`; a context manager, and a sink for both in one queue.

    The file is made at once, so that a path that cannot be written is known before the first sample. A file
    that exists is refused unless `overwrite`. `clock` is the one the drains are timed by. Every method raises
    RecordingError where the file cannot be written; it is closed then, and what it holds can be read.

    `calibration` is asked, when a stream begins, for the text of the calibration's file that is in use.

    A killed process loses a second of drains at most. A loss of power also loses what the operating system has
    not yet put on the disk: the drains of `fsync_s` seconds, after which the disk is waited for, or of about 30 s
    by Linux's defaults where it is 0. The header is on the disk before the first drain, and `close` waits too.

    `room` is asked before anything is written; with it the file is locked (flock) while it is written.
    waiting  drains taken that were not handed to the operating system yet
    """

    def __init__(
        self,
        path: str | Path,
        *,
        settings: Settings,
        overwrite: bool = False,
        clock: Clock | None = None,
        fsync_s: float = 0.0,
        room: Room | None = None,
        offset_ns: OffsetNs | None = None,
    ) -> None:
        self.path = Path(path)
        self.waiting = 0
        self._fsync_ns = round(fsync_s * NS_PER_S)
        self._synced_ns: int | None = None
        self._settings = settings
        self.calibration: Callable[[], str] = str
        self._clock = clock or MonotonicClock()
        self._offset_ns = offset_ns or offset_from(self._clock)
        self._stream_crc = 0
        self._begun = False
        self._flushed_ns: int | None = None
        self._file = DiskFile(self.path, first=MAGIC, overwrite=overwrite, room=room)

    def size_with(self, drain: Drain) -> int:
        """How long the file is with this drain in it too, and closed."""
        return self._file.size_bytes + drain_bytes(drain) + END_BYTES

    def begin(self, info: StreamInfo, at: Instant | None = None) -> None:
        """Begin a stream: the first, or another after the chip was restarted; `at` that instant, by itself now."""
        self._file.must_be_open()
        at = at or Instant(offset_ns=self._offset_ns(), t_ns=self._clock.now_ns())
        header = Header(
            stream=info,
            settings=cast(dict[str, object], msgspec.to_builtins(self._settings)),
            started_utc=at.utc.isoformat(),
            started_ns=at.t_ns,
            version=version("quavelet"),
            calibration=self.calibration(),
        )
        payload = pack_header(header)
        self._stream_crc = checksum(Kind.HEADER, payload, stream_crc=0)
        self._file.append(2 * pack_record(Kind.HEADER, payload, crc=self._stream_crc))
        self._flushed_ns = None
        self._flush()
        if not self._begun and self._fsync_ns:
            self._file.sync()
            self._file.sync_folder()
        self._begun = True

    def write(self, item: StreamInfo | Drain) -> None:
        """Write a drain of the stream begun last, or begin another stream."""
        if isinstance(item, StreamInfo):
            self.begin(item)
            return
        self._file.must_be_open()
        if not self._begun:
            raise RecordingError(f"{self.path}: a drain came before any stream: write the StreamInfo first")
        self._append(*pack_drain(item))
        self.waiting += 1
        if self._flushed_ns is None:
            self._flushed_ns = item.after_ns
        if self._synced_ns is None:
            self._synced_ns = item.after_ns
        # Time that goes back is another clock's: flush, and count from there.
        if not 0 <= item.after_ns - self._flushed_ns < FLUSH_NS or self._file.waiting_bytes >= BUFFER_BYTES:
            self._flush()
            self._flushed_ns = item.after_ns
            if self._fsync_ns and not 0 <= item.after_ns - self._synced_ns < self._fsync_ns:
                self._file.sync()
                self._synced_ns = item.after_ns

    def close(self) -> None:
        """Mark the end, and wait until all is on the disk. May be called twice."""
        if self._file.closed:
            return
        self._append(Kind.END, b"")
        self._flush()
        self._file.sync()
        self._file.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None, /
    ) -> None:
        self.close()

    def _append(self, kind: Kind, payload: bytes) -> None:
        self._file.append(pack_record(kind, payload, crc=checksum(kind, payload, stream_crc=self._stream_crc)))

    def _flush(self) -> None:
        self._file.flush()
        self.waiting = 0
