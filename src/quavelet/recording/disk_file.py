"""A new file on a disk that may fill up, be taken away or lose its power: what recordings are written to."""

from __future__ import annotations

import errno as codes
import fcntl
import os
from pathlib import Path
from typing import Protocol

from quavelet.core.errors import RecordingError

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


class DiskFile:
    """A file that is made at once, with `first` in it. One that exists is refused unless `overwrite`.

    Every method but `close` raises RecordingError where it cannot be written; it is closed then, and what it holds
    can be read. `room` is asked before anything is written; with it the file is locked (flock) until it is closed.
    """

    def __init__(self, path: Path, *, first: bytes = b"", overwrite: bool = False, room: Room | None = None) -> None:
        self.path = path
        self._room = room
        self._written_bytes = 0
        self._waiting = bytearray(first)
        try:
            # Unbuffered: on a full disk a buffered file could not be closed without trying again.
            self._file = path.open("wb" if overwrite else "xb", buffering=0)
        except FileExistsError as error:
            raise RecordingError(f"{path} exists: give another name, or move it away first") from error
        except OSError as error:
            raise self._error(error) from error
        try:
            if room is not None:
                fcntl.flock(self._file.fileno(), fcntl.LOCK_EX | fcntl.LOCK_NB)
            self.flush()
        except OSError as error:
            self._file.close()
            path.unlink(missing_ok=True)
            raise self._error(error) from error
        except RecordingError:
            if not overwrite:
                # Nothing is in it, and the next try would be refused for it.
                path.unlink(missing_ok=True)
            raise

    @property
    def closed(self) -> bool:
        return self._file.closed

    @property
    def waiting_bytes(self) -> int:
        """Bytes that were not handed to the operating system yet."""
        return len(self._waiting)

    @property
    def size_bytes(self) -> int:
        """How long the file is once all that waits is in it."""
        return self._written_bytes + len(self._waiting)

    def append(self, data: bytes) -> None:
        """Have it wait for the next `flush`."""
        self._waiting += data

    def flush(self) -> None:
        """Hand all to the operating system; a disk that fills up takes the first part, then raises."""
        self.must_be_open()
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

    def sync(self) -> None:
        """Wait until the disk has all that was handed over."""
        try:
            os.fsync(self._file.fileno())
        except OSError as error:
            self._file.close()
            raise self._error(error) from error

    def sync_folder(self) -> None:
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

    def close(self) -> None:
        """What still waits is not written. May be called twice."""
        self._file.close()

    def must_be_open(self) -> None:
        """Raises RecordingError where it is closed."""
        if self._file.closed:
            raise RecordingError(f"{self.path} is closed: record to a new file")

    def _write_some(self) -> None:
        try:
            n = self._file.write(self._waiting)
        except OSError as error:
            if error.errno in DISK_FULL and self._room is not None and self._room.make_room():
                return
            raise
        del self._waiting[:n]
        self._written_bytes += n

    def _error(self, error: OSError) -> RecordingError:
        advice = _ADVICE.get(error.errno, "check the disk, or record to another")
        return RecordingError(f"{self.path} cannot be written ({error.strerror}): {advice}")
