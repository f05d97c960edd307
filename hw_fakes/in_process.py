"""The fake under an unchanged smbus2 of this process.

Only the names `os` and `ioctl` of the module smbus2.smbus2 are replaced. The structures smbus2 makes are read from
memory as the kernel reads them, by the layout of linux/i2c-dev.h.
"""

from __future__ import annotations

import ctypes
import errno
import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from types import SimpleNamespace
from typing import Any
from unittest import mock

import smbus2.smbus2

from hw_fakes.i2c_adapter import READ, Adapter, Message, os_error, union_length
from hw_fakes.i2c_dev import I2C_FUNCS, I2C_RDWR, I2C_SMBUS, MOST_MESSAGES, OpenDevice


class SmbusCall(ctypes.Structure):
    """struct i2c_smbus_ioctl_data"""

    _fields_ = (
        ("read_write", ctypes.c_uint8),
        ("command", ctypes.c_uint8),
        ("size", ctypes.c_uint32),
        ("data", ctypes.c_void_p),
    )


class I2CMessage(ctypes.Structure):
    """struct i2c_msg"""

    _fields_ = (
        ("addr", ctypes.c_uint16),
        ("flags", ctypes.c_uint16),
        ("len", ctypes.c_uint16),
        ("buf", ctypes.c_void_p),
    )


class Transaction(ctypes.Structure):
    """struct i2c_rdwr_ioctl_data"""

    _fields_ = (("msgs", ctypes.c_void_p), ("nmsgs", ctypes.c_uint32))


@contextmanager
def patched_smbus2(adapters: Mapping[str, Adapter]) -> Iterator[None]:
    """Inside the block smbus2 finds these adapters, by path ("/dev/i2c-1"), and no other bus: no real one either."""
    kernel = _Kernel(adapters)
    system = SimpleNamespace(**{**vars(os), "open": kernel.open, "close": kernel.close})
    with mock.patch.object(smbus2.smbus2, "os", system), mock.patch.object(smbus2.smbus2, "ioctl", kernel.ioctl):
        yield


class _Kernel:
    def __init__(self, adapters: Mapping[str, Adapter]) -> None:
        self._adapters = dict(adapters)
        self._open: dict[int, OpenDevice] = {}

    def open(self, path: str, flags: int) -> int:
        if path not in self._adapters:
            raise FileNotFoundError(errno.ENOENT, os.strerror(errno.ENOENT), path)
        fd = os.open(os.devnull, flags)  # a number that no other file of the process has
        self._open[fd] = OpenDevice(self._adapters[path])
        return fd

    def close(self, fd: int) -> None:
        self._open.pop(fd, None)
        os.close(fd)

    def ioctl(self, fd: int, request: int, argument: Any = 0) -> int:
        device = self._open.get(fd)
        if device is None:
            raise os_error(errno.EBADF)
        if request == I2C_SMBUS:
            _smbus(device, SmbusCall.from_address(ctypes.addressof(argument)))
            return 0
        if request == I2C_RDWR:
            return _transfer(device, Transaction.from_address(ctypes.addressof(argument)))
        if request == I2C_FUNCS:
            # smbus2 has four bytes for it where the kernel writes a long.
            argument.value = device.control(request, 0)
            return 0
        return device.control(request, int(argument))


def _smbus(device: OpenDevice, call: SmbusCall) -> None:
    n = union_length(read=call.read_write == 1, size=call.size)
    data = ctypes.string_at(call.data, n) if n else b""
    answer = device.smbus(direction=call.read_write, command=call.command, size=call.size, data=data)
    if answer:
        ctypes.memmove(call.data, answer, len(answer))


def _transfer(device: OpenDevice, transaction: Transaction) -> int:
    if transaction.nmsgs > MOST_MESSAGES:
        raise os_error(errno.EINVAL)
    raw = (I2CMessage * transaction.nmsgs).from_address(transaction.msgs)
    messages: list[Message] = [
        (m.addr, m.flags, m.len if m.flags & READ else ctypes.string_at(m.buf, m.len)) for m in raw
    ]
    for message, answer in zip(raw, device.transfer(messages), strict=True):
        if answer:
            ctypes.memmove(message.buf, answer, len(answer))
    return len(raw)
