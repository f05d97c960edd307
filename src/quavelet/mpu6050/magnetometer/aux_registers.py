"""The MPU-6050's registers of its auxiliary I2C bus, as pages of RM-MPU-6000A-00 rev 4.2, and opening the bypass."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from quavelet.core.errors import ChipUnstable
from quavelet.mpu6050 import registers as r
from quavelet.mpu6050.access import RegisterAccess

SLV_ADDR = tuple(r.Register(0x25 + 3 * n, f"I2C_SLV{n}_ADDR", 19) for n in range(4))
SLV_REG = tuple(r.Register(0x26 + 3 * n, f"I2C_SLV{n}_REG", 19) for n in range(4))
SLV_CTRL = tuple(r.Register(0x27 + 3 * n, f"I2C_SLV{n}_CTRL", 19) for n in range(4))
SLV_DO = tuple(r.Register(0x63 + n, f"I2C_SLV{n}_DO", 34) for n in range(4))
SLV4_ADDR = r.Register(0x31, "I2C_SLV4_ADDR", 22)
SLV4_REG = r.Register(0x32, "I2C_SLV4_REG", 22)
SLV4_DO = r.Register(0x33, "I2C_SLV4_DO", 22)
SLV4_CTRL = r.Register(0x34, "I2C_SLV4_CTRL", 22)
I2C_MST_STATUS = r.Register(0x36, "I2C_MST_STATUS", 24, access="clear")
I2C_MST_DELAY_CTRL = r.Register(0x67, "I2C_MST_DELAY_CTRL", 36)

MULT_MST_EN = r.Field(r.I2C_MST_CTRL, "MULT_MST_EN", 7, 7)
WAIT_FOR_ES = r.Field(r.I2C_MST_CTRL, "WAIT_FOR_ES", 6, 6)
SLV_3_FIFO_EN = r.Field(r.I2C_MST_CTRL, "SLV_3_FIFO_EN", 5, 5)
I2C_MST_CLK = r.Field(r.I2C_MST_CTRL, "I2C_MST_CLK", 3, 0)
I2C_MST_DLY = r.Field(SLV4_CTRL, "I2C_MST_DLY", 4, 0)
STATUS_SLV4_DONE = r.Field(I2C_MST_STATUS, "I2C_SLV4_DONE", 6, 6)
STATUS_SLV4_NACK = r.Field(I2C_MST_STATUS, "I2C_SLV4_NACK", 4, 4)
DELAY_ES_SHADOW = r.Field(I2C_MST_DELAY_CTRL, "DELAY_ES_SHADOW", 7, 7)
I2C_BYPASS_EN = r.Field(r.INT_PIN_CFG, "I2C_BYPASS_EN", 1, 1)
USER_I2C_MST_RESET = r.Field(r.USER_CTRL, "I2C_MST_RESET", 1, 1)

SLV_READ = 0x80
"""In I2C_SLVn_ADDR, above the 7-bit address."""
SLV_EN = 0x80
"""In I2C_SLVn_CTRL, beside the length in bits 3:0."""
CLOCK_400_KHZ = 13
LONGEST_DELAY = I2C_MST_DLY.mask
USER_KEPT = 0xF0
"""Bits of USER_CTRL that stay as they are written; the others reset something and fall back by themselves."""


@contextmanager
def aux_bus_kept(chip: RegisterAccess) -> Iterator[None]:
    """The chip is awake within; at the end sleep, bypass and the master's switch are as before. Raises BusError."""
    power = chip.read(r.PWR_MGMT_1)
    user, pin = chip.read(r.USER_CTRL) & USER_KEPT, chip.read(r.INT_PIN_CFG)
    try:
        if power & r.SLEEP.mask:  # writes to other registers are lost while the chip sleeps
            chip.write(r.PWR_MGMT_1, power & ~r.SLEEP.mask)
        yield
    finally:
        # In this order master and bypass are never on the wires together.
        rows = [(r.INT_PIN_CFG, pin), (r.USER_CTRL, user)]
        for register, byte in reversed(rows) if pin & I2C_BYPASS_EN.mask else rows:
            chip.write(register, byte)
        if power & r.SLEEP.mask:
            chip.write(r.PWR_MGMT_1, power)


def open_bypass(chip: RegisterAccess) -> None:
    """Connect the auxiliary wires to the outer ones: the master must be off for it (RM p. 26).

    Raises BusError, and ChipUnstable where the chip does not take it.
    """
    chip.write(r.USER_CTRL, chip.read(r.USER_CTRL) & USER_KEPT & ~r.USER_I2C_MST_EN.mask)
    chip.write(r.INT_PIN_CFG, chip.read(r.INT_PIN_CFG) | I2C_BYPASS_EN.mask)
    if not chip.read(r.INT_PIN_CFG) & I2C_BYPASS_EN.mask:
        raise ChipUnstable(
            f"the chip at 0x{chip.address:02x} does not open its bypass: it may sleep, wake it and try again"
        )


def close_bypass(chip: RegisterAccess) -> None:
    """Part the auxiliary wires from the outer ones. Raises BusError."""
    chip.write(r.INT_PIN_CFG, chip.read(r.INT_PIN_CFG) & ~I2C_BYPASS_EN.mask & 0xFF)
