"""A chip, its loop, and all that takes its messages, as one object: what `quavelet run` runs, on any clock."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path

from quavelet.bus.open import open_bus, open_line
from quavelet.core.clock import Clock
from quavelet.core.errors import ImuError
from quavelet.imu import Imu
from quavelet.loop.hub import Hub, Policy
from quavelet.loop.realtime import apply_realtime
from quavelet.mpu6050.drain import Drain
from quavelet.mpu6050.stream import StreamInfo
from quavelet.recording.rotation import RotatingRecorder
from quavelet.recording.writer import RecordingWriter
from quavelet.service import recordings
from quavelet.settings import Settings
from quavelet.settings.service import AUTO
from quavelet.sinks.message import Message

QUEUE_DEPTH = 256
STDOUT = "stdout"
"""The subscriber whose end is the end of the service: nobody reads any more."""


class Service:
    """Runs the loop and its outputs; `run` does it once.

    talk says one sentence to the person; console is called once the chip has answered, to subscribe what is the
    caller's own (standard output), and gets a stack that is closed at the end, after the hubs.
    realtime asks for the real-time settings of the loop; without it (virtual time) nothing is ever lost to a slow
    reader, the loop waits for it.
    """

    def __init__(
        self,
        settings: Settings,
        *,
        clock: Clock,
        talk: Callable[[str], None],
        console: Callable[[Service, ExitStack], None] | None = None,
        record: Path | None = None,
        realtime: bool = True,
    ) -> None:
        self.settings = settings
        self.clock = clock
        self.talk = talk
        self.record = record
        self.imu: Imu | None = None
        self.messages: Hub[Message] = Hub()
        self.records: Hub[StreamInfo | Drain] = Hub()
        self.policy = Policy.LOSE_OLDEST if realtime else Policy.WAIT
        self._console = console
        self._realtime = realtime
        self.recorder: RotatingRecorder | None = None
        self._writer: RecordingWriter | None = None
        self._stopped = False

    @property
    def streamed(self) -> bool:
        """Whether the chip ever gave samples."""
        return self.imu is not None and self.imu.source.info is not None

    def stop(self) -> None:
        """End the run in good order; safe from a signal handler and from another thread."""
        self._stopped = True
        if self.imu is not None:
            self.imu.loop.stop()

    def run(self, *, until_ns: int | None = None) -> None:
        """Until `until_ns` of the clock, for ever where it is None, or `stop`, or the end of standard output.

        Raises ImuError: what `open_bus`, `RecordingWriter` and `ChipSource` raise.
        """
        try:
            with ExitStack() as stack:
                self._open_outputs(stack)
                imu = self._open_chip(stack)
                if self._console is not None:
                    self._console(self, stack)
                stack.callback(self.messages.close)
                if self._realtime:
                    self._be_punctual(stack)
                for message in imu.messages(until_ns=until_ns):
                    self.messages.publish(message)
                    if STDOUT in self.messages.failures():
                        break
        except ImuError:
            if self._writer is not None and not self.streamed:
                # Nothing is in it, and the next try would be refused for it.
                self._writer.path.unlink(missing_ok=True)
            raise

    def _open_outputs(self, stack: ExitStack) -> None:
        """The outputs, the control socket and the status: begun before the chip is there, for they can say so, and
        ended through the stack after the last message."""

    def _open_chip(self, stack: ExitStack) -> Imu:
        """The chip, asked who it is before anything else is set or said."""
        settings = self.settings
        i2c = stack.enter_context(open_bus(settings.bus.name, clock=self.clock))
        line = open_line(settings.bus.int_line, bus=i2c, address=settings.bus.address)
        if line is not None:
            stack.enter_context(line)
        if self.record is not None:
            self._writer = RecordingWriter(
                self.record, settings=settings, clock=self.clock, fsync_s=settings.recording.fsync_s
            )
            self._writer.calibration = self._calibration_text
            self.records.subscribe("recording", self._writer, depth=recordings.DEPTH, policy=self.policy)
        name = "imu" if settings.service.name == AUTO else settings.service.name
        self.recorder = recordings.recorder_for(settings, name=name, clock=self.clock, tell=self.talk)
        if self.recorder is not None:
            self.recorder.calibration = self._calibration_text
            self.recorder.current_stream = lambda: self.imu.source.info if self.imu else None
            self.records.subscribe("recordings", self.recorder, depth=recordings.DEPTH, policy=self.policy)
        stack.callback(self.records.close)
        self.imu = Imu(
            i2c,
            settings=settings,
            clock=self.clock,
            line=line,
            on_stream=self.records.publish,
            on_drain=self.records.publish,
            on_note=self.talk,
        )
        if self._stopped:
            self.imu.loop.stop()
        self.imu.read()
        return self.imu

    def _calibration_text(self) -> str:
        return self.imu.calibration_text if self.imu else ""

    def _be_punctual(self, stack: ExitStack) -> None:
        realtime = stack.enter_context(apply_realtime(self.settings.loop))
        for setting in realtime.report:
            self.talk(f"{setting.name}: {'done' if setting.done else 'refused'}, {setting.detail}")
