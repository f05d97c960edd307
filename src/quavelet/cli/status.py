"""`quavelet status` and `quavelet watch`: ask the service that runs on this machine."""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated

import msgspec
import typer
from rich.console import Console

from quavelet.cli import exits, options
from quavelet.cli import panel as live
from quavelet.cli.status_words import health_of, in_words
from quavelet.core.health import Health
from quavelet.sinks.asking import AskError, ask_status, decode_status, find_socket, watch
from quavelet.sinks.message import Message

Which = Annotated[
    str | None,
    typer.Argument(metavar="[NAME|PATH]", help="Which service, by name or its socket's path; none: the only one."),
]
AsJson = Annotated[bool, typer.Option("--json", help="As JSON, for programs.")]
Rate = Annotated[float | None, typer.Option("--rate", help="At most so many messages a second.", min=0.001, max=1000)]
PANEL_HZ = 10.0
ASK_AGAIN_S = 1.0


def show_status(service: Which = None, json: AsJson = False) -> None:
    """Ask the running service how it is: the attitude, what was lost, how late, and what each output does."""
    path = find_socket(service, environ=os.environ)
    answer = ask_status(path)
    if json:
        exits.put(answer.decode("utf-8").rstrip("\n"))
        return
    for line in in_words(decode_status(path, answer)):
        exits.put(line)


def show_messages(service: Which = None, json: options.Json = False, rate: Rate = None) -> None:
    """The running service's messages: a live panel on a terminal, JSON lines when piped or with --json."""
    path = find_socket(service, environ=os.environ)
    if json or not sys.stdout.isatty():
        for line in watch(path, hz=rate):
            exits.put(line.decode("utf-8").rstrip("\n"))
    else:
        with live.LivePanel(Console(), status=_Asked(path)) as panel:
            for message in _messages(watch(path, hz=rate or PANEL_HZ)):
                panel.write(message)
    raise AskError(f"{path}: the service has ended")


def _messages(lines: Iterator[bytes]) -> Iterator[Message]:
    for line in lines:
        try:
            yield msgspec.json.decode(line, type=Message)
        except msgspec.DecodeError as error:
            raise AskError(f"the answer is not that of a service: {error}") from error


class _Asked:
    """The panel's own figures, asked for at most once a second."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._asked_s = -ASK_AGAIN_S
        self._last = live.Status(None, Health(), None)

    def __call__(self) -> live.Status:
        now_s = time.monotonic()
        if now_s - self._asked_s >= ASK_AGAIN_S:
            self._asked_s = now_s
            status = decode_status(self._path, ask_status(self._path))
            self._last = live.Status(status.rate_hz, health_of(status), status.loop)
        return self._last
