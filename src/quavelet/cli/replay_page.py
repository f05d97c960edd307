"""`quavelet replay --web`: a recording on the live page, until stopped."""

from __future__ import annotations

import os
import sys
from functools import partial
from importlib.metadata import version
from pathlib import Path

import typer

from quavelet.cli import exits, options
from quavelet.cli.run import Stop, outcome, stopped_by_signals, talk, tell_counts
from quavelet.core.clock import MonotonicClock
from quavelet.core.health import Health
from quavelet.core.units import NS_PER_MS
from quavelet.loop.deadline import NO_LOOP
from quavelet.loop.hub import Hub, Policy
from quavelet.pipeline import build_pipeline, tell_uncalibrated_magnetometer
from quavelet.recording.mcap import offset_of
from quavelet.recording.player import Player
from quavelet.recording.reader import RecordingReader
from quavelet.recording.replay import ReplaySource
from quavelet.service.outputs import NETWORK, STDOUT
from quavelet.service.service import QUEUE_DEPTH
from quavelet.service.status import memory_mb
from quavelet.sinks.json_lines import JsonLines
from quavelet.sinks.message import Message
from quavelet.sinks.network import DEPTH, Network
from quavelet.sinks.status import ClockStatus, Status
from quavelet.web.page import WebPage
from quavelet.web.playing import Playing

NAME = "replay"
LOOK_NS = 100 * NS_PER_MS


def replay_page(file: Path, *, config: Path | None, json: bool, speed: float | None, port: int | None) -> int:
    """Play it to whoever looks at the page, and with `json` to stdout too, what is sought included; the exit code."""
    given = options.settings_of(None, None, config, web=True, port=port).settings
    reader = RecordingReader(file)
    source = ReplaySource(reader, health=Health())
    settings, calibration = given if config else source.settings, source.calibration
    tell_uncalibrated_magnetometer(settings, calibration)
    clock, hub = MonotonicClock(), Hub[Message]()
    player = Player(file, make_pipeline=partial(build_pipeline, settings, calibration=calibration), clock=clock)
    if speed is not None:
        try:
            player.set_speed(speed)
        except ValueError as error:
            raise typer.BadParameter(str(error), param_hint="--speed") from error
    playing = Playing(player, publish=hub.publish, clock=clock)
    player.give = playing.give
    page = WebPage(
        given.web,
        src=f"replay:{source.info.src}",
        name=NAME,
        status=partial(_status, player, playing, ClockStatus(offset_ns=offset_of(reader.header))),
        abilities=(playing,),
        talk=talk,
        clock=clock,
        environ=os.environ,
    )
    stop = Stop()

    # Nothing is lost on the way to the page: a player can wait.
    network = Network(talk=talk, clock=clock, wait_for_room=True)
    network.start()
    hub.subscribe(NETWORK, network, depth=DEPTH, policy=Policy.WAIT)
    if json:
        hub.subscribe(STDOUT, JsonLines(sys.stdout.buffer), depth=QUEUE_DEPTH, policy=Policy.WAIT)
    told = ""
    with stopped_by_signals(stop.ask):
        network.add(page)
        player.start()
        while not (stop.is_asked or hub.failures() or player.failure):
            clock.sleep_until_ns(clock.now_ns() + LOOK_NS)
            if (says := player.state().says) and says != told:
                told = says
                talk(says)
                page.tell(says)
        # The hub first: a player that waits for room in it is let go.
        hub.close()
        playing.close()
    tell_counts(player.health, player.info.src, player.measured_rate_hz)
    return exits.FAILED if player.failure else outcome(hub)


def _status(player: Player, playing: Playing, clock: ClockStatus) -> Status:
    """How it is where it plays: of a chip that runs, since the recording began."""
    info, message = player.info, playing.latest
    return Status(
        name=NAME,
        src=f"replay:{info.src}",
        fake=info.src.startswith("fake:"),
        chip=info.variant.name,
        address=info.address,
        version=version("quavelet"),
        uptime_s=round(player.state().t_s, 3),
        state="running" if message else "settling",
        message=message,
        rate_hz=player.measured_rate_hz,
        health=player.health.as_dict(),
        loop=NO_LOOP,
        clock=clock,
        pid=os.getpid(),
        memory_mb=memory_mb(),
    )
