"""The fake as a USB device of a virtual machine: an i2c-tiny-usb behind a usbredir socket, which QEMU connects to.

    qemu-system-x86_64 ... -device piix3-usb-uhci -chardev socket,path=PATH,id=r -device usb-redir,chardev=r

The guest needs i2c-tiny-usb and i2c-dev and is none the wiser. The controller must be a UHCI one: QEMU's xHCI wants
capabilities of its peer that a device with control transfers alone has no use for. The packets are those of usbredir's
usb-redirection-protocol.md, without capabilities and thus with ids of 32 bits.
"""

from __future__ import annotations

import os
import socket
import struct
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import BinaryIO

from hw_fakes.ways.tiny_usb import DEVICE, DEVICE_TO_HOST, Request, TinyUsb
from hw_fakes.wire.adapter import Adapter

HELLO, DEVICE_CONNECT, INTERFACE_INFO, EP_INFO = 0, 1, 4, 5
SET_CONFIGURATION, GET_CONFIGURATION, CONFIGURATION_STATUS = 6, 7, 8
SET_ALT_SETTING, GET_ALT_SETTING, ALT_SETTING_STATUS = 9, 10, 11
CONTROL_PACKET = 100
SUCCESS, STALL = 0, 4
FULL_SPEED = 1
NO_ENDPOINT, CONTROL_ENDPOINT = 255, 0

HEAD = struct.Struct("<3I")  # type, length, id
CONTROL = struct.Struct("<BBBBHHH")  # endpoint, request, requesttype, status, value, index, length
MOST_BYTES = CONTROL.size + 0xFFFF


@contextmanager
def served_usbredir(adapter: Adapter, path: str | os.PathLike[str]) -> Iterator[None]:
    """Serve `adapter` at the Unix socket `path`, to one virtual machine after the other, as long as the block lasts.

    Raises OSError where there can be no socket at `path`, as where a file is there already.
    """
    with socket.socket(socket.AF_UNIX) as listener:
        listener.bind(os.fspath(path))
        listener.listen(1)
        server = _Server(TinyUsb(adapter), listener)
        server.start()
        try:
            yield
        finally:
            server.end()
            Path(path).unlink(missing_ok=True)


class _Server:
    def __init__(self, device: TinyUsb, listener: socket.socket) -> None:
        self._device = device
        self._listener = listener
        self._lock = threading.Lock()
        self._connection: socket.socket | None = None
        self._ended = False
        self._thread = threading.Thread(target=self._serve, name="hw_fakes usbredir", daemon=True)

    def start(self) -> None:
        self._thread.start()

    def end(self) -> None:
        with self._lock:
            self._ended = True
            for waiting in (self._listener, self._connection):
                if waiting is not None:
                    with suppress(OSError):
                        waiting.shutdown(socket.SHUT_RDWR)  # wakes accept and recv, which close would not
        self._thread.join()

    def _serve(self) -> None:
        while True:
            try:
                connection, _ = self._listener.accept()
            except OSError:
                return
            with connection:
                with self._lock:
                    if self._ended:
                        return
                    self._connection = connection
                with suppress(ConnectionError):
                    serve(connection, self._device)
                with self._lock:
                    self._connection = None


def serve(connection: socket.socket, device: TinyUsb) -> None:
    """Answer a virtual machine until it closes the connection, or sends what is no packet."""
    _send(connection, HELLO, 0, b"hw_fakes".ljust(64, b"\0") + bytes(4))
    with connection.makefile("rb") as stream:
        while (packet := _received(stream)) is not None:
            kind, number, body = packet
            try:
                answers = _answers(device, kind, body)
            except (struct.error, IndexError):
                return  # shorter than its kind
            for answer_kind, answer in answers:
                _send(connection, answer_kind, number, answer)


def _received(stream: BinaryIO) -> tuple[int, int, bytes] | None:
    head = stream.read(HEAD.size)
    if len(head) < HEAD.size:
        return None
    kind, length, number = HEAD.unpack(head)
    body = stream.read(length) if length <= MOST_BYTES else b""
    return (kind, number, body) if len(body) == length else None


def _send(connection: socket.socket, kind: int, number: int, body: bytes) -> None:
    connection.sendall(HEAD.pack(kind, len(body), number) + body)


def _answers(device: TinyUsb, kind: int, body: bytes) -> list[tuple[int, bytes]]:
    if kind == HELLO:
        return _plugged_in()
    if kind == SET_CONFIGURATION:
        return [(CONFIGURATION_STATUS, bytes([SUCCESS, body[0]]))]
    if kind == GET_CONFIGURATION:
        return [(CONFIGURATION_STATUS, bytes([SUCCESS, 1]))]
    if kind == SET_ALT_SETTING:
        return [(ALT_SETTING_STATUS, bytes([SUCCESS, body[0], body[1]]))]
    if kind == GET_ALT_SETTING:
        return [(ALT_SETTING_STATUS, bytes([SUCCESS, body[0], 0]))]
    if kind == CONTROL_PACKET:
        return [(CONTROL_PACKET, _control(device, body))]
    return []  # resets, and cancelling what is answered already: nothing to say


def _plugged_in() -> list[tuple[int, bytes]]:
    """One interface, endpoint 0, and the device."""
    nothing = bytes(32)
    endpoints = bytearray([NO_ENDPOINT] * 32)
    endpoints[0x00] = endpoints[0x10] = CONTROL_ENDPOINT  # out and in
    device_class, subclass, protocol, _, vendor, product = struct.unpack_from("<4B2H", DEVICE, 4)
    return [
        (INTERFACE_INFO, struct.pack("<I", 1) + 4 * nothing),
        (EP_INFO, bytes(endpoints) + 2 * nothing),
        (DEVICE_CONNECT, struct.pack("<4B2H", FULL_SPEED, device_class, subclass, protocol, vendor, product)),
    ]


def _control(device: TinyUsb, body: bytes) -> bytes:
    endpoint, number, kind, _, value, index, length = CONTROL.unpack_from(body)
    answer = (
        None
        if endpoint & ~DEVICE_TO_HOST
        else device.control(Request(kind, number, value, index, length), body[CONTROL.size :])
    )
    status = STALL if answer is None else SUCCESS
    answer = answer or b""
    done = 0 if status else len(answer) if kind & DEVICE_TO_HOST else length
    return CONTROL.pack(endpoint, number, kind, status, value, index, done) + answer
