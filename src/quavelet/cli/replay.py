"""`quavelet replay`: a recording through the same decoder, pipeline and outputs as live."""

from __future__ import annotations

import sys
from contextlib import ExitStack
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from quavelet.cli import options
from quavelet.cli.panel import LivePanel, Status
from quavelet.cli.replay_page import replay_page
from quavelet.cli.run import Stop, outcome, stopped_by_signals, talk, tell_counts
from quavelet.core.clock import MonotonicClock
from quavelet.core.errors import RecordingError
from quavelet.core.health import Health
from quavelet.loop.hub import Hub, Policy
from quavelet.pipeline import build_pipeline, tell_uncalibrated_magnetometer
from quavelet.recording.mcap import McapWriter, offset_of
from quavelet.recording.reader import RecordingReader
from quavelet.recording.replay import ReplaySource, paced
from quavelet.service.outputs import STDOUT
from quavelet.service.service import QUEUE_DEPTH
from quavelet.settings import Settings
from quavelet.sinks.json_lines import JsonLines
from quavelet.sinks.message import Message, message_of

File = Annotated[Path, typer.Argument(help="A recording made by `run --record`.", show_default=False)]
Speed = Annotated[
    float | None,
    typer.Option(help="1 as recorded, 2 twice as fast, inf without waiting [1 on a terminal, else inf].", min=1e-3),
]
Mcap = Annotated[
    Path | None,
    typer.Option(help="Write an MCAP file for Foxglove, in place of JSON lines or the panel.", show_default=False),
]
Web = Annotated[
    bool, typer.Option("--web", help="Play it on the live page: pause, seek, speed; on this machine unless [web] says.")
]


def replay(
    file: File,
    config: options.Config = None,
    json: options.Json = False,
    speed: Speed = None,
    mcap: Mcap = None,
    web: Web = False,
    port: options.Port = None,
) -> None:
    """Give the attitude of a recording, with the settings it was recorded with or those of --config.

    A calibration that was in use is used again.
    """
    if port is not None and not web:
        raise typer.BadParameter("it is that of the page: give --web too", param_hint="--port")
    if web:
        if mcap is not None:
            raise typer.BadParameter("an MCAP file is written from end to end: leave --web out", param_hint="--mcap")
        raise typer.Exit(replay_page(file, config=config, json=json, speed=speed, port=port))
    reader = RecordingReader(file)
    health = Health()
    source = ReplaySource(reader, health=health)
    settings = options.settings_of(None, None, config).settings if config else source.settings
    pipeline = build_pipeline(settings, calibration=source.calibration)
    tell_uncalibrated_magnetometer(settings, source.calibration)
    to_panel = sys.stdout.isatty() and not json and mcap is None
    if speed is None:
        speed = 1.0 if to_panel else float("inf")
    hub: Hub[Message] = Hub()
    stop = Stop()

    with ExitStack() as stack:
        if to_panel:
            status = lambda: Status(source.decoder.measured_rate_hz, health, None)  # noqa: E731
            hub.subscribe(STDOUT, stack.enter_context(LivePanel(Console(), status=status)), depth=1)
        elif json or mcap is None:
            hub.subscribe(STDOUT, JsonLines(sys.stdout.buffer), depth=QUEUE_DEPTH, policy=Policy.WAIT)
        stack.callback(hub.close)
        stack.enter_context(stopped_by_signals(stop.ask))
        converted = stack.enter_context(_converted(mcap, reader, settings)) if mcap is not None else None
        for raw in paced(source, clock=MonotonicClock(), speed=speed):
            if stop.is_asked or hub.failures():
                break
            block = pipeline.process(raw)
            if converted is not None:
                converted.write_raw(raw)
                converted.write(block)
            if len(block):
                hub.publish(message_of(block, src=f"replay:{source.info.src}"))
    tell_counts(health, source.info.src, source.decoder.measured_rate_hz)
    code = outcome(hub)
    try:
        reader.check()
    except RecordingError as error:
        # All that could be read has been given; that it is not all is still a failure.
        if not stop.is_asked and not hub.failures():
            raise
        talk(str(error))
    raise typer.Exit(code)


def _converted(path: Path, reader: RecordingReader, settings: Settings) -> McapWriter:
    header = reader.header
    about = {"src": header.stream.src, "recording": reader.path.name, "version": header.version}
    return McapWriter(path, offset_ns=offset_of(header), axes=settings.mounting.axes, about=about)
