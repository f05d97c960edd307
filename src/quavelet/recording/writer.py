"""Writing a recording: one file, from the first stream's header to `close`."""

from __future__ import annotations

import errno as codes
import fcntl
import os
from collections.abc import Callable
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from types import TracebackType
from typing import Protocol, Self, cast

import msgspec

from quavelet.core.clock import Clock, MonotonicClock
from quavelet.core.errors import RecordingError
from quavelet.core.units import NS_PER_S
from quavelet.mpu6050.drain import Drain
from quavelet.mpu6050.stream import StreamInfo
from quavelet.recording.format import (
    FRAME_OVERHEAD_BYTES,
    MAGIC,
    Header,
    Kind,
    checksum,
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

DISK_FULL = (codes.ENOSPC, codes.EDQUOT)
_ADVICE: dict[int | None, str] = {
    codes.ENOSPC: "make room, or record on another disk",
    codes.EDQUOT: "make room, or record on another disk",
    codes.EFBIG: "the file has the largest size allowed; record to another",
    codes.EACCES: "give a place this user may write to",
    codes.EPERM: "give a place this user may write to",
    codes.EROFS: "give a place this user may write to",
    codes.ENOENT: "make its folder first",
    codes.ENOTDIR: "make its folder first",
    codes.EISDIR: "give the name of a file, not of a folder",
}


class Room(Protocol):
    """Who keeps the disk from filling up."""

    def reserve(self, n: int, /) -> None:
        """Make room for `n` more bytes, which are written next. Raises RecordingError where there is none."""
        ...

    def make_room(self) -> bool:
        """The disk is full: whether something was deleted, so that it may be tried again."""
        ...


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
    drains_waiting  drains taken that were not handed to the operating system yet
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
    ) -> None:
        self.path = Path(path)
        self.drains_waiting = 0
        self._fsync_ns = round(fsync_s * NS_PER_S)
        self._synced_ns: int | None = None
        self._room = room
        self._written_bytes = 0
        self._settings = settings
        self.calibration: Callable[[], str] = str
        self._clock = clock or MonotonicClock()
        self._stream_crc = 0
        self._begun = False
        self._flushed_ns: int | None = None
        self._waiting = bytearray(MAGIC)
        try:
            # Unbuffered: on a full disk a buffered file could not be closed without trying again.
            self._file = self.path.open("wb" if overwrite else "xb", buffering=0)
        except FileExistsError as error:
            raise RecordingError(f"{self.path} exists: give another name, or move it away first") from error
        except OSError as error:
            raise self._error(error) from error
        try:
            if room is not None:
                fcntl.flock(self._file.fileno(), fcntl.LOCK_EX | fcntl.LOCK_NB)
            self._flush()
        except OSError as error:
            self._file.close()
            self.path.unlink(missing_ok=True)
            raise self._error(error) from error
        except RecordingError:
            if not overwrite:
                # Nothing is in it, and the next try would be refused for it.
                self.path.unlink(missing_ok=True)
            raise

    @property
    def size_bytes(self) -> int:
        """How long the file is once all that waits is in it; `close` adds END_BYTES."""
        return self._written_bytes + len(self._waiting)

    def begin(self, info: StreamInfo) -> None:
        """Begin a stream: the first, or another after the chip was restarted."""
        self._must_be_open()
        now_ns = self._clock.now_ns()
        header = Header(
            stream=info,
            settings=cast(dict[str, object], msgspec.to_builtins(self._settings)),
            started_utc=datetime.now(UTC).isoformat(),
            started_ns=now_ns,
            version=version("quavelet"),
            calibration=self.calibration(),
        )
        payload = pack_header(header)
        self._stream_crc = checksum(Kind.HEADER, payload, stream_crc=0)
        self._waiting += 2 * pack_record(Kind.HEADER, payload, crc=self._stream_crc)
        self._flushed_ns = None
        self._flush()
        if not self._begun and self._fsync_ns:
            self._sync()
            self._sync_folder()
        self._begun = True

    def write(self, item: StreamInfo | Drain) -> None:
        """Write a drain of the stream begun last, or begin another stream."""
        if isinstance(item, StreamInfo):
            self.begin(item)
            return
        self._must_be_open()
        if not self._begun:
            raise RecordingError(f"{self.path}: a drain came before any stream: write the StreamInfo first")
        self._append(*pack_drain(item))
        self.drains_waiting += 1
        if self._flushed_ns is None:
            self._flushed_ns = item.after_ns
        if self._synced_ns is None:
            self._synced_ns = item.after_ns
        # Time that goes back is another clock's: flush, and count from there.
        if not 0 <= item.after_ns - self._flushed_ns < FLUSH_NS or len(self._waiting) >= BUFFER_BYTES:
            self._flush()
            self._flushed_ns = item.after_ns
            if self._fsync_ns and not 0 <= item.after_ns - self._synced_ns < self._fsync_ns:
                self._sync()
                self._synced_ns = item.after_ns

    def close(self) -> None:
        """Mark the end, and wait until all is on the disk. May be called twice."""
        if self._file.closed:
            return
        self._append(Kind.END, b"")
        self._flush()
        self._sync()
        self._file.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None, /
    ) -> None:
        self.close()

    def _append(self, kind: Kind, payload: bytes) -> None:
        self._waiting += pack_record(kind, payload, crc=checksum(kind, payload, stream_crc=self._stream_crc))

    def _flush(self) -> None:
        """Hand all to the operating system; a disk that fills up takes the first part, then raises."""
        try:
            if self._room is not None:
                self._room.reserve(len(self._waiting))
            while self._waiting:
                self._write_some()
            if os.fstat(self._file.fileno()).st_nlink == 0:
                raise RecordingError(f"{self.path} was deleted while it was written: record to another")
        except OSError as error:
            self._file.close()
            raise self._error(error) from error
        except RecordingError:
            self._file.close()
            raise
        self.drains_waiting = 0

    def _write_some(self) -> None:
        try:
            n = self._file.write(self._waiting)
        except OSError as error:
            if error.errno in DISK_FULL and self._room is not None and self._room.make_room():
                return
            raise
        del self._waiting[:n]
        self._written_bytes += n

    def _sync(self) -> None:
        """Wait until the disk has all that was handed over."""
        try:
            os.fsync(self._file.fileno())
        except OSError as error:
            self._file.close()
            raise self._error(error) from error

    def _sync_folder(self) -> None:
        """Wait until the disk has the file's name too, without which a new file is lost with the power."""
        try:
            folder = os.open(self.path.parent, os.O_RDONLY | os.O_DIRECTORY)
        except OSError as error:
            self._file.close()
            raise self._error(error) from error
        try:
            os.fsync(folder)
        except OSError as error:
            # Some file systems know no such thing.
            if error.errno != codes.EINVAL:
                self._file.close()
                raise self._error(error) from error
        finally:
            os.close(folder)

    def _must_be_open(self) -> None:
        if self._file.closed:
            raise RecordingError(f"{self.path} is closed: record to a new file")

    def _error(self, error: OSError) -> RecordingError:
        advice = _ADVICE.get(error.errno, "check the disk, or record to another")
        return RecordingError(f"{self.path} cannot be written ({error.strerror}): {advice}")
