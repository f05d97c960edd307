"""The registers of the MPU-6050: numbers, power-up values, and what a write may change.

Written from the register map RM-MPU-6000A-00 rev 4.2 ("RM"), not from the driver, so that the two can disagree.
"""

from __future__ import annotations

XG_OFFS_TC = 0x00
ACCEL_OFFSETS = 0x06  # to 0x0B: X, Y, Z, high byte first; not in the RM, but in the silicon
SELF_TEST_X = 0x0D  # to 0x10 (RM registers 13 to 16)
GYRO_OFFSETS = 0x13  # to 0x18: X, Y, Z, high byte first; not in the RM
SMPLRT_DIV = 0x19
CONFIG = 0x1A
GYRO_CONFIG = 0x1B
ACCEL_CONFIG = 0x1C
FIFO_EN = 0x23
I2C_SLV4_DI = 0x35
I2C_MST_STATUS = 0x36
INT_PIN_CFG = 0x37
INT_ENABLE = 0x38
INT_STATUS = 0x3A
ACCEL_XOUT_H = 0x3B
GYRO_ZOUT_L = 0x48
EXT_SENS_DATA_23 = 0x60
MOT_DETECT_STATUS = 0x61
SIGNAL_PATH_RESET = 0x68
USER_CTRL = 0x6A
PWR_MGMT_1 = 0x6B
PWR_MGMT_2 = 0x6C
FIFO_COUNTH = 0x72
FIFO_COUNTL = 0x73
FIFO_R_W = 0x74
WHO_AM_I = 0x75
COUNT = 0x80

# INT_PIN_CFG
INT_LEVEL = 0x80  # active low
LATCH_INT_EN = 0x20
INT_RD_CLEAR = 0x10

# INT_ENABLE, INT_STATUS
DATA_RDY_INT = 0x01
FIFO_OFLOW_INT = 0x10

# USER_CTRL
USER_FIFO_EN = 0x40
USER_I2C_MST_EN = 0x20
USER_FIFO_RESET = 0x04
USER_SIG_COND_RESET = 0x01

# PWR_MGMT_1
DEVICE_RESET = 0x80
SLEEP = 0x40
TEMP_DIS = 0x08
CLKSEL = 0x07

# RM 3: all registers reset to 0 except these two. Bit 0 of 0x00 is OTP_BNK_VLD, set on every real part;
# a Linux 6.1 kernel driver reads that register as an interrupt status and drops all data where it is 0.
POWER_UP = {XG_OFFS_TC: 0x01, PWR_MGMT_1: SLEEP, WHO_AM_I: 0x68}

# The factory's own: offset trim of one plausible part (bit 0 of the three low bytes reads revision 2, the
# full-scale silicon) and the self-test codes of a real part (XA 10, YA 9, ZA 21, XG 17, YG 15, ZG 24).
ACCEL_TRIM = (-2100, 801, 1200)
SELF_TEST_CODES = (0x51, 0x4F, 0xB8, 0xA5)

# What sticks of a written byte, where not all of it does: reserved bits stay 0, reset bits clear themselves.
STICKS = {
    CONFIG: 0x3F,
    GYRO_CONFIG: 0xF8,
    INT_PIN_CFG: 0xFE,
    INT_ENABLE: 0xF9,
    USER_CTRL: 0xE0,
    PWR_MGMT_1: 0x6F,
    SIGNAL_PATH_RESET: 0x00,
}

READ_ONLY = frozenset(
    [I2C_SLV4_DI, I2C_MST_STATUS, FIFO_COUNTH, FIFO_COUNTL, WHO_AM_I, *range(INT_STATUS, MOT_DETECT_STATUS + 1)]
)

# Users see configuration written to a sleeping chip get lost; only power and the reset bits work then.
WRITABLE_ASLEEP = frozenset([SIGNAL_PATH_RESET, USER_CTRL, PWR_MGMT_1, PWR_MGMT_2])
