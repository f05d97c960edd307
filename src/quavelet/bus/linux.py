"""A Linux I2C bus, /dev/i2c-N, by smbus2's I2C_RDWR. The only file that imports smbus2."""

from __future__ import annotations

import errno
import re
from fcntl import ioctl

from smbus2 import SMBus, i2c_msg

from quavelet.bus.faults import bus_error
from quavelet.core.clock import Clock
from quavelet.core.closing import Closing
from quavelet.core.errors import BusError, SettingsError

I2C_SLAVE = 0x0703  # linux/i2c-dev.h
MAX_BYTES = 8192  # of a message: the kernel refuses more (i2c-dev), and at 65536 smbus2's length begins at 0 again


class LinuxI2CBus(Closing):
    """An `I2CBus` on /dev/i2c-`number`.

    I2C_RDWR makes one transaction with a repeated start of any length up to the kernel's 8192 bytes a message;
    smbus2's block calls would stop at 32.
    """

    def __init__(self, number: int) -> None:
        self._name = f"linux:{number}"
        self._asked: set[int] = set()
        self._smbus: SMBus | None = SMBus()
        try:
            self._smbus.open(number)
        except OSError as error:
            self.close()  # a device that is no I2C bus is open by now
            raise bus_error(error.errno, bus=f"/dev/i2c-{number}") from error

    @property
    def name(self) -> str:
        return self._name

    def write(self, address: int, data: bytes) -> None:
        _check_length("write", len(data))
        self._transfer(address, data, i2c_msg.write(address, data))

    def write_read(self, address: int, data: bytes, n: int) -> bytes:
        _check_length("write", len(data))
        _check_length("read", n)
        answer = i2c_msg.read(address, n)
        self._transfer(address, data, i2c_msg.write(address, data), answer)
        return bytes(answer)

    def _transfer(self, address: int, data: bytes, *messages: i2c_msg) -> None:
        if self._smbus is None or self._smbus.fd is None:
            raise BusError(f"the bus {self._name} is closed: open it again", errno=errno.EBADF, address=address)
        try:
            if address not in self._asked:
                # I2C_RDWR goes past a kernel driver that holds the address; I2C_SLAVE is refused with EBUSY.
                ioctl(self._smbus.fd, I2C_SLAVE, address)
                self._asked.add(address)
            self._smbus.i2c_rdwr(*messages)
        except OSError as error:
            raise bus_error(error.errno, bus=self._name, address=address, register=data[0]) from error

    def close(self) -> None:
        if self._smbus is not None:
            self._smbus.close()
            self._smbus = None


def _check_length(verb: str, n: int) -> None:
    if not 1 <= n <= MAX_BYTES:
        raise ValueError(f"cannot {verb} {n} bytes: a transfer has at least one byte and at most {MAX_BYTES} a message")


def open_linux(which: str, *, clock: Clock) -> LinuxI2CBus:
    """The bus "linux:N"; `which` is N. The clock is not used: real wires keep their own time."""
    del clock
    if not re.fullmatch(r"[0-9]{1,3}", which):
        raise SettingsError(f"bus 'linux:{which}' is not a bus: write linux:N with N from /dev/i2c-N, as linux:1")
    return LinuxI2CBus(int(which))
