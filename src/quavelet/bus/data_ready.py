"""The data-ready line at a GPIO of this machine, by libgpiod. The only file that imports gpiod.

The kernel takes the time of an edge in its interrupt, so that a sample is known to some microseconds where the FIFO's
count, read by a program, leaves half a sample of doubt.
"""

from __future__ import annotations

import errno
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING

from quavelet.bus.protocol import Edge
from quavelet.core.closing import Closing
from quavelet.core.errors import BusBusy, BusError, BusPermission, DeviceMissing, SettingsError

if TYPE_CHECKING:
    import gpiod

QUEUE = 1024
"""Edges the kernel keeps until they are asked for, the most it can (linux/gpio.h); then the oldest are lost."""
CONSUMER = "quavelet"
_DEVICES = "/dev/gpiochip*"


class GpiodDataReady(Closing):
    """A `DataReady` line: rising edges of line `line` of the GPIO chip that has this label.

    label   as `gpiodetect` shows it: pinctrl-bcm2711 on a Raspberry Pi 4, pinctrl-rp1 on a 5. The number in
            /dev/gpiochipN changes from one kernel to the next, the label does not
    line    its offset, "17", or its name, "GPIO17"

    Raises SettingsError where gpiod is not installed, DeviceMissing where there is no such chip or line, BusBusy where
    another program has the line, BusPermission where this user may not have it.
    """

    def __init__(self, label: str, line: str) -> None:
        self._name = f"{label}:{line}"
        self._request: gpiod.LineRequest | None = None
        library = _library()
        with _chip(library, label) as chip:
            try:
                offset = chip.line_offset_from_id(int(line) if line.isdecimal() else line)
            except (OSError, ValueError):
                raise DeviceMissing(
                    f"{label} has no line '{line}': write its number (0 to {chip.get_info().num_lines - 1}) or its "
                    f"name as `gpioinfo` shows it",
                    errno=errno.ENOENT,
                ) from None
            settings = library.LineSettings(
                direction=library.line.Direction.INPUT,
                edge_detection=library.line.Edge.RISING,
                event_clock=library.line.Clock.MONOTONIC,
            )
            try:
                self._request = chip.request_lines({offset: settings}, consumer=CONSUMER, event_buffer_size=QUEUE)
            except OSError as error:
                raise _refused(error, self._name, user=chip.get_line_info(offset).consumer) from error

    @property
    def name(self) -> str:
        return self._name

    def wait(self, timeout_s: float) -> list[Edge]:
        if timeout_s < 0:
            raise ValueError(f"cannot wait {timeout_s:g} s: give 0 or more")
        if self._request is None:
            raise BusError(f"the line {self._name} is closed: open it again", errno=errno.EBADF)
        edges: list[Edge] = []
        try:
            # No more than its queue: on a wire that picks up noise there would be no end.
            while len(edges) < QUEUE and self._request.wait_edge_events(0 if edges else timeout_s):
                edges += [Edge(event.timestamp_ns, event.line_seqno) for event in self._request.read_edge_events()]
        except OSError as error:
            raise _refused(error, self._name) from error
        return edges

    def close(self) -> None:
        if self._request is not None:
            self._request.release()
            self._request = None


def open_data_ready(name: str) -> GpiodDataReady:
    """The line called `name`, "LABEL:LINE". Raises SettingsError for what is no such name, and as `GpiodDataReady`."""
    label, _, line = name.rpartition(":")
    if not label or not line:
        raise SettingsError(f"'{name}' is not a line: write LABEL:LINE as `gpiodetect` shows them, as pinctrl-rp1:17")
    return GpiodDataReady(label, line)


def _library() -> ModuleType:
    try:
        import gpiod
    except ImportError:
        raise SettingsError(
            "the data-ready line needs gpiod, which is not installed: pip install 'quavelet[gpio]'"
        ) from None
    if not hasattr(gpiod, "request_lines"):
        # Debian 12's python3-libgpiod is 1.6, which has the same name and another interface.
        raise SettingsError("the data-ready line needs gpiod 2.1 or later: pip install 'quavelet[gpio]'")
    return gpiod


@contextmanager
def _chip(library: ModuleType, label: str) -> Iterator[gpiod.Chip]:
    """The open chip of this label."""
    labels: list[str] = []
    refused: str | None = None
    for path in sorted(map(str, Path("/").glob(_DEVICES.lstrip("/")))):
        try:
            chip = library.Chip(path)
        except PermissionError:
            refused = path
            continue
        except OSError:
            continue  # a device that is going, or is no GPIO chip
        with chip:
            labels.append(chip.get_info().label)
            if labels[-1] == label:
                yield chip
                return
    if refused is not None:
        raise BusPermission(
            f"no permission for {refused}: add this user to the group gpio (sudo usermod -aG gpio $USER), log in again",
            errno=errno.EACCES,
        )
    there = f"there are {', '.join(labels)}" if labels else "this machine has none"
    raise DeviceMissing(
        f"there is no GPIO chip '{label}' ({there}): give a label that `gpiodetect` shows", errno=errno.ENODEV
    )


def _refused(error: OSError, name: str, *, user: str = "") -> BusError:
    """What the kernel says of a line, with what to do."""
    if error.errno == errno.EBUSY:
        return BusBusy(
            f"the line {name} is in use{f' by {user}' if user else ''}: stop what uses it, or wire INT to another pin",
            errno=error.errno,
        )
    if error.errno in (errno.EACCES, errno.EPERM):
        return BusPermission(
            f"no permission for the line {name}: add this user to the group gpio (sudo usermod -aG gpio $USER)",
            errno=error.errno,
        )
    if error.errno in (errno.ENODEV, errno.ENOENT):
        return DeviceMissing(f"the line {name} is gone with its GPIO chip: plug it in again", errno=error.errno)
    if error.errno in (errno.ENXIO, errno.EOPNOTSUPP, errno.ENOTSUP):
        return BusError(f"the line {name} gives no interrupts: wire INT to another pin", errno=error.errno)
    return BusError(f"the line {name} failed ({error.strerror}): look at `dmesg`", errno=error.errno)
