"""Recording all the time what the chip gave: streams and their drains, in files of which each is complete by itself."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

from quavelet.core.clock import Clock
from quavelet.core.errors import RecordingError
from quavelet.core.wall_clock import Instant, OffsetNs
from quavelet.mpu6050.drain import Drain
from quavelet.mpu6050.stream import StreamInfo
from quavelet.recording.format import SUFFIX
from quavelet.recording.rotation import Bounds, Rotation, RotationStats
from quavelet.recording.writer import RecordingWriter
from quavelet.settings import Settings


class RotatingRecorder:
    """Writes streams and their drains into `directory`; a sink for both in one queue, like `RecordingWriter`.

    Nothing raises, see `Rotation`. Only the clock of the drains is used, and `offset_ns` from it to UTC for names and
    headers; either may be stepped. `name` begins the files' names (see `RecordingFolder`).

    calibration      is asked for the text of the calibration's file in use, as each file begins
    current_stream   is asked for the stream where none was seen to begin: the queue overflowed and has lost its
                     StreamInfo, or the recorder joins in the middle of one
    joins            it does; what went before its first drain is not missed
    """

    def __init__(
        self,
        directory: Path,
        *,
        name: str,
        bounds: Bounds,
        settings: Settings,
        clock: Clock,
        offset_ns: OffsetNs,
        tell: Callable[[str], None],
        fsync_s: float = 0.0,
        joins: bool = False,
    ) -> None:
        self.calibration: Callable[[], str] = str
        self.current_stream: Callable[[], StreamInfo | None] = lambda: None
        self._rotation: Rotation[Drain] = Rotation(
            directory,
            name=name,
            suffix=SUFFIX,
            begin=self._begin_file,
            bounds=bounds,
            kind="drains",
            tell=tell,
            clock=clock,
            offset_ns=offset_ns,
        )
        self._settings = settings
        self._clock = clock
        self._fsync_s = fsync_s
        self._offset_ns = offset_ns
        self._writer: RecordingWriter | None = None
        self._info: StreamInfo | None = None
        self._expected = 0
        self._joins = joins

    def stats(self) -> RotationStats:
        """May be asked from any thread."""
        return self._rotation.stats()

    def write(self, item: StreamInfo | Drain) -> None:
        """Take a drain of the stream begun last, or begin another stream."""
        if isinstance(item, StreamInfo):
            self._take_stream(item)
            return
        if item.seq < self._expected:
            self._take_stream(self.current_stream())
        elif self._info is None:
            self._info = self.current_stream()
        if self._joins:
            self._joins, self._expected = False, item.seq
        self._rotation.missed += item.seq - self._expected
        self._expected = item.seq + 1
        if self._info is None:
            self._rotation.unwritten += 1
        else:
            self._rotation.write(item, item.after_ns)

    def close(self) -> None:
        """End the file that is being written."""
        self._rotation.close()

    def _take_stream(self, info: StreamInfo | None) -> None:
        """Begin another stream, in the same file while there is one; None: nobody knows which it is."""
        self._info, self._expected = info, 0
        writer = self._writer
        if info is None:
            self._rotation.close()
        elif writer is not None:
            self._rotation.while_writing(lambda: writer.begin(info))

    def _begin_file(self, path: Path, begins: Instant) -> RecordingWriter:
        """The next file, with its header in it."""
        assert self._info is not None, "a drain has a stream"
        self._writer = writer = RecordingWriter(
            path,
            settings=self._settings,
            clock=self._clock,
            fsync_s=self._fsync_s,
            room=self._rotation.folder,
            offset_ns=self._offset_ns,
        )
        writer.calibration = self.calibration
        try:
            writer.begin(self._info, begins)
        except RecordingError:
            # Nothing is in it.
            with suppress(OSError):
                path.unlink(missing_ok=True)
            raise
        return writer
