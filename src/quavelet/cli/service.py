"""`quavelet service`: put the service in place on this machine, or take it away, each step in words."""

from __future__ import annotations

import os
import shlex
from collections.abc import Callable
from pathlib import Path
from typing import Annotated

import typer

from quavelet.cli import exits, options
from quavelet.service.install import Installation
from quavelet.service.program import this_program
from quavelet.service.steps import InstallError, Step, carry_out

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
    _needs_root(root, dry_run, "install", name=name, bus=bus, address=address)
    here = _installation(name, root)
    chip = None if bus is None and address is None else options.settings_of(bus, address, None).settings.bus
    steps = _seen(lambda: here.install(chip=chip, start=not no_start))
    carry_out(steps, say=exits.put, dry_run=dry_run)


@app.command()
def remove(
    name: Name = "imu0",
    purge: Annotated[bool, typer.Option("--purge", help="The settings, recordings and user, too.")] = False,
    dry_run: DryRun = False,
    root: Root = Path("/"),
) -> None:
    """Stop the service and take away what `install` put in place; settings and recordings stay."""
    _needs_root(root, dry_run, "remove", name=name)
    here = _installation(name, root)
    steps = _seen(lambda: here.remove(purge=purge))
    carry_out(steps, say=exits.put, dry_run=dry_run)


def _installation(name: str, root: Path) -> Installation:
    root = root.absolute()
    live = root == Path("/") and Path("/run/systemd/system").is_dir()
    return Installation(name, this_program(), root, live)


def _seen(look: Callable[[], list[Step]]) -> list[Step]:
    """The steps by what is there. Raises InstallError where that cannot be looked at."""
    try:
        return look()
    except PermissionError as error:
        raise InstallError(f"{error.filename}: {error.strerror}: a dry run sees it with sudo before it") from error
    except OSError as error:
        raise InstallError(f"{error.filename}: {error.strerror}: move it away first") from error


def _needs_root(root: Path, dry_run: bool, what: str, **given: str | None) -> None:
    """Before anything else is looked at: what it would find, another user may not even see."""
    if dry_run or root.absolute() != Path("/") or os.geteuid() == 0:
        return
    options = [word for name, value in given.items() if value is not None for word in (f"--{name}", value)]
    again = shlex.join([str(this_program().path), "service", what, *options])
    raise InstallError(f"this needs root: sudo {again}, or --dry-run to see each step")
