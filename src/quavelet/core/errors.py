"""Every error quavelet raises on purpose, each with one sentence of what to do.

ImuError
├── BusError (OSError)      an I2C transfer failed
│   ├── DeviceMissing       nothing answers at the address, or there is no such bus
│   ├── BusBusy             a kernel driver or a clock chip holds the address
│   └── BusPermission       this user may not open the bus
├── DeviceLost              the chip answered once and no longer does
├── WrongChip               WHO_AM_I is not one of ours
├── ChipUnstable            the chip answers, but does not hold what is written
├── EndOfData               a recording or a script has nothing more to give
├── NotPossible             what is asked for cannot be done as things stand
├── CalibrationError (ValueError)
├── SettingsError (ValueError)
└── RecordingError (ValueError)
"""

from __future__ import annotations

from functools import partial
from typing import Any


class ImuError(Exception):
    """Root of all errors raised on purpose; `str(error)` is one sentence that says what to do."""


class BusError(ImuError, OSError):
    """An I2C transfer failed.

    Attributes: `errno` from the operating system (None where there was none), `address` the 7-bit
    device address, `register` the register the transfer began at, `attempts` how often it was tried.
    """

    def __init__(
        self,
        message: str,
        *,
        errno: int | None = None,
        address: int | None = None,
        register: int | None = None,
        attempts: int = 1,
    ) -> None:
        OSError.__init__(self, errno, message)
        self.message = message
        self.errno = errno
        self.address = address
        self.register = register
        self.attempts = attempts

    def __str__(self) -> str:
        return self.message

    def __reduce__(self) -> tuple[Any, ...]:
        # OSError's own would call with positional arguments: pickle and copy could not bring the error back.
        known = {name: getattr(self, name) for name in ("errno", "address", "register", "attempts")}
        return partial(type(self), self.message, **known), ()


class DeviceMissing(BusError):
    """Nothing answers at the address, or the bus itself does not exist."""


class BusBusy(BusError):
    """A kernel driver holds the address (a clock chip's driver or the kernel's own MPU-6050 driver)."""


class BusPermission(BusError):
    """This user may not open the bus device."""


class DeviceLost(ImuError):
    """The chip streamed and then stopped answering for longer than the driver tolerates."""


class WrongChip(ImuError):
    """WHO_AM_I names another chip. `found` is the value read, `known` the values accepted."""

    def __init__(self, message: str, *, found: int, known: tuple[int, ...]) -> None:
        super().__init__(message)
        self.found = found
        self.known = known

    def __reduce__(self) -> tuple[Any, ...]:
        return partial(type(self), str(self), found=self.found, known=self.known), ()


class ChipUnstable(ImuError):
    """The chip answers but does not come out of reset, or does not hold its configuration."""


class EndOfData(ImuError):
    """A source that replays something has given all it holds."""


class NotPossible(ImuError):
    """What is asked for cannot be done as things stand, and nothing was changed."""


class CalibrationError(ImuError, ValueError):
    """A calibration cannot be made or used."""


class SettingsError(ImuError, ValueError):
    """A setting is unknown, of the wrong type, out of range, or does not go with another."""


class RecordingError(ImuError, ValueError):
    """A recording is not one, is damaged, or cannot be written."""
