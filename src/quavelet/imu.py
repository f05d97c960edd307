"""The chip and its pipeline as one thing: what the commands run and what a program imports."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path

from quavelet.bus.open import open_bus, open_line
from quavelet.bus.protocol import DataReady, I2CBus
from quavelet.calibration.model import UNCALIBRATED, ImuCalibration
from quavelet.calibration.record import CalibrationRecord, ChipIdentity, OffsetsTable
from quavelet.calibration.record_file import any_records, as_toml, find_record, load_record
from quavelet.core.blocks import AttitudeBlock, RawBlock
from quavelet.core.clock import Clock, MonotonicClock
from quavelet.core.closing import Closing
from quavelet.core.errors import CalibrationError, EndOfData, NotPossible
from quavelet.core.flow import Stage
from quavelet.core.health import Health
from quavelet.core.paths import expanded
from quavelet.core.units import NS_PER_S
from quavelet.loop.deadline import FixedStepLoop
from quavelet.mpu6050.access import RegisterAccess
from quavelet.mpu6050.drain import Drain
from quavelet.mpu6050.fingerprint import fingerprint_of
from quavelet.mpu6050.offset_plan import OffsetPlan
from quavelet.mpu6050.source import ChipSource
from quavelet.mpu6050.stream import StreamInfo
from quavelet.mpu6050.variants import Variant
from quavelet.pipeline import Pipeline, PipelineState, build_pipeline, tell_uncalibrated_magnetometer
from quavelet.settings import Settings, load_settings
from quavelet.sinks.message import Message, message_of

log = logging.getLogger(__name__)


class Imu(Closing):
    """A chip on an open bus. Iterating gives a `Message` at each deadline of the loop that has new samples.

    line is the open wire from its INT pin, None where there is none; closing closes both.
    around is what the pipeline is put into, once it is built and again when a calibration is found.
    stages is the pipeline itself, pipeline what it was put into.
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
        around: Callable[[Pipeline], Stage[RawBlock, AttitudeBlock, PipelineState]] | None = None,
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
        self.offsets: OffsetPlan | None = settings.offsets.plan()
        self._found: tuple[CalibrationRecord | None, Path | None, str] = (None, None, "")
        self._told_magnetometer = False
        self._around = around
        self._yaw_asked: Callable[[], None] | None = None
        self.stages, self.pipeline = self._built()
        self.source = ChipSource(
            bus,
            address=settings.bus.address,
            config=settings.chip,
            accept_id=settings.bus.accept_id,
            find_offsets=self._offsets_for,
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
            block = self.source.read()
        except EndOfData:
            return None
        self._heed_yaw_asked()
        return self.pipeline.process(block)

    def zero_yaw(self) -> None:
        """Let yaw count from where the board is: the sample read last has yaw 0 by what the next `read` gives, and
        sigma of yaw is what has grown since. May be called on any thread.

        Raises NotPossible while yaw is not relative, and before there is one.
        """
        refusal = self.stages.yaw_zero.refusal
        if refusal:
            raise NotPossible(refusal)
        self._yaw_asked = lambda: self.stages.zero_yaw()

    def undo_zero_yaw(self) -> None:
        """Let yaw count from the start again, likewise. Raises NotPossible where no zero was set."""
        if not self.stages.yaw_zero.is_set:
            raise NotPossible("yaw counts from the start: there is no zero to be undone")
        self._yaw_asked = lambda: self.stages.yaw_zero.undo()

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
        self._calibrate()
        if self._on_stream:
            self._on_stream(info)

    def _offsets_for(self, variant: Variant) -> OffsetPlan | None:
        """Find the calibration of a chip fresh from its reset, and with it what belongs in its offset registers.

        One that was asked for by name and does not fit is an error.
        """
        asked, record, note, given = self.settings.calibration, None, "", self.settings.offsets.plan()
        self.offsets = given
        path = expanded(asked.file) if asked.file else None
        if path or (asked.automatic and any_records()):
            chip = self._identity(variant)
            path = path or find_record(chip)
            try:
                record = record_for(chip, path, settings=self.settings) if path else None
                self.offsets = given or (offset_plan(record) if record else None)
            except CalibrationError as error:
                if asked.file:
                    raise
                record, note = None, f"no calibration is used: {error}"
        if record is not None:
            note = f"calibration of {record.in_words()} from {path}"
            note += ", with offsets in the chip" if record.offsets and not given else ""
            note += _of_heading(self.settings, record)
        self._found = record, path if record else None, note
        return self.offsets

    def _calibrate(self) -> None:
        """Take the calibration that was found."""
        record, path, note = self._found
        if note:
            (self._on_note or log.info)(note)
        calibration = record.calibration() if record else UNCALIBRATED
        if not self._told_magnetometer:
            self._told_magnetometer = True
            tell_uncalibrated_magnetometer(self.settings, calibration)
        if record != self.calibration:
            self.calibration, self.calibration_file = record, path
            self.stages, self.pipeline = self._built(calibration)

    def _built(
        self, calibration: ImuCalibration = UNCALIBRATED
    ) -> tuple[Pipeline, Stage[RawBlock, AttitudeBlock, PipelineState]]:
        """The pipeline, and what it was put into."""
        stages = build_pipeline(self.settings, calibration=calibration)
        return stages, self._around(stages) if self._around else stages

    def _heed_yaw_asked(self) -> None:
        asked, self._yaw_asked = self._yaw_asked, None
        if asked is None:
            return
        try:
            asked()
        except NotPossible as error:
            # It was possible when it was asked for.
            (self._on_note or log.warning)(f"yaw was left as it is: {error}")

    def identity(self, info: StreamInfo) -> ChipIdentity:
        """Which chip streams, by its factory's trim; reads some registers of it. Raises BusError."""
        return self._identity(info.variant, offsets=self.offsets)

    def _identity(self, variant: Variant, *, offsets: OffsetPlan | None = None) -> ChipIdentity:
        address = self.settings.bus.address
        chip = RegisterAccess(self.bus, address=address, clock=self.clock, health=self.health)
        return ChipIdentity(
            who_am_i=variant.who_am_i,
            name=variant.name,
            bus=self.bus.name,
            address=address,
            fingerprint=fingerprint_of(chip, variant=variant, offsets=offsets),
        )

    def __iter__(self) -> Iterator[Message]:
        return self.messages()

    def close(self) -> None:
        self.bus.close()
        if self.line is not None:
            self.line.close()


def _of_heading(settings: Settings, record: CalibrationRecord) -> str:
    """Whether the record's magnetometer gives heading, to be told behind where the record is from."""
    if not settings.magnetometer.used or record.magnetometer is None:
        return ""
    if settings.heading.calibrated:
        return "; heading is by [heading] of the settings, which goes before its magnetometer"
    return "; heading is by its magnetometer"


def record_for(chip: ChipIdentity, path: Path, *, settings: Settings) -> CalibrationRecord:
    """The calibration in this file. Raises CalibrationError, beginning with the path, where it does not fit.

    A record with offsets brings them along; those of the settings must be the same.
    """
    record, given, config = load_record(path), settings.offsets.plan(), settings.chip
    try:
        offset_plan(record)
        record.check_fits(
            chip,
            gyro_range_dps=config.gyro_range_dps,
            accel_range_g=config.accel_range_g,
            offsets=offsets_table(given) if given else record.offsets,
        )
    except CalibrationError as error:
        raise CalibrationError(f"{path}: {error}") from error
    return record


def offsets_table(plan: OffsetPlan | None) -> OffsetsTable | None:
    """Offsets as a record keeps them."""
    if plan is None:
        return None
    return OffsetsTable(
        accel_factory=plan.accel_factory, gyro_factory=plan.gyro_factory, accel=plan.accel, gyro=plan.gyro
    )


def offset_plan(record: CalibrationRecord) -> OffsetPlan | None:
    """The offsets that a record was made with, None for the factory's. Raises CalibrationError where none can be so."""
    table = record.offsets
    if table is None:
        return None
    return OffsetPlan(record.chip.who_am_i, table.accel_factory, table.gyro_factory, table.accel, table.gyro)


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
