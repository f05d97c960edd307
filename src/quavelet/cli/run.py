"""`quavelet run`: the attitude, live, to a panel on a terminal or as JSON lines."""

from __future__ import annotations

import faulthandler
import os
import signal
import stat
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from importlib.metadata import version
from math import isinf
from pathlib import Path
from types import FrameType

import typer
from rich.console import Console

from quavelet.cli import exits, options
from quavelet.cli.counts import in_words
from quavelet.cli.panel import LivePanel, Status
from quavelet.core.clock import Clock, MonotonicClock, VirtualClock
from quavelet.core.errors import ImuError
from quavelet.core.health import Health
from quavelet.core.units import NS_PER_MS, NS_PER_S
from quavelet.loop.deadline import LoopStats
from quavelet.loop.hub import Hub
from quavelet.mpu6050.drain import Drain
from quavelet.mpu6050.stream import StreamInfo
from quavelet.recording.mcap import McapWriter
from quavelet.service import recordings
from quavelet.service.notify import Notify
from quavelet.service.outputs import STDOUT
from quavelet.service.service import QUEUE_DEPTH, Service
from quavelet.settings import Settings
from quavelet.settings.service import NAME
from quavelet.sinks.mcap_file import McapFile
from quavelet.sinks.message import Message
from quavelet.web.ability import Ability

MCAP = "mcap"


def run(
    bus: options.Bus = None,
    address: options.Address = None,
    accept_id: options.AcceptId = None,
    config: options.Config = None,
    json: options.Json = False,
    duration: options.Duration = None,
    record: options.Record = None,
    mcap: options.Mcap = None,
    wait_for_device: options.WaitForDevice = False,
    virtual_time: options.VirtualTime = False,
    web: options.Web = False,
    port: options.Port = None,
) -> None:
    """Give the attitude until stopped: a live panel on a terminal, JSON lines when piped or with --json."""

    def load() -> Settings:
        return options.settings_of(
            bus, address, config, accept_id, wait_for_device=wait_for_device, web=web, port=port
        ).settings

    again = load if config else None
    name = config.stem if config and NAME.fullmatch(config.stem) else "imu"
    raise typer.Exit(
        run_live(
            load(),
            json=json,
            duration_s=duration,
            record=record,
            mcap=mcap,
            virtual_time=virtual_time,
            load=again,
            name=name,
        )
    )


def run_live(
    settings: Settings,
    *,
    json: bool,
    duration_s: float | None,
    record: Path | None,
    virtual_time: bool,
    mcap: Path | None = None,
    load: Callable[[], Settings] | None = None,
    name: str = "imu",
    abilities: Callable[[Service], Sequence[Ability]] = lambda _service: (),
) -> int:
    """Run the service and tell what came of it; returns the exit code. Raises ImuError.

    load reads the settings again on SIGHUP; on a terminal that signal ends the program, as its window was closed.
    abilities are those of the page, beside the service's own.
    """
    for warning in settings.chip.warnings():
        talk(f"note: {warning}")
    virtual_time = options.on_virtual_time(settings, virtual_time)
    clock: Clock = VirtualClock() if virtual_time else MonotonicClock()
    service = Service(
        settings,
        clock=clock,
        talk=talk,
        console=lambda service, stack: _subscribe_outputs(service, stack, json=json, mcap=mcap),
        record=record,
        name=name,
        realtime=not virtual_time,
        notify=Notify.from_environment(os.environ, talk=talk),
        load=load,
        environ=os.environ,
    )
    service.abilities += abilities(service)
    if service.watchdog.wanted:
        # What hung when the watchdog ended it (SIGABRT) stands in the journal.
        faulthandler.enable()
    if load is not None and not sys.stdout.isatty():
        signal.signal(signal.SIGHUP, lambda *_: service.reload())
    failure: ImuError | None = None
    with stopped_by_signals(service.stop):
        try:
            service.run(until_ns=_until_ns(clock, duration_s))
        except ImuError as error:
            failure = error
    if failure is not None and not service.streamed:
        raise failure
    code = max(_tell_ending(service), _recording_outcome(service.records, record) if record else exits.OK)
    if MCAP in (failures := service.messages.failures()):
        talk(f"the MCAP file is not complete: {failures[MCAP]}")
        code = exits.FAILED
    if failure is not None:
        raise failure
    return code


def _until_ns(clock: Clock, duration_s: float | None) -> int | None:
    """When to stop by `clock`; None for never, as infinity says too."""
    if duration_s is None or isinf(duration_s):
        return None
    return clock.now_ns() + round(duration_s * NS_PER_S)


def talk(text: str) -> None:
    """Say something to the person, on stderr."""
    for line in text.splitlines():
        print(f"quavelet: {line}", file=sys.stderr)


