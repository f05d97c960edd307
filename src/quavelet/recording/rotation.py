"""Recording for years: one file after the other, each complete by itself, the oldest deleted for the next.

What is in a file is the business of who writes it: `FileWriter`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Generic, Protocol, TypeVar

from quavelet.core.clock import Clock
from quavelet.core.errors import RecordingError
from quavelet.core.units import NS_PER_S
from quavelet.core.wall_clock import Instant, OffsetNs
from quavelet.recording.clock_set import ClockSet
from quavelet.recording.folder import RecordingFolder
from quavelet.settings import RecordingSettings

MB = 1_000_000
TRY_AGAIN_NS = 60 * NS_PER_S
"""From a failure to the next try, and for how long a try must go well to be told: a disk that is full to the brim
takes a little every time, since the try before is the oldest file then."""


@dataclass(frozen=True, slots=True)
class Bounds:
    """How much may be recorded.

    file_bytes       of a file; one drain that is longer by itself has a file of its own
    file_ns          a file is this long at most
    total_bytes      of all files together
    keep_free_bytes  of the disk, for others
    """

    file_bytes: int
    file_ns: int
    total_bytes: int
    keep_free_bytes: int = 0

    @classmethod
    def of(cls, settings: RecordingSettings) -> Bounds:
        """As the settings have them."""
        return cls(
            file_bytes=round(settings.file_mb * MB),
            file_ns=round(settings.file_minutes * 60 * NS_PER_S),
            total_bytes=round(settings.total_mb * MB),
            keep_free_bytes=round(settings.keep_free_mb * MB),
        )


@dataclass(frozen=True, slots=True)
class RotationStats:
    """What became of the items, which are drains or messages, as `kind` says.

    file         the file being written, "" where there is none
    stopped      why there is none, "" while all is well
    files        begun
    deleted      the oldest, for room
    used_bytes   of all files that are there
    written      taken into a file
    missed       that never came, the disk being too slow for them
    unwritten    thrown away while nothing could be written
    """

    kind: str
    file: str
    stopped: str
    files: int
    deleted: int
    used_bytes: int
    written: int
    missed: int
    unwritten: int


Item = TypeVar("Item", contravariant=True)


class FileWriter(Protocol[Item]):
    """One file; all but `size_with` raise RecordingError where it cannot be written, and it is closed then.

    waiting   items taken that were not handed to the operating system yet
    """

    @property
    def path(self) -> Path: ...

    @property
    def waiting(self) -> int: ...

    def size_with(self, item: Item, /) -> int:
        """The most bytes that the file has with this item in it too, and closed."""
        ...

    def write(self, item: Item, /) -> None: ...

    def close(self) -> None: ...


class Rotation(Generic[Item]):
    """Puts items into one file after the other.

    Nothing raises: where nothing can be written (disk full, directory gone), `tell` gets one sentence, what comes is
    thrown away and counted, and each minute a new file is tried. Times may be stepped.

    name, suffix   of the files, see `RecordingFolder`
    begin       makes the file at a path, with the instant that its name tells
    kind        what the items are, in words
    clock       of the items' times
    offset_ns   from it to UTC; where it is set, another file begins
    missed      items that never came, for who knows of them to count
    unwritten   items thrown away
    """

    def __init__(
        self,
        directory: Path,
        *,
        name: str,
        suffix: str,
        begin: Callable[[Path, Instant], FileWriter[Item]],
        bounds: Bounds,
        kind: str,
        tell: Callable[[str], None],
        clock: Clock,
        offset_ns: OffsetNs,
    ) -> None:
        self.missed = self.unwritten = 0
        self.folder = RecordingFolder(
            directory,
            name=name,
            suffix=suffix,
            total_bytes=bounds.total_bytes,
            keep_free_bytes=bounds.keep_free_bytes,
        )
        self._begin = begin
        self._bounds = bounds
        self._kind = kind
        self._tell = tell
        self._clock = clock
        self._clock_set = ClockSet(offset_ns)
        self._writer: FileWriter[Item] | None = None
        self._begun_ns: int | None = None
        self._failed_ns: int | None = None
        self._newest_ns = 0
        self._stopped = ""
        self._files = self._written = 0
        self._outage = False
        self._good_since_ns: int | None = None

    def stats(self) -> RotationStats:
        """May be asked from any thread."""
        writer = self._writer
        return RotationStats(
            kind=self._kind,
            file=str(writer.path) if writer else "",
            stopped=self._stopped,
            files=self._files,
            deleted=self.folder.deleted,
            used_bytes=self.folder.used_bytes,
            written=self._written,
            missed=self.missed,
            unwritten=self.unwritten,
        )

    def write(self, item: Item, t_ns: int) -> None:
        """Take an item of that time."""
        if self._clock_set.since_begin(t_ns):
            self.close()
        self._newest_ns = t_ns
        try:
            writer = self._writer_for(item, t_ns)
        except (RecordingError, OSError) as error:
            self._fail(error)
            writer = None
        if writer is None:
            self.unwritten += 1
            return
        self._written += 1
        try:
            writer.write(item)
        except (RecordingError, OSError) as error:
            self._fail(error)
        else:
            self._tell_of_recovery(t_ns)

    def while_writing(self, step: Callable[[], None]) -> None:
        """Do something to the file that is being written, where there is one."""
        if self._writer is None:
            return
        try:
            step()
        except (RecordingError, OSError) as error:
            self._fail(error)

    def close(self) -> None:
        """End the file that is being written; the next item begins another."""
        try:
            self._end_file()
        except (RecordingError, OSError) as error:
            self._fail(error)

    def _writer_for(self, item: Item, t_ns: int) -> FileWriter[Item] | None:
        """Where this item goes; None where it cannot go anywhere."""
        if self._writer is not None and self._is_full(self._writer, item, t_ns):
            self._end_file()
        if self._writer is None and self._may_try(t_ns):
            # Before the file takes it: where the clock is set in between, another begins.
            begins = Instant(offset_ns=self._clock_set.begin(), t_ns=self._clock.now_ns())
            self._writer = self._begin(self.folder.next_path(begins.utc), begins)
            self._begun_ns = None
            self._files += 1
            self._stopped, self._failed_ns = "", None
        if self._begun_ns is None or t_ns < self._begun_ns:
            self._begun_ns = t_ns
        return self._writer

    def _is_full(self, writer: FileWriter[Item], item: Item, t_ns: int) -> bool:
        if self._begun_ns is None:
            # It holds nothing yet; an item that is longer than a file may be goes in all the same.
            return False
        if t_ns - self._begun_ns >= self._bounds.file_ns:
            return True
        return writer.size_with(item) > self._bounds.file_bytes

    def _may_try(self, t_ns: int) -> bool:
        return self._failed_ns is None or not 0 <= t_ns - self._failed_ns < TRY_AGAIN_NS

    def _tell_of_recovery(self, t_ns: int) -> None:
        if not self._outage:
            return
        if self._good_since_ns is None or t_ns < self._good_since_ns:
            self._good_since_ns = t_ns
        if t_ns - self._good_since_ns >= TRY_AGAIN_NS:
            self._outage = False
            self._tell(f"recording again; {self.unwritten} {self._kind} in all could not be recorded up to now")

    def _end_file(self) -> None:
        if self._writer is not None:
            self._writer.close()
            self._writer = None

    def _fail(self, error: Exception) -> None:
        writer, self._writer = self._writer, None
        if writer is not None:
            self.unwritten += writer.waiting
            self._written -= writer.waiting
        if not self._outage:
            self._tell(f"recording stopped, tried again each minute: {error}")
        self._stopped, self._outage = str(error), True
        self._failed_ns, self._good_since_ns = self._newest_ns, None
