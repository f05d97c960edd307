"""The registers of the MPU-6050: numbers, power-up values, and what a write may change.

Written from the register map RM-MPU-6000A-00 rev 4.2 ("RM"), not from the driver, so that the two can disagree.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

ACCEL_OFFSETS = 0x06  # to 0x0B: X, Y, Z, high byte first; not in the RM, but in the silicon
PRODUCT_ID = 0x0C
SELF_TEST_X = 0x0D  # to 0x10 (RM registers 13 to 16)
GYRO_OFFSETS = 0x13  # to 0x18: X, Y, Z, high byte first; not in the RM
SMPLRT_DIV = 0x19
CONFIG = 0x1A
GYRO_CONFIG = 0x1B
ACCEL_CONFIG = 0x1C
FF_THR = 0x1D  # to ZRMOT_DUR, in the RM before rev 4.2; 0x1D and 0x1E are others in the 6500 class
MOT_THR = 0x1F  # WOM_THR in the 6500 class
ZRMOT_DUR = 0x22
LP_ACCEL_ODR = 0x1E  # of the 6500 class (RM9250 register 30)
FIFO_EN = 0x23
I2C_MST_STATUS = 0x36
INT_PIN_CFG = 0x37
INT_ENABLE = 0x38
DMP_INT_STATUS = 0x39
INT_STATUS = 0x3A
ACCEL_XOUT_H = 0x3B
GYRO_ZOUT_L = 0x48
EXT_SENS_DATA = 0x49  # to 0x60
MOT_DETECT_STATUS = 0x61
SIGNAL_PATH_RESET = 0x68
MOT_DETECT_CTRL = 0x69
ACCEL_INTEL_CTRL = 0x69  # of the 6500 class (RM9250 register 105)
USER_CTRL = 0x6A
PWR_MGMT_1 = 0x6B
PWR_MGMT_2 = 0x6C
BANK_SEL = 0x6D
MEM_START_ADDR = 0x6E
MEM_R_W = 0x6F
FIFO_COUNTH = 0x72
FIFO_COUNTL = 0x73
FIFO_R_W = 0x74
WHO_AM_I = 0x75
COUNT = 0x80

# CONFIG
FIFO_MODE = 0x40  # of the 6500 class: a full FIFO takes nothing more

# INT_PIN_CFG
INT_LEVEL = 0x80  # active low
LATCH_INT_EN = 0x20
INT_RD_CLEAR = 0x10

# INT_ENABLE, INT_STATUS
DATA_RDY_INT = 0x01
I2C_MST_INT = 0x08
FIFO_OFLOW_INT = 0x10
ZMOT_INT = 0x20
MOT_INT = 0x40
FF_INT = 0x80

# MOT_DETECT_STATUS
AT_REST = 0x01

# SIGNAL_PATH_RESET
ACCEL_RESET = 0x02

# USER_CTRL
USER_FIFO_EN = 0x40
USER_I2C_MST_EN = 0x20
USER_FIFO_RESET = 0x04
USER_I2C_MST_RESET = 0x02
USER_SIG_COND_RESET = 0x01

# PWR_MGMT_1
DEVICE_RESET = 0x80
SLEEP = 0x40
CYCLE = 0x20
GYRO_STANDBY = 0x10  # of the 6500 class
TEMP_DIS = 0x08
CLKSEL = 0x07

# The factory's own: offset trim of one plausible part (bit 0 of the three low bytes reads revision 2, the
# full-scale silicon) and the self-test codes of a real part (XA 10, YA 9, ZA 21, XG 17, YG 15, ZG 24).
ACCEL_TRIM = (-2100, 801, 1200)
SELF_TEST_CODES = (0x51, 0x4F, 0xB8, 0xA5)


@dataclass(frozen=True, slots=True)
class Register:
    """One register.

    reset     its value after power-up; the factory's own values in a chip may stand in its place
    access    "rw", "r", or "w": a port, or written for its effect, and never stored
    sticks    the bits of a written byte that are kept: reserved bits stay 0, reset bits clear themselves
    modelled  False: it is a byte of memory, or stays at its reset value, and has no effect
    """

    address: int
    name: str
    reset: int = 0
    access: str = "rw"
    sticks: int = 0xFF
    modelled: bool = True


def _rows() -> Iterator[Register]:
    for first, last, names, reset, access, sticks, modelled in _RANGES:
        for address in range(first, last + 1):
            name = names.split(", ")[address - first] if ", " in names else names
            yield Register(address, name, reset, access, sticks if access == "rw" else 0, modelled)


# First and last address, name or names with commas between, reset value, access, what sticks, modelled. RM 3: all
# registers reset to 0 except PWR_MGMT_1 and WHO_AM_I. Bit 0 of 0x00 is OTP_BNK_VLD, set on every real part; a Linux 6.1
# kernel driver reads that register as an interrupt status and drops all data where it is 0. Names without a place in RM
# rev 4.2 are those of its earlier revisions and of the vendor's driver, or "reserved". The older chips' are listed:
# 0x00 to 0x02, 0x0D to 0x0F and 0x1D to 0x22, 0x69 and 0x77 to 0x7E are others in the 6500 class.
_RANGES = (
    # Trim of the analogue parts: kept, and without effect.
    (0x00, 0x00, "XG_OFFS_TC", 0x01, "rw", 0xFF, False),
    (0x01, 0x02, "YG_OFFS_TC, ZG_OFFS_TC", 0, "rw", 0xFF, False),
    (0x03, 0x05, "X_FINE_GAIN, Y_FINE_GAIN, Z_FINE_GAIN", 0, "rw", 0xFF, False),
    (0x06, 0x0B, "XA_OFFS_H, XA_OFFS_L, YA_OFFS_H, YA_OFFS_L, ZA_OFFS_H, ZA_OFFS_L", 0, "rw", 0xFF, True),
    (0x0C, 0x0C, "PRODUCT_ID", 0, "rw", 0xFF, False),
    (0x0D, 0x10, "SELF_TEST_X, SELF_TEST_Y, SELF_TEST_Z, SELF_TEST_A", 0, "rw", 0xFF, True),
    (0x11, 0x12, "reserved", 0, "rw", 0xFF, False),
    (0x13, 0x15, "XG_OFFS_USRH, XG_OFFS_USRL, YG_OFFS_USRH", 0, "rw", 0xFF, True),
    (0x16, 0x18, "YG_OFFS_USRL, ZG_OFFS_USRH, ZG_OFFS_USRL", 0, "rw", 0xFF, True),
    (0x19, 0x19, "SMPLRT_DIV", 0, "rw", 0xFF, True),
    (0x1A, 0x1A, "CONFIG", 0, "rw", 0x3F, True),
    (0x1B, 0x1B, "GYRO_CONFIG", 0, "rw", 0xF8, True),
    (0x1C, 0x1C, "ACCEL_CONFIG", 0, "rw", 0xFF, True),
    (0x1D, 0x22, "FF_THR, FF_DUR, MOT_THR, MOT_DUR, ZRMOT_THR, ZRMOT_DUR", 0, "rw", 0xFF, True),
    (0x23, 0x23, "FIFO_EN", 0, "rw", 0xFF, True),
    # The auxiliary master's, which do nothing where the chip has no auxiliary bus.
    (0x24, 0x24, "I2C_MST_CTRL", 0, "rw", 0xFF, True),
    (0x25, 0x27, "I2C_SLV0_ADDR, I2C_SLV0_REG, I2C_SLV0_CTRL", 0, "rw", 0xFF, True),
    (0x28, 0x2A, "I2C_SLV1_ADDR, I2C_SLV1_REG, I2C_SLV1_CTRL", 0, "rw", 0xFF, True),
    (0x2B, 0x2D, "I2C_SLV2_ADDR, I2C_SLV2_REG, I2C_SLV2_CTRL", 0, "rw", 0xFF, True),
    (0x2E, 0x30, "I2C_SLV3_ADDR, I2C_SLV3_REG, I2C_SLV3_CTRL", 0, "rw", 0xFF, True),
    (0x31, 0x34, "I2C_SLV4_ADDR, I2C_SLV4_REG, I2C_SLV4_DO, I2C_SLV4_CTRL", 0, "rw", 0xFF, True),
    (0x35, 0x36, "I2C_SLV4_DI, I2C_MST_STATUS", 0, "r", 0, True),
    (0x37, 0x37, "INT_PIN_CFG", 0, "rw", 0xFE, True),
    (0x38, 0x38, "INT_ENABLE", 0, "rw", 0xF9, True),
    (0x39, 0x39, "DMP_INT_STATUS", 0, "r", 0, False),
    (0x3A, 0x3A, "INT_STATUS", 0, "r", 0, True),
    (0x3B, 0x40, "ACCEL_XOUT_H, ACCEL_XOUT_L, ACCEL_YOUT_H, ACCEL_YOUT_L, ACCEL_ZOUT_H, ACCEL_ZOUT_L", 0, "r", 0, True),
    (0x41, 0x42, "TEMP_OUT_H, TEMP_OUT_L", 0, "r", 0, True),
    (0x43, 0x48, "GYRO_XOUT_H, GYRO_XOUT_L, GYRO_YOUT_H, GYRO_YOUT_L, GYRO_ZOUT_H, GYRO_ZOUT_L", 0, "r", 0, True),
    (0x49, 0x60, ", ".join(f"EXT_SENS_DATA_{n:02}" for n in range(24)), 0, "r", 0, True),
    (0x61, 0x61, "MOT_DETECT_STATUS", 0, "r", 0, True),
    (0x62, 0x62, "reserved", 0, "rw", 0xFF, False),
    (0x63, 0x66, "I2C_SLV0_DO, I2C_SLV1_DO, I2C_SLV2_DO, I2C_SLV3_DO", 0, "rw", 0xFF, True),
    (0x67, 0x67, "I2C_MST_DELAY_CTRL", 0, "rw", 0xFF, True),
    (0x68, 0x68, "SIGNAL_PATH_RESET", 0, "w", 0, True),
    (0x69, 0x69, "MOT_DETECT_CTRL", 0, "rw", 0xFF, True),
    (0x6A, 0x6A, "USER_CTRL", 0, "rw", 0xE0, True),
    (0x6B, 0x6B, "PWR_MGMT_1", SLEEP, "rw", 0x6F, True),
    (0x6C, 0x6C, "PWR_MGMT_2", 0, "rw", 0xFF, True),
    (0x6D, 0x6E, "BANK_SEL, MEM_START_ADDR", 0, "rw", 0xFF, True),
    (0x6F, 0x6F, "MEM_R_W", 0, "w", 0, True),
    # Where the motion processor, which is not there, would begin.
    (0x70, 0x71, "DMP_CFG_1, DMP_CFG_2", 0, "rw", 0xFF, False),
    (0x72, 0x73, "FIFO_COUNTH, FIFO_COUNTL", 0, "r", 0, True),
    (0x74, 0x74, "FIFO_R_W", 0, "w", 0, True),
    (0x75, 0x75, "WHO_AM_I", 0x68, "r", 0, True),
    (0x76, 0x7F, "reserved", 0, "rw", 0xFF, False),
)

REGISTERS = tuple(_rows())
POWER_UP = bytes(register.reset for register in REGISTERS)

# Users see configuration written to a sleeping chip get lost; only power and the reset bits work then.
WRITABLE_ASLEEP = frozenset([SIGNAL_PATH_RESET, USER_CTRL, PWR_MGMT_1, PWR_MGMT_2])
