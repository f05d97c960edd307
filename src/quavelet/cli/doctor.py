"""`quavelet doctor`: is the board there, is it good, and if not, what to do next."""

from __future__ import annotations

from typing import Annotated

import msgspec
import typer

from quavelet.bench.checkup import Finding, check_up
from quavelet.cli import exits, options
from quavelet.core.clock import Clock, MonotonicClock, VirtualClock
from quavelet.core.errors import ImuError

AsJson = Annotated[bool, typer.Option("--json", help="One JSON object a finding, a line each.")]


def doctor(
    bus: options.Bus = None,
    address: options.Address = None,
    config: options.Config = None,
    json: AsJson = False,
    virtual_time: options.VirtualTime = False,
) -> None:
    """Check the bus, the chip and five seconds of samples; leave the board lying still meanwhile."""
    settings = options.settings_of(bus, address, config).settings
    clock: Clock = VirtualClock() if options.on_virtual_time(settings, virtual_time) else MonotonicClock()
    show = _show_json if json else _show_line
    all_ok, code = True, exits.OK
    try:
        for finding in check_up(settings, clock=clock):
            show(finding)
            all_ok &= finding.ok
    except exits.OutputError:
        raise
    except ImuError as error:
        show(Finding(name="stopped", ok=False, found=type(error).__name__, advice=str(error)))
        code = exits.exit_code(error)
    if code == exits.OK and not all_ok:
        code = exits.VERDICT_FAILED
    raise typer.Exit(code)


def _show_line(finding: Finding) -> None:
    line = f"{'ok  ' if finding.ok else 'BAD '} {finding.name:<16} {finding.found}"
    exits.put(f"{line}\n{'':21}-> {finding.advice}" if finding.advice else line)


def _show_json(finding: Finding) -> None:
    exits.put(msgspec.json.encode(finding).decode())
