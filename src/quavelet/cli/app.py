"""The program `quavelet`: its commands, and how errors end it. stdout is data, stderr is talk."""

from __future__ import annotations

import logging
import os
import sys
from importlib.metadata import version
from pathlib import Path
from typing import Annotated, Any

import typer

from quavelet.cli import align, calibrate, config, demo, doctor, exits, replay, report, reproduce, run, service, status
from quavelet.core.errors import ImuError

app = typer.Typer(
    help="Which way is up: attitude from an MPU-6050.",
    invoke_without_command=True,
    add_completion=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)
app.command("run")(run.run)
app.command("demo")(demo.demo)
app.command("replay")(replay.replay)
app.command("doctor")(doctor.doctor)
app.command("calibrate")(calibrate.calibrate)
app.command("align")(align.align)
app.command("report")(report.report)
app.command("reproduce")(reproduce.reproduce)
app.command("config")(config.config)
app.command("status")(status.show_status)
app.command("watch")(status.show_messages)
app.add_typer(service.app, name="service")


def _show_version(wanted: bool) -> None:
    if wanted:
        print(version("quavelet"))
        raise typer.Exit()


@app.callback()
def common(
    context: typer.Context,
    verbose: Annotated[bool, typer.Option("--verbose", "-v", help="Tell more on stderr.")] = False,
    _version: Annotated[
        bool, typer.Option("--version", callback=_show_version, is_eager=True, help="Print the version and leave.")
    ] = False,
) -> None:
    logging.basicConfig(
        level=logging.DEBUG if verbose else logging.WARNING, format="quavelet: %(message)s", stream=sys.stderr
    )
    if context.invoked_subcommand is None:
        print(context.get_help(), file=sys.stderr)
        raise typer.Exit(exits.USAGE)


def main() -> None:
    """Run the command line; every error on purpose is a sentence on stderr, each mistake in a settings
    file one, and an exit code."""
    _open_what_is_closed()
    try:
        sys.exit(app(standalone_mode=False))
    except _UsageError as error:
        usage: str = error.format_message()
        path = error.ctx.command_path if error.ctx else "quavelet"
        print(f"quavelet: {usage.rstrip('.')}, see `{path} --help`", file=sys.stderr)
        sys.exit(exits.USAGE)
    except ImuError as error:
        for line in str(error).splitlines():
            print(f"quavelet: {line}", file=sys.stderr)
        sys.exit(exits.exit_code(error))
    except typer.Abort:
        sys.exit(exits.INTERRUPTED)


# Typer has a copy of click of its own or not, by its version: the class is found where the installed one has it.
_UsageError: Any = next(kind for kind in typer.BadParameter.__mro__ if kind.__name__ == "UsageError")


def _open_what_is_closed() -> None:
    """Closed standard streams (`>&-`) go to /dev/null: another file would get their numbers, and what is meant
    for them."""
    for name in ("stdout", "stderr"):
        if getattr(sys, name) is None:
            setattr(sys, name, Path(os.devnull).open("w"))  # noqa: SIM115
