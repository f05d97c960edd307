"""A chip, its loop, and all that takes its messages, as one object: what `quavelet run` runs, on any clock."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path
from time import monotonic_ns, time_ns

from quavelet.bus.open import open_bus, open_line
from quavelet.bus.protocol import I2CBus
from quavelet.core.clock import Clock
from quavelet.core.errors import BusError, ImuError
from quavelet.core.units import NS_PER_MS, NS_PER_S
from quavelet.core.wall_clock import WallNs, wall_going_with
from quavelet.imu import Imu
from quavelet.loop.histogram import Histogram
from quavelet.loop.hub import Hub, Policy
from quavelet.loop.others import keep_others_running
from quavelet.loop.realtime import apply_realtime
from quavelet.mpu6050.drain import Drain
from quavelet.mpu6050.stream import StreamInfo
from quavelet.recording.mcap_recorder import RotatingMcap
from quavelet.recording.recorder import RotatingRecorder
from quavelet.recording.rotation import RotationStats
from quavelet.recording.writer import RecordingWriter
from quavelet.service import host, recordings
from quavelet.service.abilities import abilities_of
from quavelet.service.continuity import Continuity, continuity_for
from quavelet.service.notify import Notify
from quavelet.service.outputs import STDOUT, Outputs
from quavelet.service.reload import Reading, changes, with_hot
from quavelet.service.status import status_of
from quavelet.service.time_of_day import TimeOfDay
from quavelet.service.watchdog import NO_SAMPLE, Watchdog
from quavelet.settings import Settings
from quavelet.settings.service import AUTO
from quavelet.sinks.mcap_file import McapFile
from quavelet.sinks.message import Message, message_of
from quavelet.sinks.status import Status
from quavelet.web.ability import Ability

QUEUE_DEPTH = 256
TRY_AGAIN_NS, LOOK_NS = 2 * NS_PER_S, 100 * NS_PER_MS
"""How often a chip that is not there is tried for, and how soon a stop is heeded meanwhile."""
TELL_AGAIN_NS = 600 * NS_PER_S
"""How often it is told that it is not there, for the same reason."""


class Service:
    """Runs the loop and its outputs; `run` does it once.

    talk says one sentence to the person; console is called once the chip has answered, to subscribe what is the
    caller's own (standard output), and gets a stack that is closed at the end, after the hubs.
    name is its own where the settings say "auto". realtime asks for the real-time settings of the loop; without it
    (virtual time) nothing is ever lost to a slow reader, the loop waits for it. notify is how systemd is told; load
    reads the settings again for a reload, off the loop; opened opens the bus; environ has the places that systemd and
    the desktop give; abilities are what can be done from the page, [web], beside those of every service. It closes them
    at the end; wall_ns is the time of day, by which nothing goes. Raises SettingsError for an output that cannot be.
    """

    def __init__(
        self,
        settings: Settings,
        *,
        clock: Clock,
        talk: Callable[[str], None],
        console: Callable[[Service, ExitStack], None] | None = None,
        record: Path | None = None,
        name: str = "imu",
        realtime: bool = True,
        notify: Notify | None = None,
        load: Callable[[], Settings] | None = None,
        opened: Callable[[str, Clock], I2CBus] | None = None,
        environ: Mapping[str, str] | None = None,
        abilities: Sequence[Ability] = (),
        wall_ns: WallNs | None = None,
    ) -> None:
        self.settings = settings
        self.name = name if settings.service.name == AUTO else settings.service.name
        self.clock = clock
        self.abilities = list(abilities)
        wall_ns = wall_ns or (time_ns if realtime else wall_going_with(clock))
        asleep_ns = host.asleep_ns if realtime else int
        self.time_of_day = TimeOfDay(wall_ns, clock=clock, asleep_ns=asleep_ns, talk=self.talk)
        self._talk = talk
        self.record = record
        self.imu: Imu | None = None
        self.last: Message | None = None
        self.messages: Hub[Message] = Hub()
        self.records: Hub[StreamInfo | Drain] = Hub()
        self.policy = Policy.LOSE_OLDEST if realtime else Policy.WAIT
        self.watchdog = Watchdog(notify or Notify(), clock=clock)
        self._environ = environ or {}
        self.abilities += abilities_of(self, environ=self._environ)
        self._began_ns = monotonic_ns()
        self._read_ns = 0
        self.outputs = Outputs(
            settings,
            name=self.name,
            messages=self.messages,
            clock=clock,
            offset_ns=self.time_of_day.offset_ns,
            talk=talk,
            status=self.status,
            environ=self._environ,
            virtual=not realtime,
            abilities=self.abilities,
            lateness=lambda: self.imu.loop.lateness if self.imu else Histogram(),
        )
        self.continuity: Continuity | None = None
        self._load = load
        self._opened = opened or (lambda name, clock: open_bus(name, clock=clock))
        self._console = console
        self._realtime = realtime
        self.recorder: RotatingRecorder | RotatingMcap | None = None
        self._writer: RecordingWriter | None = None
        self._stopped = False
        self._is_punctual = False
        self._threads_begun = False
        self._reload_asked = False
        self._reading: Reading | None = None
        self._missing = "", 0
        self._begun = False

    @property
    def streamed(self) -> bool:
        """Whether the chip ever gave samples."""
        return self.imu is not None and self.imu.source.info is not None

    @property
    def state(self) -> str:
        """ "waiting for the chip", "settling", "running", or "lost: ..."."""
        return self.watchdog.state

    def stop(self) -> None:
        """End the run in good order; safe from a signal handler and from another thread."""
        self._stopped = True
        if self.imu is not None:
            self.imu.loop.stop()

    def reload(self) -> None:
        """Read the settings again, and put in force what can be; safe from a signal handler."""
        self._reload_asked = True

    def threads_begun(self) -> None:
        """Something has begun a thread, which is to be kept running as the others are; safe from any thread."""
        self._threads_begun = True

    def asked_by(self, recorder: RotatingRecorder) -> RotatingRecorder:
        """The recorder, that asks this service for what it has to know."""
        recorder.calibration = self._calibration_text
        recorder.current_stream = lambda: self.imu.source.info if self.imu else None
        return recorder

    def run(self, *, until_ns: int | None = None) -> None:
        """Until `until_ns` of the clock, for ever where it is None, or `stop`, or the end of standard output.

        Raises ImuError: what `open_bus`, `RecordingWriter` and `ChipSource` raise; no BusError while the chip is
        waited for.
        """
        try:
            with ExitStack() as stack:
                # Before the chip is there, for they can say so; they end with the hub.
                for ability in self.abilities:
                    stack.callback(ability.close)
                self.outputs.open()
                stack.callback(self.messages.close)
                self._open_recording(stack)
                self._open_state_file(stack)
                while not self._attempt(stack, until_ns):
                    self._wait_for_chip(until_ns)
                self.watchdog.stopping()
        except ImuError as error:
            self.watchdog.stopping(str(error))
            raise
        finally:
            if self._writer is not None and not self.streamed:
                # Nothing is in it, and the next try would be refused for it.
                self._writer.path.unlink(missing_ok=True)

    def _attempt(self, stack: ExitStack, until_ns: int | None) -> bool:
        """Run with the chip, if it is there; False where it is not and is to be tried for again."""
        try:
            with ExitStack() as wires:
                self._run_with(self._open_chip(wires), stack, until_ns)
                return True
        except BusError as error:
            if self.streamed or not self.settings.service.wait_for_device:
                raise
            self._tell_missing(str(error))
            return self._over(until_ns)

    def _run_with(self, imu: Imu, stack: ExitStack, until_ns: int | None) -> None:
        if not self._begun:
            self._begun = True
            if self._console is not None:
                self._console(self, stack)
            # Once more: what the console subscribed must be through before its own things end.
            stack.callback(self.messages.close)
            if self._realtime:
                self._be_punctual(stack)
        for _ in imu.loop.deadlines(until_ns):
            block = imu.read()
            if block is None:
                return
            message = message_of(block, src=imu.bus.name) if len(block) else None
            if message is not None:
                self.last = message
                self.outputs.drained(message, self._read_ns)
                self.messages.publish(message)
                if self.continuity is not None:
                    self.continuity.keep(message)
                if STDOUT in self.messages.failures():
                    return
                self._tell_found(imu)
            self.watchdog.tick(message, self._words)
            if self.continuity is not None and self.watchdog.state == NO_SAMPLE:
                self.continuity.lost()
            self.time_of_day.look()
            self._heed_reload()
            self._heed_threads()

    def _words(self) -> str:
        """The attitude and how the samples come, for a status line."""
        if self.imu is None or self.last is None:
            return ""
        m, rate_hz, lost = self.last, self.imu.measured_rate_hz, self.imu.health.samples_lost
        angles = f"roll {m.roll_deg:.1f}, pitch {m.pitch_deg:.1f}, yaw {m.yaw_deg:.1f} deg ({m.yaw}) on {m.src}"
        return f"{angles}, {'rate not measured' if rate_hz is None else f'{rate_hz:.1f} samples/s'}, {lost} lost"

    def _over(self, until_ns: int | None) -> bool:
        return self._stopped or (until_ns is not None and self.clock.now_ns() >= until_ns)

    def _wait_for_chip(self, until_ns: int | None) -> None:
        """In short steps, so that a stop is heeded."""
        again_ns = self.clock.now_ns() + TRY_AGAIN_NS
        while self.clock.now_ns() < again_ns and not self._over(until_ns):
            self.clock.sleep_until_ns(min(self.clock.now_ns() + LOOK_NS, again_ns))
            self.time_of_day.look()
            self._heed_reload()

    def _tell_missing(self, reason: str) -> None:
        now_ns = self.clock.now_ns()
        self.watchdog.waiting(reason)
        told, told_ns = self._missing
        if reason != told or now_ns - told_ns >= TELL_AGAIN_NS:
            self._missing = reason, now_ns
            self.talk(f"{reason}; it is tried again every {TRY_AGAIN_NS // NS_PER_S} s")

    def _tell_found(self, imu: Imu) -> None:
        if self._missing[0]:
            self._missing = "", 0
            self.talk(f"the chip on {imu.bus.name} gives samples")

    def _heed_threads(self) -> None:
        if self._threads_begun:
            self._threads_begun = False
            if self._is_punctual:
                keep_others_running()

    def _heed_reload(self) -> None:
        """One step of what was asked for; the reading itself is done on another thread."""
        if self._reading is None:
            if self._reload_asked and self._load is not None:
                self._reload_asked = False
                self.watchdog.reloading()
                self._reading = Reading(self._load)
                if not self._realtime:
                    self._reading.join()
            return
        read = self._reading.result
        if read is not None:
            self._reading = None
            self.watchdog.reloaded(self._take(read))

    def _take(self, read: Settings | ImuError) -> str:
        """Put in force what can be; what is to stay in the status is returned."""
        try:
            if isinstance(read, ImuError):
                raise read
            found, merged = changes(self.settings, read), with_hot(self.settings, read)
            if found.hot:
                self.outputs.change(merged)
                if self._is_punctual:
                    keep_others_running()
            self.settings = merged
        except ImuError as error:
            refused = f"the settings are refused, the old ones stay in force: {error}"
            self.talk(refused)
            return refused
        self.talk(found.in_words())
        return found.in_words() if found.restart else ""

    def talk(self, text: str) -> None:
        """Say one sentence to the person, and to who looks at the page."""
        self._talk(text)
        self.outputs.tell(text)

    def status(self) -> Status:
        """All that is known of it at this moment; may be called on any thread."""
        return status_of(
            self.imu,
            settings=self.settings,
            name=self.name,
            state=self.state,
            message=self.last,
            latency=self.outputs.latency,
            outputs=self.outputs.statuses(),
            recording=recordings.status_of(stats) if (stats := self.recording_stats()) else None,
            page=self.outputs.page.viewers.status() if self.outputs.page else None,
            began_ns=self._began_ns,
            clock=self.time_of_day.status(),
            environ=self._environ,
        )

    def recording_stats(self) -> RotationStats | None:
        """What became of [recording]; None where none is wanted."""
        return recordings.stats_of(self.recorder, self.messages) if self.recorder else None

    def _on_drain(self, drain: Drain) -> None:
        self._read_ns = self.clock.now_ns()
        self.records.publish(drain)

    def _open_state_file(self, stack: ExitStack) -> None:
        self.continuity = continuity_for(
            self.settings,
            name=self.name,
            environ=self._environ,
            clock=self.clock,
            talk=self.talk,
            asleep_ns=host.asleep_ns if self._realtime else int,
            policy=self.policy,
        )
        if self.continuity is not None:
            stack.enter_context(self.continuity)

    def _open_recording(self, stack: ExitStack) -> None:
        settings = self.settings
        if self.record is not None:
            self._writer = RecordingWriter(
                self.record,
                settings=settings,
                clock=self.clock,
                fsync_s=settings.recording.fsync_s,
                offset_ns=self.time_of_day.offset_ns,
            )
            self._writer.calibration = self._calibration_text
            self.records.subscribe("recording", self._writer, depth=recordings.DEPTH, policy=self.policy)
        self.recorder = recordings.recorder_for(
            settings, name=self.name, clock=self.clock, time_of_day=self.time_of_day, tell=self.talk
        )
        if isinstance(self.recorder, RotatingMcap):
            sink = McapFile(self.recorder)
            self.messages.subscribe(recordings.NAME, sink, depth=recordings.DEPTH, policy=self.policy)
        elif self.recorder is not None:
            self.records.subscribe(
                recordings.NAME, self.asked_by(self.recorder), depth=recordings.DEPTH, policy=self.policy
            )
        stack.callback(self.records.close)

    def _open_chip(self, wires: ExitStack) -> Imu:
        """The chip, asked who it is before anything else is set or said."""
        settings = self.settings
        i2c = wires.enter_context(self._opened(settings.bus.name, self.clock))
        line = open_line(settings.bus.int_line, bus=i2c, address=settings.bus.address)
        if line is not None:
            wires.enter_context(line)
        self.imu = Imu(
            i2c,
            settings=settings,
            clock=self.clock,
            line=line,
            around=self.continuity.around if self.continuity else None,
            on_stream=self.records.publish,
            on_drain=self._on_drain,
            on_note=self.talk,
        )
        if self.continuity is not None:
            self.continuity.attach(self.imu)
        if self._stopped:
            self.imu.loop.stop()
        self.imu.read()
        return self.imu

    def _calibration_text(self) -> str:
        return self.imu.calibration_text if self.imu else ""

    def _be_punctual(self, stack: ExitStack) -> None:
        report = stack.enter_context(apply_realtime(self.settings.loop)).report
        self._is_punctual = any(setting.name == "priority" and setting.done for setting in report)
        for setting in (*report, keep_others_running()) if self._is_punctual else report:
            self.talk(f"{setting.name}: {'done' if setting.done else 'refused'}, {setting.detail}")
