"""`quavelet service`: put the service in place on this machine, or take it away, each step in words."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Annotated

import typer

from quavelet.cli import exits, options
from quavelet.service.install import Installation
from quavelet.service.program import this_program
from quavelet.service.steps import InstallError, carry_out

app = typer.Typer(help="Put the service in place on this machine, or take it away.", no_args_is_help=True)

Name = Annotated[str, typer.Option("--name", help="Of this instance: its settings are /etc/quavelet/NAME.toml.")]
DryRun = Annotated[bool, typer.Option("--dry-run", help="Say each step and do none.")]
Root = Annotated[Path, typer.Option("--root", help="The system to work on, where it is not the one that runs.")]


@app.command()
def install(
    name: Name = "imu0",
    bus: options.Bus = None,
    address: options.Address = None,
    no_start: Annotated[bool, typer.Option("--no-start", help="Do not start it yet.")] = False,
    dry_run: DryRun = False,
    root: Root = Path("/"),
) -> None:
    """Put user, settings, unit and udev rule in place and start the service.

    Settings that are there are kept; --bus and --address go into new ones.
    """
    here = _installation(name, root)
    chip = None if bus is None and address is None else options.settings_of(bus, address, None).settings.bus
    steps = here.install(chip=chip, start=not no_start)
    _needs_root(here, dry_run, "install")
    carry_out(steps, say=exits.put, dry_run=dry_run)


@app.command()
def remove(
    name: Name = "imu0",
    purge: Annotated[bool, typer.Option("--purge", help="The settings, recordings and user, too.")] = False,
    dry_run: DryRun = False,
    root: Root = Path("/"),
) -> None:
    """Stop the service and take away what `install` put in place; settings and recordings stay."""
    here = _installation(name, root)
    steps = here.remove(purge=purge)
    _needs_root(here, dry_run, "remove")
    carry_out(steps, say=exits.put, dry_run=dry_run)


def _installation(name: str, root: Path) -> Installation:
    root = root.absolute()
    live = root == Path("/") and Path("/run/systemd/system").is_dir()
    return Installation(name, this_program(), root, live)


def _needs_root(here: Installation, dry_run: bool, what: str) -> None:
    if not dry_run and here.root == Path("/") and os.geteuid() != 0:
        raise InstallError(f"this needs root: sudo {here.program.path} service {what}, or --dry-run to see each step")
