"""What the kernel's i2c-dev does with an open /dev/i2c-N, whichever way the system calls come in."""

from __future__ import annotations

import errno
from collections.abc import Sequence

from hw_fakes.wire.adapter import READ, Adapter, Message, os_error

# linux/i2c-dev.h
I2C_RETRIES, I2C_TIMEOUT, I2C_SLAVE, I2C_TENBIT = 0x701, 0x702, 0x703, 0x704
I2C_FUNCS, I2C_SLAVE_FORCE, I2C_RDWR, I2C_PEC, I2C_SMBUS = 0x705, 0x706, 0x707, 0x708, 0x720
MOST_MESSAGES, MOST_BYTES = 42, 8192


class OpenDevice:
    """An open /dev/i2c-N: an adapter and the address that was set on this file. Every failure is an OSError."""

    def __init__(self, adapter: Adapter) -> None:
        self.adapter = adapter
        self.address = 0

    def control(self, request: int, argument: int) -> int:
        """The ioctls whose argument is a number, and I2C_FUNCS, which gives one."""
        if request in (I2C_SLAVE, I2C_SLAVE_FORCE):
            if argument > 0x7F:
                raise os_error(errno.EINVAL)
            self.address = argument
            return 0
        if request == I2C_FUNCS:
            return self.adapter.functions
        if request in (I2C_TENBIT, I2C_PEC) and argument:
            raise os_error(errno.EOPNOTSUPP)
        if request in (I2C_TENBIT, I2C_PEC, I2C_RETRIES, I2C_TIMEOUT):
            return 0
        raise os_error(errno.ENOTTY)

    def smbus(self, *, direction: int, command: int, size: int, data: bytes) -> bytes:
        """I2C_SMBUS; `direction` is 1 to read, 0 to write."""
        if direction not in (0, 1):
            raise os_error(errno.EINVAL)
        return self.adapter.smbus(self.address, read=direction == 1, command=command, size=size, data=data)

    def transfer(self, messages: Sequence[Message]) -> list[bytes]:
        """I2C_RDWR."""
        lengths = [payload if isinstance(payload, int) else len(payload) for _, _, payload in messages]
        if not 1 <= len(messages) <= MOST_MESSAGES or max(lengths) > MOST_BYTES:
            raise os_error(errno.EINVAL)
        return self.adapter.transfer(messages)

    def read(self, n: int) -> bytes:
        """read(2)"""
        return self.adapter.transfer([(self.address, READ, min(n, MOST_BYTES))])[0]

    def write(self, data: bytes) -> int:
        """write(2)"""
        data = data[:MOST_BYTES]
        self.adapter.transfer([(self.address, 0, data)])
        return len(data)
