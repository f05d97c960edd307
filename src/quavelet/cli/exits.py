"""Exit codes, and the one place that turns an error into one."""

from __future__ import annotations

import os
import sys

from quavelet.core.errors import BusError, ChipUnstable, DeviceLost, ImuError, SettingsError, WrongChip

OK = 0
FAILED = 1
USAGE = 2
SETTINGS = 3
NO_DEVICE = 4
DEVICE_LOST = 5
VERDICT_FAILED = 6


def exit_code(error: ImuError) -> int:
    """The exit code that an error ends a command with."""
    if isinstance(error, SettingsError):
        return SETTINGS
    if isinstance(error, DeviceLost):
        return DEVICE_LOST
    if isinstance(error, BusError | WrongChip | ChipUnstable):
        return NO_DEVICE
    return FAILED


def forget_stdout() -> None:
    """The reader of stdout has gone (`| head`): nothing must be written to it any more, not even at exit."""
    devnull = os.open(os.devnull, os.O_WRONLY)
    os.dup2(devnull, sys.stdout.fileno())
    os.close(devnull)
