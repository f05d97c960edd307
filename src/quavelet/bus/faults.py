"""The operating system's error numbers as typed errors that say what to do."""

from __future__ import annotations

import errno as codes

from quavelet.core.errors import BusBusy, BusError, BusPermission, DeviceMissing

_NO_ANSWER = "no answer from {where}: check power, SDA, SCL and AD0 (low = 0x68, high = 0x69)"
_BUSY = (
    "{where} is held by a kernel driver: remove the overlay that claims it "
    "(a DS1307/DS3231 clock or dtoverlay=mpu6050), or wire AD0 high and use 0x69"
)
_PERMISSION = "no permission for {where}: add this user to the group i2c (sudo usermod -aG i2c $USER), log in again"
_NO_BUS = "there is no bus {bus}: enable I2C (sudo raspi-config nonint do_i2c 0) or give another --bus"
_TIMED_OUT = "{where} timed out, a line is held low: check wiring and pull-ups, then power the board off and on"
_WIRE = "a transfer with {where} failed on the wire (EIO): shorten the wires and check the pull-ups"
_ARBITRATION = (
    "another master took the bus from {where} (lost arbitration): take it off the bus, or check SDA for disturbances"
)

_BY_ERRNO: dict[int, tuple[type[BusError], str]] = {
    codes.EREMOTEIO: (DeviceMissing, _NO_ANSWER),  # a NACK as the Raspberry Pi's controller tells it
    codes.ENXIO: (DeviceMissing, _NO_ANSWER),  # a NACK as most other adapters tell it
    codes.EBUSY: (BusBusy, _BUSY),
    codes.EACCES: (BusPermission, _PERMISSION),
    codes.EPERM: (BusPermission, _PERMISSION),
    codes.ENOENT: (DeviceMissing, _NO_BUS),
    codes.ENODEV: (DeviceMissing, _NO_BUS),
    codes.ETIMEDOUT: (BusError, _TIMED_OUT),
    codes.EIO: (BusError, _WIRE),
    codes.EAGAIN: (BusError, _ARBITRATION),
}


def bus_error(
    errno: int | None, *, bus: str, address: int | None = None, register: int | None = None, attempts: int = 1
) -> BusError:
    """The typed error for `errno` on the bus named `bus`; `address` is None while opening."""
    where = bus if address is None else f"address 0x{address:02x} on {bus}"
    name = "no error number" if errno is None else codes.errorcode.get(errno, str(errno))
    unknown = (BusError, f"a transfer with {{where}} failed ({name}): check the wiring, then look at `dmesg`")
    kind, text = unknown if errno is None else _BY_ERRNO.get(errno, unknown)
    return kind(text.format(where=where, bus=bus), errno=errno, address=address, register=register, attempts=attempts)
