"""A kernel in this process: what i2c-dev does with the system calls of an unchanged smbus2.

Only the names `os` and `ioctl` of smbus2.smbus2 are replaced; the structures smbus2 makes are read from memory as the
kernel reads them, by the layout of linux/i2c-dev.h.
"""

from __future__ import annotations

import ctypes
import errno
import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from types import SimpleNamespace
from typing import Any
from unittest import mock

import smbus2.smbus2

from hw_fakes import Nack, Target
from quavelet.bus import linux

I2C_SLAVE, I2C_FUNCS, I2C_RDWR = 0x703, 0x705, 0x707
I2C_M_RD = 1
FUNCS = 0x0EFF0009  # I2C and all of SMBus emulated on it, as the Raspberry Pi's adapter says
MOST_MESSAGES, MOST_BYTES = 42, 8192


class Message(ctypes.Structure):
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


@dataclass
class I2CDev:
    """Adapters by their path: the targets on one, or the errno with which opening it is refused.

    nack_errno    what a missing acknowledge is told as: EREMOTEIO on a Raspberry Pi, ENXIO on many other adapters
    no_i2c        opening succeeds, but the device is no I2C adapter
    held          addresses that a kernel driver holds: I2C_SLAVE is refused, I2C_RDWR is not
    fail_with     errno of every transfer from now on
    open_files    path by file descriptor
    ioctls        the requests, in order, I2C_SLAVE left out
    transactions  per I2C_RDWR, (address, direction, length) of its messages
    """

    adapters: dict[str, Mapping[int, Target] | int]
    nack_errno: int = errno.EREMOTEIO
    no_i2c: bool = False
    held: frozenset[int] = frozenset()
    fail_with: int | None = None
    open_files: dict[int, str] = field(default_factory=dict)
    ioctls: list[int] = field(default_factory=list)
    transactions: list[list[tuple[int, str, int]]] = field(default_factory=list)

    @contextmanager
    def installed(self) -> Iterator[I2CDev]:
        """smbus2 talks to this kernel inside the block, and must have closed what it opened at its end."""
        system = SimpleNamespace(O_RDWR=os.O_RDWR, open=self._open, close=self._close)
        with (
            mock.patch.object(smbus2.smbus2, "os", system),
            mock.patch.object(smbus2.smbus2, "ioctl", self._ioctl),
            mock.patch.object(linux, "ioctl", self._ioctl),
        ):
            yield self
        assert not self.open_files, "left open"

    def _open(self, path: str, flags: int) -> int:
        adapter = self.adapters.get(path, errno.ENOENT)
        if isinstance(adapter, int):
            raise OSError(adapter, os.strerror(adapter), path)
        assert flags == os.O_RDWR
        fd = max(self.open_files, default=999) + 1
        self.open_files[fd] = path
        return fd

    def _close(self, fd: int) -> None:
        if self.open_files.pop(fd, None) is None:
            raise _error(errno.EBADF)

    def _ioctl(self, fd: int, request: int, argument: Any) -> int:
        if fd not in self.open_files:
            raise _error(errno.EBADF)
        if request == I2C_SLAVE and not self.no_i2c:
            if argument in self.held:
                raise _error(errno.EBUSY)
            return 0
        self.ioctls.append(request)
        if request == I2C_FUNCS and not self.no_i2c:
            argument.value = FUNCS
            return 0
        if request == I2C_RDWR and not self.no_i2c:
            return self._transfer(fd, Transaction.from_address(ctypes.addressof(argument)))
        raise _error(errno.ENOTTY)

    def _transfer(self, fd: int, transaction: Transaction) -> int:
        if not 1 <= transaction.nmsgs <= MOST_MESSAGES:
            raise _error(errno.EINVAL)
        messages = (Message * transaction.nmsgs).from_address(transaction.msgs)
        if any(message.len > MOST_BYTES for message in messages):
            raise _error(errno.EINVAL)
        self.transactions.append([(m.addr, "read" if m.flags & I2C_M_RD else "write", m.len) for m in messages])
        if self.fail_with is not None:
            raise _error(self.fail_with)
        adapter = self.adapters[self.open_files[fd]]
        assert not isinstance(adapter, int)
        begun: dict[int, Target] = {}
        try:
            for message in messages:
                if message.addr not in adapter:
                    raise Nack
                target = begun[message.addr] = adapter[message.addr]
                if message.flags & I2C_M_RD:
                    ctypes.memmove(message.buf, target.read(message.len), message.len)
                else:
                    target.write(ctypes.string_at(message.buf, message.len))
        except Nack:
            raise _error(self.nack_errno) from None
        finally:
            for target in begun.values():
                target.stop()
        return len(messages)


def _error(code: int) -> OSError:
    return OSError(code, os.strerror(code))
