"""Recording for years: one file after the other, each complete by itself, the oldest deleted for the next."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

from quavelet.core.clock import Clock
from quavelet.core.errors import RecordingError
from quavelet.core.units import NS_PER_S
from quavelet.mpu6050.drain import Drain
from quavelet.mpu6050.stream import StreamInfo
from quavelet.recording.folder import RecordingFolder
from quavelet.recording.writer import RecordingWriter
from quavelet.settings import RecordingSettings, Settings

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
    """What became of the drains.

    file         the file being written, "" where there is none
    stopped      why there is none, "" while all is well
    files        begun
    deleted      the oldest, for room
    used_bytes   of all files that are there
    drains       taken into a file
    missed       drains that never came, the disk being too slow for them; marked as gaps on replay
    unwritten    drains thrown away while nothing could be written
    """

    file: str
    stopped: str
    files: int
    deleted: int
    used_bytes: int
    drains: int
    missed: int
    unwritten: int


class RotatingRecorder:
    """Writes streams and their drains into `directory`; a sink for both in one queue, like `RecordingWriter`.

    Nothing raises: where nothing can be written (disk full, directory gone), `tell` gets one sentence, what comes is
    thrown away and counted, and each minute a new file is tried. Only the clock of the drains is used, and the one
    of UTC for the names; either may be stepped. `name` begins the files' names (see `RecordingFolder`).

    calibration      is asked for the text of the calibration's file in use, as each file begins
    current_stream   is asked for the stream where a queue that overflowed has lost its StreamInfo
    """

    def __init__(
        self,
        directory: Path,
        *,
        name: str,
        bounds: Bounds,
        settings: Settings,
        clock: Clock,
        tell: Callable[[str], None],
        fsync_s: float = 0.0,
        utc_now: Callable[[], datetime] = lambda: datetime.now(UTC),
    ) -> None:
        self.calibration: Callable[[], str] = str
        self.current_stream: Callable[[], StreamInfo | None] = lambda: None
        self._folder = RecordingFolder(
            directory, name=name, total_bytes=bounds.total_bytes, keep_free_bytes=bounds.keep_free_bytes
        )
        self._bounds = bounds
        self._settings = settings
        self._clock = clock
        self._tell = tell
        self._fsync_s = fsync_s
        self._utc_now = utc_now
        self._info: StreamInfo | None = None
        self._expected = 0
        self._writer: RecordingWriter | None = None
        self._begun_ns: int | None = None
        self._failed_ns: int | None = None
        self._newest_ns = 0
        self._stopped = ""
        self._files = self._drains = self._missed = self._unwritten = 0
        self._outage = False
        self._good_since_ns: int | None = None

    def stats(self) -> RotationStats:
        """May be asked from any thread."""
        writer = self._writer
        return RotationStats(
            file=str(writer.path) if writer else "",
            stopped=self._stopped,
            files=self._files,
            deleted=self._folder.deleted,
            used_bytes=self._folder.used_bytes,
            drains=self._drains,
            missed=self._missed,
            unwritten=self._unwritten,
        )

    def write(self, item: StreamInfo | Drain) -> None:
        """Take a drain of the stream begun last, or begin another stream."""
        if isinstance(item, StreamInfo):
            self._take_stream(item)
            return
        if item.seq < self._expected:
            self._take_stream(self.current_stream())
        self._missed += item.seq - self._expected
        self._expected = item.seq + 1
        self._newest_ns = item.after_ns
        try:
            writer = self._writer_for(item)
        except (RecordingError, OSError) as error:
            self._fail(error)
            writer = None
        if writer is None:
            self._unwritten += 1
            return
        self._drains += 1
        try:
            writer.write(item)
        except (RecordingError, OSError) as error:
            self._fail(error)
        else:
            self._tell_of_recovery(item.after_ns)

    def close(self) -> None:
        """End the file that is being written."""
        try:
            self._end_file()
        except (RecordingError, OSError) as error:
            self._fail(error)

    def _take_stream(self, info: StreamInfo | None) -> None:
        """Begin another stream, in the same file while there is one; None: nobody knows which it is."""
        self._info, self._expected = info, 0
        try:
            if info is None:
                self._end_file()
            elif self._writer is not None:
                self._writer.begin(info)
        except (RecordingError, OSError) as error:
            self._fail(error)

    def _writer_for(self, drain: Drain) -> RecordingWriter | None:
        """Where this drain goes; None where it cannot go anywhere."""
        t_ns = drain.after_ns
        if self._writer is not None and self._is_full(self._writer, drain):
            self._end_file()
        if self._writer is None and self._info is not None and self._may_try(t_ns):
            self._writer = self._begin_file(self._info)
            self._begun_ns = None
        if self._begun_ns is None or t_ns < self._begun_ns:
            self._begun_ns = t_ns
        return self._writer

    def _is_full(self, writer: RecordingWriter, drain: Drain) -> bool:
        if self._begun_ns is None:
            # It holds no drain yet; one that is longer than a file may be goes in all the same.
            return False
        if drain.after_ns - self._begun_ns >= self._bounds.file_ns:
            return True
        return writer.size_with(drain) > self._bounds.file_bytes

    def _may_try(self, t_ns: int) -> bool:
        return self._failed_ns is None or not 0 <= t_ns - self._failed_ns < TRY_AGAIN_NS

    def _begin_file(self, info: StreamInfo) -> RecordingWriter:
        path = self._folder.next_path(self._utc_now())
        writer = RecordingWriter(
            path, settings=self._settings, clock=self._clock, fsync_s=self._fsync_s, room=self._folder
        )
        writer.calibration = self.calibration
        try:
            writer.begin(info)
        except RecordingError:
            # Nothing is in it.
            with suppress(OSError):
                path.unlink(missing_ok=True)
            raise
        self._files += 1
        self._stopped, self._failed_ns = "", None
        return writer

    def _tell_of_recovery(self, t_ns: int) -> None:
        if not self._outage:
            return
        if self._good_since_ns is None or t_ns < self._good_since_ns:
            self._good_since_ns = t_ns
        if t_ns - self._good_since_ns >= TRY_AGAIN_NS:
            self._outage = False
            self._tell(f"recording again; {self._unwritten} drains in all could not be recorded up to now")

    def _end_file(self) -> None:
        if self._writer is not None:
            self._writer.close()
            self._writer = None

    def _fail(self, error: Exception) -> None:
        writer, self._writer = self._writer, None
        if writer is not None:
            self._unwritten += writer.waiting
            self._drains -= writer.waiting
        if not self._outage:
            self._tell(f"recording stopped, tried again each minute: {error}")
        self._stopped, self._outage = str(error), True
        self._failed_ns, self._good_since_ns = self._newest_ns, None
