"""The fake as an I2C adapter of the running kernel: an i2c-tiny-usb plugged in by USB/IP (root, vhci-hcd).

One end of a pair of sockets is given to the kernel's vhci_hcd, the other is served here; there is no network and no
tool of usbip's. The packets are those of Documentation/usb/usbip_protocol.rst.
"""

from __future__ import annotations

import errno
import socket
import struct
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TypeVar

from hw_fakes.ways.tiny_usb import Request, TinyUsb
from hw_fakes.wire.adapter import Adapter
from quavelet.core.errors import SettingsError

CONTROLLER = Path("/sys/devices/platform/vhci_hcd.0")
USB = Path("/sys/bus/usb")
DEV = Path("/dev")
MODPROBE = "modprobe -a vhci-hcd i2c-tiny-usb i2c-dev, as root"
FREE = 4  # VDEV_ST_NULL, in the column "sta" of the status file
FULL_SPEED = 2
WAIT_S = 20.0  # an emulated machine takes one or two to find the device

CMD_SUBMIT, CMD_UNLINK, RET_SUBMIT, RET_UNLINK = 1, 2, 3, 4
TO_DEVICE = 0
PACKET = 48
HEAD = struct.Struct(">5I")  # command, seqnum, devid, direction, ep
SUBMIT = struct.Struct(">24xI12x8s")  # the length of the buffer, and the setup packet
RETURN = struct.Struct(">5Iii20x")  # status and actual_length after the head

T = TypeVar("T")


@contextmanager
def attached_usbip(adapter: Adapter) -> Iterator[int]:
    """The N of /dev/i2c-N that `adapter` is, in the running kernel, as long as the block lasts.

    Raises SettingsError where this is not root, a module is not loaded, or all ports of vhci_hcd are taken.
    """
    ours, kernels = socket.socketpair()
    with ours:
        with kernels:
            port = _attach(kernels)
        server = threading.Thread(target=serve, args=(ours, TinyUsb(adapter)), name="hw_fakes usbip", daemon=True)
        server.start()
        try:
            device = _appeared(port)
            yield int(device.name.removeprefix("i2c-"))
        finally:
            _detach(port)
            with suppress(OSError):
                ours.shutdown(socket.SHUT_RDWR)
            server.join(WAIT_S)


def serve(connection: socket.socket, device: TinyUsb) -> None:
    """Answer the kernel until it closes the connection, or sends what is no packet."""
    with suppress(ConnectionError), connection.makefile("rb") as stream:
        while len(packet := stream.read(PACKET)) == PACKET:
            command, number, _, direction, endpoint = HEAD.unpack_from(packet)
            if command == CMD_UNLINK:
                # All is answered as it comes, so what the kernel takes back is done already: status 0.
                connection.sendall(RETURN.pack(RET_UNLINK, number, 0, 0, 0, 0, 0))
                continue
            if command != CMD_SUBMIT:
                print(f"hw_fakes: USB/IP command {command} is none, the device is unplugged", file=sys.stderr)
                connection.shutdown(socket.SHUT_RDWR)
                return
            length, setup = SUBMIT.unpack(packet)
            data = stream.read(length) if direction == TO_DEVICE else b""
            answer = None if endpoint else device.control(Request.unpack(setup), data)
            status = -errno.EPIPE if answer is None else 0  # a stall
            answer = (answer or b"")[:length]
            actual = 0 if status else length if direction == TO_DEVICE else len(answer)
            connection.sendall(RETURN.pack(RET_SUBMIT, number, 0, 0, 0, status, actual) + answer)


def free_port(status: str) -> int | None:
    """The first port of USB 2 that a status file tells to be free; None where there is none."""
    for hub, port, state, *_ in _rows(status):
        if hub == "hs" and int(state) == FREE:
            return int(port)
    return None


def bus_id(status: str, port: int) -> str | None:
    """The name in /sys/bus/usb/devices of what is plugged into `port`; None as long as it has none."""
    for _, number, *_, name in _rows(status):
        if int(number) == port and name != "0-0":
            return name
    return None


def _rows(status: str) -> list[list[str]]:
    # hub port sta spd dev sockfd local_busid, below a line of these names
    return [row for line in status.splitlines() if len(row := line.split()) == 7 and row[1].isdecimal()]


def _status() -> str:
    # With more than one controller the first has all of them: status, status.1, ...
    return "".join(path.read_text() for path in sorted(CONTROLLER.glob("status*")))


def _attach(kernels: socket.socket) -> int:
    if not CONTROLLER.is_dir():
        raise SettingsError(f"this kernel has no USB/IP to plug the fake into: {MODPROBE}")
    for _ in range(10):
        port = free_port(_status())
        if port is None:
            raise SettingsError(f"all ports of {CONTROLLER.name} are taken: see `usbip port`, and detach one")
        try:
            # usbip/src/utils.c: port, socket, device id, speed
            (CONTROLLER / "attach").write_text(f"{port} {kernels.fileno()} {0x10001} {FULL_SPEED}")
        except PermissionError as error:
            raise SettingsError("only root can plug the fake into the kernel: use sudo") from error
        except OSError as error:
            if error.errno == errno.EBUSY:
                continue  # taken by another in the meantime
            raise SettingsError(f"the kernel does not take the fake: {error.strerror}") from error
        return port
    raise SettingsError(f"all ports of {CONTROLLER.name} are taken again and again: try once more")


def _appeared(port: int) -> Path:
    """The adapter's node in /dev."""

    def found() -> Path | None:
        name = bus_id(_status(), port)
        adapters = sorted((USB / "devices").glob(f"{name}/{name}:*/i2c-[0-9]*")) if name else []
        node = DEV / adapters[0].name if adapters else None
        return node if node and node.exists() else None

    device = _waited(found)
    if device is None:
        lacking = [
            module
            for module, sign in (
                ("i2c-tiny-usb", USB / "drivers/i2c-tiny-usb"),
                ("i2c-dev", Path("/sys/class/i2c-dev")),
            )
            if not sign.exists()
        ]
        why = f"not loaded: {', '.join(lacking)}" if lacking else f"none came within {WAIT_S:.0f} s, see dmesg"
        raise SettingsError(f"the kernel makes no /dev/i2c-N of the fake ({why}): {MODPROBE}")
    return device


def _detach(port: int) -> None:
    with suppress(OSError):
        (CONTROLLER / "detach").write_text(str(port))
    if _waited(lambda: bus_id(_status(), port) is None or None) is None:
        print("hw_fakes: something still holds the fake's /dev/i2c-N open: close it", file=sys.stderr)


def _waited(ask: Callable[[], T | None]) -> T | None:
    """What `ask` gives as soon as it is not None; None where that takes longer than `WAIT_S`."""
    deadline = time.monotonic() + WAIT_S
    while (answer := ask()) is None and time.monotonic() < deadline:
        time.sleep(0.02)
    return answer
