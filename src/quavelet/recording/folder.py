"""The recordings in a directory: which are ours, how much they take, and the oldest deleted for room."""

from __future__ import annotations

import errno
import fcntl
import os
import re
from collections import deque
from contextlib import suppress
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from stat import S_ISREG

from quavelet.core.errors import RecordingError
from quavelet.recording import mcap
from quavelet.recording.format import MAGIC, SUFFIX

BEGINS = {SUFFIX: MAGIC, mcap.SUFFIX: mcap.MAGIC}
"""How a recording begins, by how its name ends."""

_STAMP = "%Y%m%dT%H%M%SZ"


def names_of(name: str) -> re.Pattern[str]:
    """What the names of a service's recordings are like; the first group is the number."""
    endings = "|".join(map(re.escape, BEGINS))
    return re.compile(rf"{re.escape(name)}-(\d{{6,}})-\d{{8}}T\d{{6}}Z({endings})", re.ASCII)


def delete_ended(path: Path) -> None:
    """Delete a recording that nobody is writing. Raises OSError where it cannot be, BlockingIOError where somebody is,
    FileExistsError where it is something else."""
    # Not waiting: by that name there could be a pipe by this time.
    number = os.open(path, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC)
    try:
        begins = BEGINS[path.suffix]
        if not begins.startswith(os.read(number, len(begins))):
            raise FileExistsError(errno.EEXIST, "it is no recording", str(path))
        fcntl.flock(number, fcntl.LOCK_EX | fcntl.LOCK_NB)
        path.unlink()
    finally:
        os.close(number)


@dataclass(frozen=True, slots=True)
class _Kept:
    number: int
    path: Path
    size: int


class RecordingFolder:
    """The files NAME-NUMBER-TIME.qrec and .mcap of `directory`, which together never take more than `total_bytes`.

    NUMBER goes up by one from file to file, whatever the clock that TIME (UTC) is read from does, so the names
    sort by age. A file is ours where its name is so, it is a plain file and it begins as a recording does (or is
    too short to tell: the power went before its first line was written). No other is counted or deleted, nor
    one that somebody is writing: those are locked (see `RecordingWriter`).

    used_bytes   of ours, by the lengths of the files; the one being written with all that was reserved for it
    deleted      files deleted for room
    """

    def __init__(self, directory: Path, *, name: str, suffix: str, total_bytes: int, keep_free_bytes: int = 0) -> None:
        self.directory = directory
        self.used_bytes = 0
        self.deleted = 0
        self._name = name
        self._suffix = suffix
        self._pattern = names_of(name)
        self._total_bytes = total_bytes
        self._keep_free_bytes = keep_free_bytes
        self._last = 0
        self._kept: deque[_Kept] = deque()
        self._known: dict[Path, bool] = {}

    def next_path(self, begins: datetime) -> Path:
        """Look at the directory afresh and name the next file. No file of ours may be open. Raises RecordingError."""
        self._scan()
        self._last += 1
        return self.directory / f"{self._name}-{self._last:06d}-{begins.strftime(_STAMP)}{self._suffix}"

    def reserve(self, n: int) -> None:
        """Make room for `n` more bytes, deleting the oldest for it. Raises RecordingError where there is none."""
        while self.used_bytes + n > self._total_bytes:
            if not self.make_room():
                raise RecordingError(
                    f"no room for {n} more bytes in {self.directory}: total_mb is used up by files that cannot be "
                    "deleted; delete some, or give it more"
                )
        while self._free_bytes() < n + self._keep_free_bytes:
            if not self.make_room():
                raise RecordingError(
                    f"the disk of {self.directory} has less than keep_free_mb left and there is no older recording "
                    "to delete: make room"
                )
        self.used_bytes += n

    def make_room(self) -> bool:
        """Delete the oldest; whether there was one."""
        while self._kept:
            if self._delete(self._kept.popleft()):
                return True
        return False

    def _scan(self) -> None:
        found: list[_Kept] = []
        known: dict[Path, bool] = {}
        try:
            with os.scandir(self.directory) as entries:
                for entry in entries:
                    match = self._pattern.fullmatch(entry.name)
                    if match is None:
                        continue
                    number, path = int(match[1]), self.directory / entry.name
                    self._last = max(self._last, number)
                    # It may be deleted by somebody between the listing and the look.
                    with suppress(FileNotFoundError):
                        status = entry.stat(follow_symlinks=False)
                        known[path] = S_ISREG(status.st_mode) and (self._known.get(path) or _is_recording(path))
                        if known[path]:
                            found.append(_Kept(number, path, status.st_size))
        except FileNotFoundError as error:
            raise RecordingError(f"there is no directory {self.directory}: make it, or mount its disk") from error
        except OSError as error:
            raise RecordingError(
                f"{self.directory} cannot be looked at ({error.strerror}): give a directory this user may write to"
            ) from error
        self._known = known
        self._kept = deque(sorted(found, key=lambda file: file.number))
        self.used_bytes = sum(file.size for file in found)

    def _delete(self, file: _Kept) -> bool:
        """Whether it is gone. What cannot be deleted still counts as used, and is tried again after the next scan."""
        try:
            delete_ended(file.path)
        except FileNotFoundError:
            self.used_bytes -= file.size
            return True
        except OSError:
            return False
        self.used_bytes -= file.size
        self.deleted += 1
        return True

    def _free_bytes(self) -> int:
        if not self._keep_free_bytes:
            # A disk without a bound says itself when it is full.
            return self._total_bytes
        try:
            disk = os.statvfs(self.directory)
        except OSError as error:
            raise RecordingError(
                f"{self.directory} cannot be looked at ({error.strerror}): make it, or mount its disk"
            ) from error
        return disk.f_bavail * disk.f_frsize


def _is_recording(path: Path) -> bool:
    begins = BEGINS[path.suffix]
    try:
        with path.open("rb") as file:
            return begins.startswith(file.read(len(begins)))
    except OSError:
        return False
