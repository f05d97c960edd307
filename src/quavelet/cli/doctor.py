"""`quavelet doctor`: is the board there, is it good, and if not, what to do next."""

from __future__ import annotations

import shutil
import sys
import textwrap
from functools import partial
from typing import Annotated

import msgspec
import typer

from quavelet.bench.checkup import CheckUp
from quavelet.bench.finding import Finding
from quavelet.cli import exits, options
from quavelet.core.clock import Clock, MonotonicClock, VirtualClock
from quavelet.settings import Settings

AsJson = Annotated[bool, typer.Option("--json", help="One JSON object a finding, a line each.")]
INDENT = 25


def doctor(
    bus: options.Bus = None,
    address: options.Address = None,
    accept_id: options.AcceptId = None,
    config: options.Config = None,
    json: AsJson = False,
    virtual_time: options.VirtualTime = False,
) -> None:
    """Check the machine, the wires, the chip and its sensors; leave the board lying still meanwhile.

    Takes seven seconds. The chip is reset: stop whatever else reads it.
    """
    settings = options.settings_of(bus, address, config, accept_id).settings
    clock: Clock = VirtualClock() if options.on_virtual_time(settings, virtual_time) else MonotonicClock()
    show = _show_json if json else show_lines
    check = CheckUp(settings, clock=clock, waiting=_wait)
    bad: list[Finding] = []
    looked = 0
    for finding in check.findings():
        show(finding)
        looked += 1
        if not finding.ok:
            bad.append(finding)
    show(_verdict(settings, looked, bad))
    raise typer.Exit(exits.exit_code(check.error) if check.error else exits.VERDICT_FAILED if bad else exits.OK)


def _verdict(settings: Settings, looked: int, bad: list[Finding]) -> Finding:
    fake = " (a fake chip: NOT A REAL ONE)" if settings.bus.name.startswith("fake:") else ""
    if not bad:
        found = f"all is well in {looked} points{fake}; next: quavelet run --bus {settings.bus.name}"
        address = settings.bus.address
        return Finding(
            name="verdict", ok=True, found=found + (f" --address 0x{address:02x}" if address != 0x68 else "")
        )
    more = " first, since each point builds on those above it" if len(bad) > 1 else ""
    return Finding(
        name="verdict",
        ok=False,
        found=f"not well in {len(bad)} of {looked} points{fake}: {', '.join(finding.name for finding in bad)}",
        advice=f"do what stands under '{bad[0].name}'{more}, and run this again",
    )


def _wait(text: str) -> None:
    if sys.stderr.isatty():
        print(f"     ({text})", file=sys.stderr)


def show_lines(finding: Finding) -> None:
    """A finding and its advice on stdout."""
    to_terminal = sys.stdout.isatty()
    mark, colour = ("BAD ", "red") if not finding.ok else ("note", "yellow") if finding.advice else ("ok  ", "green")
    # In a file or a pipe each finding and each advice is a line, for grep.
    width = max(INDENT + 20, min(120, shutil.get_terminal_size().columns)) if to_terminal else 10_000
    wrap = partial(textwrap.wrap, break_on_hyphens=False, break_long_words=False)
    lines = wrap(f"{mark} {finding.name:<19} {finding.found}", width, subsequent_indent=" " * INDENT)
    if to_terminal:
        lines[0] = typer.style(mark, fg=colour, bold=True) + lines[0][len(mark) :]
    if finding.advice:
        advice = wrap(f"-> {finding.advice}", width - INDENT, subsequent_indent="   ")
        lines += [" " * INDENT + (typer.style(line, bold=True) if to_terminal else line) for line in advice]
    exits.put("\n".join(lines))


def _show_json(finding: Finding) -> None:
    exits.put(msgspec.json.encode(finding).decode())
