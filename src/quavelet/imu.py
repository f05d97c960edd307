"""The chip and its pipeline as one thing: what the commands run and what a program imports."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path

from quavelet.bus.open import open_bus, open_line
from quavelet.bus.protocol import DataReady, I2CBus
from quavelet.core.blocks import AttitudeBlock
from quavelet.core.clock import Clock, MonotonicClock
from quavelet.core.closing import Closing
from quavelet.core.errors import EndOfData
from quavelet.core.health import Health
from quavelet.core.units import NS_PER_S
from quavelet.loop.deadline import FixedStepLoop
from quavelet.mpu6050.drain import Drain
from quavelet.mpu6050.source import ChipSource
from quavelet.mpu6050.stream import StreamInfo
from quavelet.pipeline import build_pipeline
from quavelet.settings import Settings, load_settings
from quavelet.sinks.message import Message, message_of


class Imu(Closing):
    """A chip on an open bus. Iterating gives a `Message` at each deadline of the loop that has new samples.

    line is the open wire from its INT pin, None where there is none; closing closes both.
    on_stream and on_drain are told what a recording needs (see `ChipSource`).
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
    ) -> None:
        self.bus = bus
        self.line = line
        self.settings = settings
        self.clock = clock
        self.health = Health()
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
            on_stream=on_stream,
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

    def __iter__(self) -> Iterator[Message]:
        return self.messages()

    def close(self) -> None:
        self.bus.close()
        if self.line is not None:
            self.line.close()


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
