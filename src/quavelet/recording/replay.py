"""A recording in place of the chip: the same drains through the same decoder, so the same blocks."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from math import isinf

from quavelet.calibration.model import UNCALIBRATED, ImuCalibration
from quavelet.calibration.record_file import from_toml
from quavelet.core.blocks import RawBlock
from quavelet.core.clock import Clock
from quavelet.core.errors import SettingsError
from quavelet.core.health import Health
from quavelet.mpu6050.decoder import Decoder, DecoderState
from quavelet.mpu6050.drain import Drain
from quavelet.mpu6050.stream import StreamInfo
from quavelet.recording.reader import Position, RecordingReader
from quavelet.settings import Settings, parse_settings


@dataclass(frozen=True, slots=True)
class ReplayState:
    """All memory: where the recording stands, the stream there, its decoder's memory, and what was counted up to it."""

    position: Position
    info: StreamInfo
    decoder: DecoderState
    last_drain: Drain | None
    health: Health


class ReplaySource:
    """A `BlockSource` on a recording: one block a drain, None once it has given all.

    decoder      of the stream being read
    last_drain   what the last block was decoded from, None before the first
    `health` counts as it did live, and `records_damaged` what could not be read.
    """

    def __init__(self, reader: RecordingReader, *, health: Health) -> None:
        self._reader = reader
        self._health = health
        self._items = iter(reader)
        self.decoder = Decoder(reader.header.stream, health=health)
        self.last_drain: Drain | None = None

    @property
    def info(self) -> StreamInfo:
        """The chip of the stream being read; it changes where the chip was restarted."""
        return self.decoder.info

    @property
    def settings(self) -> Settings:
        """The settings it was recorded with. Raises SettingsError where this version no longer takes them."""
        return parse_settings(self._reader.header.settings, where=f"{self._reader.path} (recorded settings)")

    @property
    def calibration(self) -> ImuCalibration:
        """The calibration it was recorded with. Raises CalibrationError where this version no longer takes it."""
        text = self._reader.header.calibration
        return from_toml(text).calibration() if text else UNCALIBRATED

    def state(self) -> ReplayState:
        return ReplayState(
            self._reader.position, self.info, self.decoder.state(), self.last_drain, replace(self._health)
        )

    def restore(self, state: ReplayState) -> None:
        self._items = self._reader.from_position(state.position)
        self.decoder = Decoder(state.info, health=self._health)
        self.decoder.restore(state.decoder)
        self.last_drain = state.last_drain
        for name, count in state.health.as_dict().items():
            setattr(self._health, name, count)

    def read(self) -> RawBlock | None:
        """The samples of the next drain. Raises RecordingError where the file cannot be read on."""
        for item in self._items:
            self._health.records_damaged = self._reader.damage.records
            if isinstance(item, Drain):
                self.last_drain = item
                return self.decoder.decode(item)
            self.decoder = Decoder(item, health=self._health)
        self._health.records_damaged = self._reader.damage.records
        return None


def paced(source: ReplaySource, *, clock: Clock, speed: float) -> Iterator[RawBlock]:
    """The source's blocks, each as long after the first as it was when recorded, divided by `speed`.

    `speed` is above 0: 1 takes as long as the recording did, infinity does not wait. Raises SettingsError for
    any other. A caller who takes too long gets the following blocks at once, until he has caught up.
    """
    if not speed > 0:
        raise SettingsError(f"speed = {speed:g} does not fit: give more than 0, 1 for real time, inf for no waiting")
    return _paced(source, clock, speed)


def _paced(source: ReplaySource, clock: Clock, speed: float) -> Iterator[RawBlock]:
    start: tuple[int, int] | None = None
    while (block := source.read()) is not None:
        drain = source.last_drain
        if drain is not None and not isinf(speed):
            start = start or (drain.after_ns, clock.now_ns())
            clock.sleep_until_ns(start[1] + round((drain.after_ns - start[0]) / speed))
        yield block
