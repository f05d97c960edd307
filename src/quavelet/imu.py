"""The chip and its pipeline as one thing: what the commands run and what a program imports."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path

from quavelet.bus.open import open_bus, open_line
from quavelet.bus.protocol import DataReady, I2CBus
from quavelet.calibration.model import UNCALIBRATED
from quavelet.calibration.record import CalibrationRecord, ChipIdentity, OffsetsTable
from quavelet.calibration.record_file import any_records, as_toml, find_record, load_record
from quavelet.core.blocks import AttitudeBlock
from quavelet.core.clock import Clock, MonotonicClock
from quavelet.core.closing import Closing
from quavelet.core.errors import CalibrationError, EndOfData
from quavelet.core.health import Health
from quavelet.core.units import NS_PER_S
from quavelet.loop.deadline import FixedStepLoop
from quavelet.mpu6050.access import RegisterAccess
from quavelet.mpu6050.drain import Drain
from quavelet.mpu6050.fingerprint import fingerprint_of
from quavelet.mpu6050.offset_plan import OffsetPlan
from quavelet.mpu6050.source import ChipSource
from quavelet.mpu6050.stream import StreamInfo
from quavelet.pipeline import build_pipeline
from quavelet.settings import Settings, load_settings
from quavelet.sinks.message import Message, message_of

log = logging.getLogger(__name__)


class Imu(Closing):
    """A chip on an open bus. Iterating gives a `Message` at each deadline of the loop that has new samples.

    line is the open wire from its INT pin, None where there is none; closing closes both.
    on_stream and on_drain are told what a recording needs (see `ChipSource`), on_note which calibration is used or why
    one is not, once the chip is known: `calibration` and `calibration_file`, None where there is none.
    """

    def __init__(
        self,
        bus: I2CBus,
        *,
        settings: Settings,
        clock: Clock,
        line: DataReady | None = None,
        on_stream: Callable[[StreamInfo], None] | None = None,
        on_drain: Callable[[Drain], None] | None = None,
        on_note: Callable[[str], None] | None = None,
    ) -> None:
        self.bus = bus
        self.line = line
        self.settings = settings
        self.clock = clock
        self.health = Health()
        self._on_stream = on_stream
        self._on_note = on_note
        self.calibration: CalibrationRecord | None = None
        self.calibration_file: Path | None = None
        self.pipeline = build_pipeline(settings)
        self.source = ChipSource(
            bus,
            address=settings.bus.address,
            config=settings.chip,
            accept_id=settings.bus.accept_id,
            offsets=settings.offsets.plan(),
            magnetometer=settings.magnetometer,
            clock=clock,
            health=self.health,
            line=line,
            on_stream=self._begin_stream,
            on_drain=on_drain,
        )
        self.loop = FixedStepLoop(clock, period_ns=round(NS_PER_S / settings.loop.rate_hz))

    def read(self) -> AttitudeBlock | None:
        """Do what is due: the attitude of each sample since the last call, possibly none; None at the end
        of a bus that only plays a recording. Raises what `ChipSource` raises."""
        try:
            return self.pipeline.process(self.source.read())
        except EndOfData:
            return None

    def messages(self, *, until_ns: int | None = None) -> Iterator[Message]:
        """The messages up to the clock's `until_ns`, for ever where it is None. The work of whoever takes
        them is done between the deadlines; deadlines it makes the loop miss are counted and skipped."""
        for _ in self.loop.deadlines(until_ns):
            block = self.read()
            if block is None:
                return
            if len(block):
                yield message_of(block, src=self.bus.name)

    @property
    def measured_rate_hz(self) -> float | None:
        """The chip's sample rate by the host's clock, None until it is measured."""
        return self.source.decoder.measured_rate_hz if self.source.decoder else None

    @property
    def calibration_text(self) -> str:
        """The file of the calibration in use, "" without one: what a recording keeps."""
        return as_toml(self.calibration) if self.calibration else ""

    def _begin_stream(self, info: StreamInfo) -> None:
        self._calibrate(info)
        if self._on_stream:
            self._on_stream(info)

    def _calibrate(self, info: StreamInfo) -> None:
        """Take the calibration of this chip. One that was asked for by name and does not fit is an error."""
        asked, record, note = self.settings.calibration, None, ""
        path = Path(asked.file).expanduser() if asked.file else None
        if path or (asked.automatic and any_records()):
            chip = self.identity(info)
            path = path or find_record(chip)
            try:
                record = record_for(chip, path, info=info, offsets=self.settings.offsets.plan()) if path else None
            except CalibrationError as error:
                if asked.file:
                    raise
                note = f"no calibration is used: {error}"
        if record is not None:
            note = f"calibration of {record.made.utc} from {path}"
        if note:
            (self._on_note or log.info)(note)
        if record != self.calibration:
            self.calibration, self.calibration_file = record, path if record else None
            calibration = record.calibration() if record else UNCALIBRATED
            self.pipeline = build_pipeline(self.settings, calibration=calibration)

    def identity(self, info: StreamInfo) -> ChipIdentity:
        """Which chip streams, by its factory's trim; reads some registers of it. Raises BusError."""
        chip = RegisterAccess(self.bus, address=info.address, clock=self.clock, health=self.health)
        return ChipIdentity(
            who_am_i=info.who_am_i,
            name=info.variant.name,
            bus=info.src,
            address=info.address,
            fingerprint=fingerprint_of(chip, variant=info.variant, offsets=self.settings.offsets.plan()),
        )

    def __iter__(self) -> Iterator[Message]:
        return self.messages()

    def close(self) -> None:
        self.bus.close()
        if self.line is not None:
            self.line.close()


def record_for(chip: ChipIdentity, path: Path, *, info: StreamInfo, offsets: OffsetPlan | None) -> CalibrationRecord:
    """The calibration in this file. Raises CalibrationError, beginning with the path, where it does not fit."""
    record = load_record(path)
    written = (
        None
        if offsets is None
        else OffsetsTable(
            accel_factory=offsets.accel_factory,
            gyro_factory=offsets.gyro_factory,
            accel=offsets.accel,
            gyro=offsets.gyro,
        )
    )
    try:
        record.check_fits(chip, gyro_range_dps=info.gyro_range_dps, accel_range_g=info.accel_range_g, offsets=written)
    except CalibrationError as error:
        raise CalibrationError(f"{path}: {error}") from error
    return record


def open_imu(bus: str | None = None, *, config: Path | str | None = None, clock: Clock | None = None) -> Imu:
    """An `Imu` on the bus called `bus` ("linux:1", "fake:tilt"), set up by the TOML file `config`.

    Raises SettingsError for a setting that cannot be, BusError where the bus or its data-ready line cannot be opened.
    """
    options = {} if bus is None else {"bus.name": bus}
    settings = load_settings(Path(config) if config else None, options=dict(options)).settings
    clock = clock or MonotonicClock()
    with ExitStack() as stack:
        i2c = stack.enter_context(open_bus(settings.bus.name, clock=clock))
        line = open_line(settings.bus.int_line, bus=i2c, address=settings.bus.address)
        stack.pop_all()
    return Imu(i2c, settings=settings, clock=clock, line=line)
