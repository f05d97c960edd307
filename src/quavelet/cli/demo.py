"""`quavelet demo`: the same as `run`, on a fake chip that tilts to and fro, or shows itself on the page."""

from __future__ import annotations

import typer

from quavelet.bench.session_page import CalibratePage
from quavelet.cli import options
from quavelet.cli.run import run_live, talk
from quavelet.service.service import Service
from quavelet.web.ability import Ability
from quavelet.web.faults import Faults

DEMO_BUS = "fake:tilt"
WEB_BUS = "fake:show"
BENCH_BUS = "fake:bench"


def demo(
    json: options.Json = False,
    duration: options.Duration = None,
    record: options.Record = None,
    virtual_time: options.VirtualTime = False,
    web: options.Web = False,
    port: options.Port = None,
) -> None:
    """Show what this does with no hardware at all: the fake chip, the real loop.

    With --web on a page, where faults can be injected and a calibration be watched.
    """
    bus = WEB_BUS if web else DEMO_BUS
    settings = options.settings_of(bus, None, None, web=web, port=port).settings
    talk(f"this is a fake chip ({bus}); on a Raspberry Pi try `quavelet run {'--web ' if web else ''}--bus linux:1`")
    raise typer.Exit(
        run_live(
            settings, json=json, duration_s=duration, record=record, virtual_time=virtual_time, abilities=of_a_fake
        )
    )


def of_a_fake(service: Service) -> list[Ability]:
    """What can be done from the page only where the chip is a fake."""
    return [
        Faults(
            bus=lambda: service.imu.bus if service.imu else None,
            counters=lambda: service.imu.health.as_dict() if service.imu else {},
            clock=service.clock,
        ),
        CalibratePage(bus=BENCH_BUS),
    ]
