"""The i2c-tiny-usb, a USB device that is an I2C adapter, as its control transfers: it has no endpoint but 0.

The other end is the kernel's drivers/i2c/busses/i2c-tiny-usb.c, whose words are used here.
"""

from __future__ import annotations

import struct
import sys
from dataclasses import dataclass
from typing import Self

from hw_fakes.wire.adapter import READ, Adapter

DEVICE = struct.pack("<BBHBBBBHHHBBBB", 18, 1, 0x0110, 0xFF, 0, 0, 8, 0x0403, 0xC631, 0x0205, 1, 2, 0, 1)
CONFIGURATION = struct.pack("<BBHBBBBB", 9, 2, 18, 1, 1, 0, 0x80, 5) + bytes([9, 4, 0, 0, 0, 0, 0, 0, 0])
STRINGS = ("hw_fakes", "i2c-tiny-usb")

DEVICE_TO_HOST, STANDARD, VENDOR, TYPE = 0x80, 0x00, 0x40, 0x60  # of bmRequestType (USB 2.0, table 9-2)
GET_STATUS, CLEAR_FEATURE, SET_FEATURE, SET_ADDRESS, GET_DESCRIPTOR = 0, 1, 3, 5, 6  # table 9-4
GET_CONFIGURATION, SET_CONFIGURATION, GET_INTERFACE, SET_INTERFACE = 8, 9, 10, 11

CMD_ECHO, CMD_GET_FUNC, CMD_SET_DELAY, CMD_GET_STATUS, CMD_I2C_IO = 0, 1, 2, 3, 4
BEGIN, END = 1, 2  # of CMD_I2C_IO: the first and the last message of a transaction
STATUS_IDLE, STATUS_ADDRESS_ACK, STATUS_ADDRESS_NAK = 0, 1, 2
DMA_SAFE = 0x0200  # I2C_M_DMA_SAFE is about the kernel's memory, yet its driver sends the flags as they are


@dataclass(frozen=True, slots=True)
class Request:
    """The setup packet of a control transfer (USB 2.0, table 9-2)."""

    kind: int
    number: int
    value: int
    index: int
    length: int

    @classmethod
    def unpack(cls, setup: bytes) -> Self:
        """From the 8 bytes of the setup packet."""
        return cls(*struct.unpack("<BBHHH", setup))

    @property
    def reads(self) -> bool:
        return bool(self.kind & DEVICE_TO_HOST)


class TinyUsb:
    """An `Adapter` behind a USB plug. Whatever is asked of it, it answers or stalls; it never raises."""

    def __init__(self, adapter: Adapter) -> None:
        self.adapter = adapter
        self._status = STATUS_IDLE

    def control(self, request: Request, data: bytes = b"") -> bytes | None:
        """One control transfer: what the host reads, b"" where it writes, None for a stall.

        data  what the host writes
        """
        if len(data) != (0 if request.reads else request.length):
            return None
        try:
            if request.kind & TYPE == STANDARD:
                answer = _standard(request)
            elif request.kind & TYPE == VENDOR:
                answer = self._vendor(request, data)
            else:
                answer = None
        except Exception as error:  # noqa: BLE001  the host must get an answer, or it would wait for seconds
            print(f"hw_fakes: the control transfer stalls: {error!r}", file=sys.stderr)
            answer = None
        return None if answer is None else answer[: request.length]

    def _vendor(self, request: Request, data: bytes) -> bytes | None:
        if CMD_I2C_IO <= request.number <= CMD_I2C_IO | BEGIN | END:
            return self._message(request, data)
        if not request.reads:
            # The delay of a clock that is not there.
            return b"" if request.number == CMD_SET_DELAY else None
        answers = {
            CMD_ECHO: request.value.to_bytes(2, "little"),
            CMD_GET_FUNC: self.adapter.functions.to_bytes(4, "little"),
            CMD_GET_STATUS: bytes([self._status]),
        }
        return answers.get(request.number)

    def _message(self, request: Request, data: bytes) -> bytes | None:
        flags = request.value & ~DMA_SAFE
        if flags != (READ if request.reads else 0):
            return None
        try:
            answer = self.adapter.message(request.index, flags, request.length if request.reads else data)
        except OSError as error:
            # The kernel sends no more of this transaction: the device itself gives the STOP.
            self.adapter.stop()
            if error.errno != self.adapter.nack_errno:
                return None
            self._status = STATUS_ADDRESS_NAK
            # Fewer bytes than asked for are EIO to the kernel, which then never looks at the status.
            return bytes(request.length) if request.reads else b""
        self._status = STATUS_ADDRESS_ACK
        if (request.number - CMD_I2C_IO) & END:
            self.adapter.stop()
        return answer


def _standard(request: Request) -> bytes | None:
    if not request.reads:
        known = (CLEAR_FEATURE, SET_FEATURE, SET_ADDRESS, SET_CONFIGURATION, SET_INTERFACE)
        return b"" if request.number in known else None
    if request.number == GET_DESCRIPTOR:
        return _descriptor(request.value >> 8, request.value & 0xFF)
    return {GET_STATUS: bytes(2), GET_CONFIGURATION: b"\x01", GET_INTERFACE: b"\x00"}.get(request.number)


def _descriptor(kind: int, number: int) -> bytes | None:
    if (kind, number) == (1, 0):
        return DEVICE
    if (kind, number) == (2, 0):
        return CONFIGURATION
    if kind == 3 and number <= len(STRINGS):
        text = STRINGS[number - 1].encode("utf-16-le") if number else b"\x09\x04"  # string 0: the languages, English
        return bytes([2 + len(text), 3]) + text
    return None
