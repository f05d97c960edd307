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
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from datetime import UTC, datetime, timedelta
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
from quavelet.core.units import NS_PER_MS
from quavelet.recording import mcap_words as words
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

    offset_ns   to be added to times of blocks for ns since 1970
    axes        how the chip is mounted
    about       what stands in the file's metadata under "quavelet"
    Raises SettingsError where the package mcap is not there, RecordingError where the file cannot be written.
    """

    def __init__(self, path: Path, *, offset_ns: int, axes: Axes, about: Mapping[str, str]) -> None:
        writer = _writer()
        self.path = path
        self._offset_ns = offset_ns
        self._axes = axes
        self._mounted = False
        self._flags: Sequence[str] | None = None
        self._yaw = ""
        self._names: dict[int, list[str]] = {}
        self._sequence = 0
        try:
            self._file = path.open("xb")
        except FileExistsError as error:
            raise RecordingError(f"{path} exists: give another name, or move it away first") from error
        except OSError as error:
            raise self._error(error) from error
        self._writer = writer(self._file, chunk_size=CHUNK_BYTES, enable_data_crcs=True)
        self._channels: dict[str, int] = {}
        self._guarded(lambda: self._begin(about))

    def write(self, block: AttitudeBlock) -> None:
        """The attitude of each sample; what is doubtful where that changes."""
        self._guarded(lambda: self._write_attitude(block))

    def write_sample(self, sample: Sample) -> None:
        """One of these."""
        self._guarded(lambda: self._write_sample(sample))

    def write_raw(self, block: RawBlock) -> None:
        """What the chip gave, scaled by its ranges."""
        self._guarded(lambda: self._write_raw(block))

    def close(self) -> None:
        """Write the index and close the file. May be called twice."""
        if not self._file.closed:
            self._guarded(self._end)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None, /
    ) -> None:
        self.close()

    def _begin(self, about: Mapping[str, str]) -> None:
        self._writer.start(profile="", library=f"quavelet {version('quavelet')}")
        kinds = {
            name: self._writer.register_schema(name, "jsonschema", msgspec.json.encode(schema))
            for name, schema in words.SCHEMAS.items()
        }
        for topic, kind in TOPICS.items():
            self._channels[topic] = self._writer.register_channel(topic, "json", kinds[kind])
        frames = f"{WORLD}: z up, y north once yaw is magnetic or true; {BODY}: as mounted; {CHIP}: the chip's own axes"
        self._writer.add_metadata("quavelet", {"frames": frames, "offset_ns": str(self._offset_ns), **about})

    def _end(self) -> None:
        self._writer.finish()
        self._file.close()

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
        self._writer.add_message(self._channels[topic], utc_ns, _encode(message), utc_ns, self._sequence)

    def _guarded(self, step: Callable[[], None]) -> None:
        if self._file.closed:
            raise RecordingError(f"{self.path} is closed: write to a new file")
        try:
            step()
        except OSError as error:
            with suppress(OSError):
                self._file.close()
            raise self._error(error) from error

    def _error(self, error: OSError) -> RecordingError:
        return RecordingError(f"{self.path} cannot be written ({error.strerror}): make room, or give another place")


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
        begun = datetime.fromisoformat(header.started_utc)
        return (begun - datetime(1970, 1, 1, tzinfo=UTC)) // timedelta(microseconds=1) * 1000 - header.started_ns
    except (ValueError, TypeError) as error:
        raise RecordingError(f"the recording's start, '{header.started_utc}', is no time: record again") from error


def _writer() -> type[Writer]:
    try:
        from mcap.writer import Writer
    except ImportError as error:
        raise SettingsError("MCAP files need the package mcap: pip install 'quavelet[mcap]'") from error
    return Writer
