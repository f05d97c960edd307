"""MCAP files, for Foxglove and all that reads it: the attitude as a frame, the sensors as ROS has them.

    /attitude       foxglove.FrameTransform   body in the world (z up; y north once heading is known, else wherever)
    /mounting       foxglove.FrameTransform   the chip in the body, once
    /imu/data       sensor_msgs/msg/Imu       body: attitude with its covariance, rate and force calibrated
    /imu/data_raw   sensor_msgs/msg/Imu       chip: as it gave them, only scaled; no orientation
    /imu/mag_raw    sensor_msgs/msg/MagneticField   chip, not calibrated, where there is a magnetometer
    /log            foxglove.Log              what is doubtful from here on, gaps, and what yaw counts from

Times are UTC by the offset that `offset_ns` says, one for the whole file, so the clock may be stepped meanwhile.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from datetime import datetime
from importlib.metadata import version
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, NamedTuple, Self

import msgspec
import numpy as np

from quavelet.core.blocks import AttitudeBlock, Flag, RawBlock, YawFrom
from quavelet.core.errors import RecordingError, SettingsError
from quavelet.core.mounting import Axes, rotation
from quavelet.core.quaternion import from_matrix
from quavelet.core.units import NS_PER_MS, NS_PER_S
from quavelet.core.wall_clock import unix_ns_of
from quavelet.recording import mcap_words as words
from quavelet.recording.disk_file import DiskFile, Room
from quavelet.recording.format import Header

if TYPE_CHECKING:
    from mcap.writer import Writer

WORLD, BODY, CHIP = "world", "body", "chip"
TOPICS = {
    "/attitude": "foxglove.FrameTransform",
    "/mounting": "foxglove.FrameTransform",
    "/imu/data": "sensor_msgs/msg/Imu",
    "/imu/data_raw": "sensor_msgs/msg/Imu",
    "/imu/mag_raw": "sensor_msgs/msg/MagneticField",
    "/log": "foxglove.Log",
}
SUFFIX = ".mcap"
MAGIC = b"\x89MCAP0\r\n"
CHUNK_BYTES = 1 << 18
"""Written and compressed together: what a file that was cut loses at its end."""
SAMPLE_BYTES = 800
"""What a sample takes before it is compressed, at least."""
_MOST_SAMPLE_BYTES = 2048
"""With the longest numbers, and all that can be said of it."""
_MESSAGE_BYTES = 31 + 16
"""Around each message: its record's head, and its place in the chunk's index."""
_PER_CHUNK_BYTES = 300
"""Around each chunk: its head, indexes of all topics, and its entry at the end of the file."""
_END_BYTES = 1000
"""At the end of the file besides the schemas and topics, which stand there again."""
TESLA_PER_UT = 1e-6
_INFO, _WARNING = 2, 3
_NO_ROTATION = words.Rotation(0.0, 0.0, 0.0, 1.0)
_encode = msgspec.json.Encoder().encode


class Sample(NamedTuple):
    """The attitude at one instant, as a row of an `AttitudeBlock`; `flags` and `yaw` are words."""

    t_ns: int
    q: Sequence[float]
    sigma_rad: Sequence[float]
    gyro_rad_s: Sequence[float]
    accel_m_s2: Sequence[float]
    flags: Sequence[str]
    yaw: str
    gap_ns: int


class McapWriter:
    """A new MCAP file at `path`; a context manager. One that was never closed has no index, but can be read.

    offset_ns    to be added to times of blocks for ns since 1970
    axes         how the chip is mounted
    about        what stands in the file's metadata under "quavelet"
    room         is asked before anything is written; with it the file is locked until it is closed
    fsync_s      the disk is waited for every so many seconds; 0: only by `close`
    chunk_bytes  written and compressed together: what a file that was cut loses at its end
    waiting      samples taken that were not handed to the operating system yet

    Raises SettingsError where the package mcap is not there; it and each method RecordingError where the file cannot be
    written, which is closed then.
    """

    def __init__(
        self,
        path: Path,
        *,
        offset_ns: int,
        axes: Axes,
        about: Mapping[str, str],
        room: Room | None = None,
        fsync_s: float = 0.0,
        chunk_bytes: int = CHUNK_BYTES,
    ) -> None:
        writer = mcap_library()
        self.path = path
        self.waiting = 0
        self._offset_ns = offset_ns
        self._axes = axes
        self._mounted = False
        self._flags: Sequence[str] | None = None
        self._yaw = ""
        self._names: dict[int, list[str]] = {}
        self._sequence = 0
        self._fsync_ns = round(fsync_s * NS_PER_S)
        self._synced_ns: int | None = None
        self._chunks = self._described_bytes = self._pending_bytes = 0
        self._channels: dict[str, int] = {}
        self._file = DiskFile(path, room=room)
        self._writer = writer(_Stream(self._file), chunk_size=chunk_bytes, enable_data_crcs=True)
        try:
            self._begin(about)
        except RecordingError:
            # Nothing is in it, and the next try would be refused for it.
            path.unlink(missing_ok=True)
            raise

    def write(self, item: AttitudeBlock | Sample) -> None:
        """The attitude of one sample, or of each of a block; what is doubtful where that changes."""
        self._file.must_be_open()
        if isinstance(item, Sample):
            self._write_sample(item)
        else:
            self._write_attitude(item)

    def write_raw(self, block: RawBlock) -> None:
        """What the chip gave, scaled by its ranges."""
        self._file.must_be_open()
        self._write_raw(block)

    def size_with(self, item: Sample) -> int:
        """The most bytes that the file has with this sample in it too, and closed. What waits may yet shrink."""
        del item
        chunks = _PER_CHUNK_BYTES * (self._chunks + 2)
        waiting = self._pending_bytes + _MOST_SAMPLE_BYTES
        return self._file.size_bytes + waiting + chunks + self._described_bytes + _END_BYTES

    def close(self) -> None:
        """Write the index, and wait until all is on the disk. May be called twice."""
        if self._file.closed:
            return
        self._writer.finish()
        self._file.flush()
        self._file.sync()
        self._file.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None, /
    ) -> None:
        self.close()

    def _begin(self, about: Mapping[str, str]) -> None:
        self._writer.start(profile="", library=f"quavelet {version('quavelet')}")
        schemas = {name: msgspec.json.encode(schema) for name, schema in words.SCHEMAS.items()}
        kinds = {name: self._writer.register_schema(name, "jsonschema", text) for name, text in schemas.items()}
        self._described_bytes = sum(map(len, schemas.values())) + 100 * (len(schemas) + len(TOPICS))
        # They stand in the first chunk.
        self._pending_bytes = self._described_bytes
        for topic, kind in TOPICS.items():
            self._channels[topic] = self._writer.register_channel(topic, "json", kinds[kind])
        frames = f"{WORLD}: z up, y north once yaw is magnetic or true; {BODY}: as mounted; {CHIP}: the chip's own axes"
        self._writer.add_metadata("quavelet", {"frames": frames, "offset_ns": str(self._offset_ns), **about})
        self._file.flush()
        if self._fsync_ns:
            self._file.sync()
            self._file.sync_folder()

    def _write_attitude(self, block: AttitudeBlock) -> None:
        rows = zip(
            block.t_ns.tolist(),
            block.q.tolist(),
            block.sigma_rad.tolist(),
            block.gyro_rad_s.tolist(),
            block.accel_m_s2.tolist(),
            block.flags.tolist(),
            block.yaw_from.tolist(),
            block.gap_ns.tolist(),
            strict=True,
        )
        for t_ns, q, sigma, gyro, accel, flags, yaw_from, gap_ns in rows:
            if flags not in self._names:
                self._names[flags] = Flag.names(flags)
            yaw = YawFrom(yaw_from).name.lower()
            self._write_sample(Sample(t_ns, q, sigma, gyro, accel, self._names[flags], yaw, gap_ns))

    def _write_sample(self, sample: Sample) -> None:
        t_ns, (w, x, y, z) = sample.t_ns, sample.q
        self._mount_at(t_ns)
        self._tell_doubt(sample)
        time = words.time_of(t_ns + self._offset_ns)
        turned = words.Rotation(x, y, z, w)
        self._put("/attitude", t_ns, words.FrameTransform(time, WORLD, BODY, turned))
        gyro, accel = words.Vector(*sample.gyro_rad_s), words.Vector(*sample.accel_m_s2)
        header = words.Header(time, BODY)
        self._put("/imu/data", t_ns, words.Imu(header, turned, covariance_of(sample.sigma_rad), gyro, accel))
        if self._pending_bytes:
            self.waiting += 1

    def _write_raw(self, block: RawBlock) -> None:
        counts = block.counts.astype(np.float64)
        accel = (counts[:, 0:3] * block.scale.accel_m_s2_per_lsb).tolist()
        gyro = (counts[:, 4:7] * block.scale.gyro_rad_s_per_lsb).tolist()
        field = (block.field_ut * TESLA_PER_UT).tolist()
        for t_ns, a, g, b in zip(block.t_ns.tolist(), accel, gyro, field, strict=True):
            header = words.Header(words.time_of(t_ns + self._offset_ns), CHIP)
            felt = words.Imu(header, _NO_ROTATION, words.NOT_MEASURED, words.Vector(*g), words.Vector(*a))
            self._put("/imu/data_raw", t_ns, felt)
            if math.isfinite(b[0]):
                self._put("/imu/mag_raw", t_ns, words.MagneticField(header, words.Vector(*b)))

    def _mount_at(self, t_ns: int) -> None:
        if self._mounted:
            return
        self._mounted = True
        w, x, y, z = from_matrix(np.array(rotation(self._axes))).tolist()
        time = words.time_of(t_ns + self._offset_ns)
        self._put("/mounting", t_ns, words.FrameTransform(time, BODY, CHIP, words.Rotation(x, y, z, w)))

    def _tell_doubt(self, sample: Sample) -> None:
        if sample.flags != self._flags or sample.gap_ns:
            self._flags = sample.flags
            text = ", ".join(sample.flags) or "all is well"
            if sample.gap_ns:
                text += f": {sample.gap_ns / NS_PER_MS:.1f} ms without samples before this one"
            self._log(sample.t_ns, text, warning=bool(sample.flags))
        if sample.yaw != self._yaw:
            self._yaw = sample.yaw
            self._log(sample.t_ns, f"yaw is {sample.yaw} from here on", warning=False)

    def _log(self, t_ns: int, text: str, *, warning: bool) -> None:
        level = _WARNING if warning else _INFO
        self._put("/log", t_ns, words.Log(words.time_of(t_ns + self._offset_ns), level, text))

    def _put(self, topic: str, t_ns: int, message: msgspec.Struct) -> None:
        utc_ns = t_ns + self._offset_ns
        self._sequence = (self._sequence + 1) % (1 << 32)
        text = _encode(message)
        self._writer.add_message(self._channels[topic], utc_ns, text, utc_ns, self._sequence)
        self._pending_bytes += len(text) + _MESSAGE_BYTES
        if self._file.waiting_bytes:
            self._hand_over_chunk(t_ns)

    def _hand_over_chunk(self, t_ns: int) -> None:
        self._file.flush()
        self._chunks += 1
        self._pending_bytes = self.waiting = 0
        if self._synced_ns is None:
            self._synced_ns = t_ns
        # Time that goes back is another clock's.
        if self._fsync_ns and not 0 <= t_ns - self._synced_ns < self._fsync_ns:
            self._file.sync()
            self._synced_ns = t_ns


class _Stream:
    """What the mcap library writes to."""

    def __init__(self, file: DiskFile) -> None:
        self._file = file

    def write(self, data: bytes, /) -> int:
        self._file.append(data)
        return len(data)

    def tell(self) -> int:
        return self._file.size_bytes


def covariance_of(sigma_rad: Sequence[float]) -> words.Nine:
    """Of a small rotation about the world's x, y, z from one sigma of each; where one is not known, NOT_MEASURED."""
    if not all(math.isfinite(sigma) for sigma in sigma_rad):
        return words.NOT_MEASURED
    x, y, z = (sigma * sigma for sigma in sigma_rad)
    return (x, 0.0, 0.0, 0.0, y, 0.0, 0.0, 0.0, z)


def offset_of(header: Header) -> int:
    """UTC since 1970 minus the clock of the drains, ns, as they stood when the recording began.

    Raises RecordingError where the header's time is none.
    """
    try:
        return unix_ns_of(datetime.fromisoformat(header.started_utc)) - header.started_ns
    except (ValueError, TypeError) as error:
        raise RecordingError(f"the recording's start, '{header.started_utc}', is no time: record again") from error


def mcap_library() -> type[Writer]:
    """What writes MCAP. Raises SettingsError where the package is not there."""
    try:
        from mcap.writer import Writer
    except ImportError as error:
        raise SettingsError("MCAP files need the package mcap: pip install 'quavelet[mcap]'") from error
    return Writer
