"""Exit codes, and the one place that turns an error into one."""

from __future__ import annotations

import os
import sys

import typer

from quavelet.core.errors import BusError, ChipUnstable, DeviceLost, ImuError, SettingsError, WrongChip

OK = 0
FAILED = 1
USAGE = 2
SETTINGS = 3
NO_DEVICE = 4
DEVICE_LOST = 5
VERDICT_FAILED = 6
INTERRUPTED = 130
"""Ctrl-C where there is nothing to finish; 128 + SIGINT, as the shell has it."""


class OutputError(ImuError):
    """Standard output cannot be written."""


def exit_code(error: ImuError) -> int:
    """The exit code that an error ends a command with."""
    if isinstance(error, SettingsError):
        return SETTINGS
    if isinstance(error, DeviceLost):
        return DEVICE_LOST
    if isinstance(error, BusError | WrongChip | ChipUnstable):
        return NO_DEVICE
    return FAILED


def put(text: str) -> None:
    """Write lines of data to stdout, now. Ends the command where their reader has gone, which is no failure.

    Raises OutputError where stdout takes no more.
    """
    try:
        sys.stdout.write(text + "\n")
        sys.stdout.flush()
    except BrokenPipeError:
        forget_stdout()
        raise typer.Exit(OK) from None
    except OSError as error:
        forget_stdout()
        raise OutputError(f"standard output failed: {error.strerror or error}") from error


def forget_stdout() -> None:
    """stdout takes no more (`| head`): nothing must be written to it, not even at exit."""
    devnull = os.open(os.devnull, os.O_WRONLY)
    os.dup2(devnull, sys.stdout.fileno())
    os.close(devnull)
