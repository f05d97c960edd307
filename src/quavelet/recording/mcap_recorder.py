"""Recording all the time what was made of it: samples of the attitude, in MCAP files of bounded size."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path

from quavelet.core.clock import Clock
from quavelet.core.mounting import Axes
from quavelet.core.wall_clock import Instant, OffsetNs
from quavelet.recording.mcap import CHUNK_BYTES, SAMPLE_BYTES, SUFFIX, McapWriter, Sample, mcap_library
from quavelet.recording.rotation import Bounds, Rotation, RotationStats


class RotatingMcap:
    """Writes samples into `directory`, as `RotatingRecorder` does streams and drains; nothing raises there either.

    offset_ns   asked as each file begins, see `McapWriter`
    rate_hz     samples a second that are to be expected: so many at most go into a chunk, which is what a kill may cost
    Raises SettingsError where the package mcap is not there.
    """

    def __init__(
        self,
        directory: Path,
        *,
        name: str,
        bounds: Bounds,
        axes: Axes,
        about: Mapping[str, str],
        clock: Clock,
        offset_ns: OffsetNs,
        rate_hz: float,
        tell: Callable[[str], None],
        fsync_s: float = 0.0,
    ) -> None:
        mcap_library()
        self._rotation: Rotation[Sample] = Rotation(
            directory,
            name=name,
            suffix=SUFFIX,
            begin=self._begin_file,
            bounds=bounds,
            kind="messages",
            tell=tell,
            clock=clock,
            offset_ns=offset_ns,
        )
        self._axes = axes
        self._about = about
        # A file is ended as if its last chunk did not shrink: that must not be much of it.
        self._chunk_bytes = min(CHUNK_BYTES, round(SAMPLE_BYTES * rate_hz), bounds.file_bytes // 10)
        self._fsync_s = fsync_s

    def stats(self) -> RotationStats:
        """May be asked from any thread."""
        return self._rotation.stats()

    def write(self, sample: Sample) -> None:
        """Take a sample."""
        self._rotation.write(sample, sample.t_ns)

    def close(self) -> None:
        """End the file that is being written."""
        self._rotation.close()

    def _begin_file(self, path: Path, begins: Instant) -> McapWriter:
        return McapWriter(
            path,
            offset_ns=begins.offset_ns,
            axes=self._axes,
            about=self._about,
            room=self._rotation.folder,
            fsync_s=self._fsync_s,
            chunk_bytes=self._chunk_bytes,
        )
