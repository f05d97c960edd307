"""`quavelet demo`: the same as `run`, on a fake chip that tilts to and fro."""

from __future__ import annotations

import typer

from quavelet.cli import options
from quavelet.cli.run import run_live, talk

DEMO_BUS = "fake:tilt"


def demo(
    json: options.Json = False,
    duration: options.Duration = None,
    record: options.Record = None,
    virtual_time: options.VirtualTime = False,
    web: options.Web = False,
    port: options.Port = None,
) -> None:
    """Show what this does with no hardware at all: the fake chip, the real loop."""
    settings = options.settings_of(DEMO_BUS, None, None, web=web, port=port).settings
    talk(f"this is a fake chip ({DEMO_BUS}); on a Raspberry Pi try `quavelet run --bus linux:1`")
    raise typer.Exit(run_live(settings, json=json, duration_s=duration, record=record, virtual_time=virtual_time))