class Stop:
    """Whether it was asked for. No lock is in it, which a signal's handler could find held by what it interrupts."""

    def __init__(self) -> None:
        self.is_asked = False

    def ask(self) -> None:
        self.is_asked = True


@contextmanager
def stopped_by_signals(stop: Callable[[], None]) -> Iterator[None]:
    """Ctrl-C and SIGTERM end the loop in good order, once; a second one ends the program at once."""

    def handler(number: int, frame: FrameType | None) -> None:
        del frame
        signal.signal(number, signal.SIG_DFL)
        stop()

    before = {number: signal.signal(number, handler) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield
    finally:
        for number, old in before.items():
            signal.signal(number, old)


def _subscribe_outputs(service: Service, stack: ExitStack, *, json: bool, mcap: Path | None) -> None:
    if mcap is not None:
        offset_ns, axes = service.time_of_day.offset_ns(), service.settings.mounting.axes
        about = {"src": service.settings.bus.name, "version": version("quavelet")}
        writer = McapWriter(mcap, offset_ns=offset_ns, axes=axes, about=about)
        service.messages.subscribe(MCAP, McapFile(writer), depth=QUEUE_DEPTH, policy=service.policy)
    _subscribe_output(service, stack, json=json)


def _subscribe_output(service: Service, stack: ExitStack, *, json: bool) -> None:
    if _goes_nowhere(sys.stdout.fileno()):
        return
    if json or not sys.stdout.isatty():
        sink = service.outputs.stdout(sys.stdout.buffer)
        service.messages.subscribe(STDOUT, sink, depth=QUEUE_DEPTH, policy=service.policy)
        return

    def status() -> Status:
        imu = service.imu
        assert imu is not None, "the chip has answered"
        return Status(imu.measured_rate_hz, imu.health, imu.loop.stats)

    panel = stack.enter_context(LivePanel(Console(), status=status))
    # A panel shows the newest; it never needs a queue.
    service.messages.subscribe(STDOUT, panel, depth=1)


def _goes_nowhere(descriptor: int) -> bool:
    """Whether it is /dev/null, as in the unit: a hundred lines a second need not be made for that."""
    device = os.fstat(descriptor)
    return stat.S_ISCHR(device.st_mode) and device.st_rdev == Path(os.devnull).stat().st_rdev


def _tell_ending(service: Service) -> int:
    """All counts, and the exit code for what became of standard output."""
    imu = service.imu
    if imu is None:
        return exits.OK
    tell_counts(imu.health, imu.bus.name, imu.measured_rate_hz)
    _tell_loop(imu.loop.stats)
    _tell_lost(service.messages)
    if (stats := service.recording_stats()) is not None:
        talk(recordings.in_words(stats))
    return outcome(service.messages)


def tell_counts(health: Health, src: str, rate_hz: float | None) -> None:
    """What came, what was lost, and all that happened to it, on stderr."""
    rate = "sample rate not measured" if rate_hz is None else f"{rate_hz:.3f} samples/s measured"
    talk(f"{health.samples} samples from {src}, {health.samples_lost} lost in {health.gaps} gaps, {rate}")
    for line in in_words(health):
        talk(line)


def outcome(messages: Hub[Message]) -> int:
    """The exit code for what became of standard output."""
    failure = messages.failures().get(STDOUT)
    if failure is None:
        return exits.OK
    exits.forget_stdout()
    if isinstance(failure, BrokenPipeError):
        return exits.OK
    talk(f"standard output failed: {failure}")
    return exits.FAILED


def _tell_loop(loop: LoopStats) -> None:
    talk(
        f"loop: {loop.ticks} ticks, {loop.missed} missed, late {loop.lateness_p50_ns / NS_PER_MS:.3f} ms p50, "
        f"{loop.lateness_p99_ns / NS_PER_MS:.3f} ms p99, {loop.lateness_max_ns / NS_PER_MS:.3f} ms at most"
    )


def _tell_lost(messages: Hub[Message]) -> None:
    for stats in messages.stats():
        # A panel shows the newest only: what it did not show is not lost to anyone.
        if stats.lost and not stats.failed and not sys.stdout.isatty():
            talk(f"{stats.name}: {stats.lost} messages lost to a slow reader, {stats.delivered} delivered")


def _recording_outcome(records: Hub[StreamInfo | Drain], path: Path) -> int:
    stats = next(stats for stats in records.stats() if stats.name == "recording")
    broken = records.failures().get(stats.name)
    if broken is not None:
        talk(f"the recording is not complete: {broken}")
    elif stats.lost:
        talk(f"{path} has holes, the disk was too slow for {stats.lost} drains: each is marked as a gap on replay")
    else:
        return exits.OK
    return exits.FAILED
