"""The fake under an unchanged smbus2 of this process.

Only the names `os` and `ioctl` of the module smbus2.smbus2 are replaced. The structures smbus2 makes are read from
memory as the kernel reads them, by the layout of linux/i2c-dev.h.
"""

from __future__ import annotations

import ctypes
import errno
import os
from collections.abc import Iterable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from types import SimpleNamespace
from typing import Any
from unittest import mock

import smbus2.smbus2

from hw_fakes.ways.i2c_dev import I2C_FUNCS, I2C_RDWR, I2C_SLAVE, I2C_SMBUS, MOST_MESSAGES, OpenDevice
from hw_fakes.wire.adapter import READ, Adapter, Message, os_error, union_length


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
    with PatchedKernel(adapters).installed():
        yield


class PatchedKernel:
    """The kernel as smbus2 sees it: what each path opens, what is refused, and what was asked.

    devices       by path: an adapter; the errno opening it is refused with (EACCES: not in the group i2c); None for a
                  device that opens and is no I2C adapter (ENOTTY). Opening any other path is refused with ENOENT
    held          addresses a kernel driver holds, on every adapter: I2C_SLAVE is refused with EBUSY. I2C_RDWR is not,
                  and neither is I2C_SLAVE_FORCE, as in the kernel
    fail_with     errno of every transfer from here on, before it is on the wires; None: none fails
    open_files    path by file descriptor
    ioctls        the requests, in order, also those refused
    transactions  of each I2C_RDWR (address, "read" or "write", length) of its messages, also of those that failed
    """

    def __init__(self, devices: Mapping[str, Adapter | int | None], *, replace: Iterable[str] = ()) -> None:
        """`replace` names further functions `ioctl` to replace, those of code that asks something of smbus2's file
        itself: "some_driver.bus.ioctl"."""
        self.devices = dict(devices)
        self.held: set[int] = set()
        self.fail_with: int | None = None
        self.open_files: dict[int, str] = {}
        self.ioctls: list[int] = []
        self.transactions: list[list[tuple[int, str, int]]] = []
        self._replace = tuple(replace)
        self._opened: dict[int, OpenDevice] = {}

    @contextmanager
    def installed(self) -> Iterator[PatchedKernel]:
        """smbus2 talks to this kernel, and to no other, inside the block."""
        system = SimpleNamespace(**{**vars(os), "open": self._open, "close": self._close})
        with ExitStack() as replaced:
            replaced.enter_context(mock.patch.object(smbus2.smbus2, "os", system))
            for name in ("smbus2.smbus2.ioctl", *self._replace):
                replaced.enter_context(mock.patch(name, self._ioctl))
            yield self

    def _open(self, path: str, flags: int) -> int:
        device = self.devices.get(path, errno.ENOENT)
        if isinstance(device, int):
            raise OSError(device, os.strerror(device), path)
        fd = os.open(os.devnull, flags)  # a number that no other file of the process has
        self.open_files[fd] = path
        if device is not None:
            self._opened[fd] = OpenDevice(device)
        return fd

    def _close(self, fd: int) -> None:
        self._opened.pop(fd, None)
        self.open_files.pop(fd, None)
        os.close(fd)

    def _ioctl(self, fd: int, request: int, argument: Any = 0) -> int:
        if fd not in self.open_files:
            raise os_error(errno.EBADF)
        self.ioctls.append(request)
        device = self._opened.get(fd)
        if device is None:
            raise os_error(errno.ENOTTY)
        if request == I2C_SMBUS:
            self._may_fail()
            _smbus(device, SmbusCall.from_address(ctypes.addressof(argument)))
            return 0
        if request == I2C_RDWR:
            return self._transfer(device, Transaction.from_address(ctypes.addressof(argument)))
        if request == I2C_FUNCS:
            # smbus2 has four bytes for it where the kernel writes a long.
            argument.value = device.control(request, 0)
            return 0
        if request == I2C_SLAVE and int(argument) in self.held:
            raise os_error(errno.EBUSY)
        return device.control(request, int(argument))

    def _transfer(self, device: OpenDevice, transaction: Transaction) -> int:
        if transaction.nmsgs > MOST_MESSAGES:
            raise os_error(errno.EINVAL)
        raw = (I2CMessage * transaction.nmsgs).from_address(transaction.msgs)
        self.transactions.append([(m.addr, "read" if m.flags & READ else "write", m.len) for m in raw])
        self._may_fail()
        messages: list[Message] = [
            (m.addr, m.flags, m.len if m.flags & READ else ctypes.string_at(m.buf, m.len)) for m in raw
        ]
        for message, answer in zip(raw, device.transfer(messages), strict=True):
            if answer:
                ctypes.memmove(message.buf, answer, len(answer))
        return len(raw)

    def _may_fail(self) -> None:
        if self.fail_with is not None:
            raise os_error(self.fail_with)


def _smbus(device: OpenDevice, call: SmbusCall) -> None:
    n = union_length(read=call.read_write == 1, size=call.size)
    data = ctypes.string_at(call.data, n) if n else b""
    answer = device.smbus(direction=call.read_write, command=call.command, size=call.size, data=data)
    if answer:
        ctypes.memmove(call.data, answer, len(answer))
