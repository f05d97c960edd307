"""The program `quavelet`: its commands, and how errors end it. stdout is data, stderr is talk."""

from __future__ import annotations

import logging
import sys
from importlib.metadata import version
from typing import Annotated

import typer

from quavelet.cli import config, demo, doctor, exits, replay, run
from quavelet.core.errors import ImuError

app = typer.Typer(
    help="Which way is up: attitude from an MPU-6050.",
    no_args_is_help=True,
    add_completion=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)
app.command("run")(run.run)
app.command("demo")(demo.demo)
app.command("replay")(replay.replay)
app.command("doctor")(doctor.doctor)
app.command("config")(config.config)


def _show_version(wanted: bool) -> None:
    if wanted:
        print(version("quavelet"))
        raise typer.Exit()


@app.callback()
def common(
    verbose: Annotated[bool, typer.Option("--verbose", "-v", help="Tell more on stderr.")] = False,
    _version: Annotated[
        bool, typer.Option("--version", callback=_show_version, is_eager=True, help="Print the version and leave.")
    ] = False,
) -> None:
    logging.basicConfig(
        level=logging.DEBUG if verbose else logging.WARNING, format="quavelet: %(message)s", stream=sys.stderr
    )


def main() -> None:
    """Run the command line; every error on purpose is one sentence on stderr and an exit code."""
    try:
        app()
    except ImuError as error:
        print(f"quavelet: {error}", file=sys.stderr)
        sys.exit(exits.exit_code(error))
    except BrokenPipeError:
        exits.forget_stdout()
        sys.exit(exits.OK)
