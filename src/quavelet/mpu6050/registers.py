"""The MPU-6050's register map as data: RM-MPU-6000A-00 rev 4.2 (the register map), page by page.

Registers that rev 4.2 does not document are on page 0 and say where they are known from; "RM9250" is
RM-MPU-9250A-00 rev 1.6, of the MPU-6500's class.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace


@dataclass(frozen=True, slots=True)
class Register:
    """One 8-bit register, or the first of a run of `length`.

    reset is the value after power-up; None where the factory writes trim that differs from chip to chip.
    access is "rw", "r" or "clear" (reading has an effect). known_from is empty where the page says all.
    class_6500: only the MPU-6500's class has it, at an address where the MPU-6050 may have another.
    """

    address: int
    name: str
    page: int
    reset: int | None = 0x00
    access: str = "rw"
    length: int = 1
    known_from: str = ""
    class_6500: bool = False

    def byte(self, k: int) -> Register:
        """Byte number `k` of the run, by itself."""
        if not 0 <= k < self.length:
            raise ValueError(f"{self.name} has no byte {k}: it has {self.length}")
        return replace(self, address=self.address + k, name=f"{self.name}[{k}]", length=1)


@dataclass(frozen=True, slots=True)
class Field:
    """Bits `high` to `low` of a register."""

    register: Register
    name: str
    high: int
    low: int

    @property
    def mask(self) -> int:
        """The bits of the field, in place."""
        return ((1 << (self.high - self.low + 1)) - 1) << self.low

    def encode(self, value: int) -> int:
        """`value` moved into place. Raises ValueError when it does not fit."""
        if not 0 <= value <= self.mask >> self.low:
            raise ValueError(f"{self.register.name}.{self.name} cannot hold {value}")
        return value << self.low

    def decode(self, byte: int) -> int:
        """The field's value in a register's byte."""
        return (byte & self.mask) >> self.low


@dataclass(frozen=True, slots=True)
class RegisterBits:
    """Bits to set and bits to clear in one register; bits in neither are left as they are."""

    register: Register
    set_bits: int
    clear_bits: int

    def applied_to(self, byte: int) -> int:
        """What the register must hold if it held `byte`."""
        return (byte & ~self.clear_bits & 0xFF) | self.set_bits

    def and_also(self, other: RegisterBits) -> RegisterBits:
        """Both rows of one register in one; where they differ `other` has its way."""
        return RegisterBits(
            self.register,
            self.set_bits & ~other.clear_bits | other.set_bits,
            self.clear_bits & ~other.set_bits | other.clear_bits,
        )

    def holds(self, byte: int) -> bool:
        """Whether `byte` has all bits as asked."""
        return byte & (self.set_bits | self.clear_bits) == self.set_bits


def joined(rows: Iterable[RegisterBits]) -> tuple[RegisterBits, ...]:
    """One row for each register; where two of one register differ the later has its way."""
    by_address: dict[int, RegisterBits] = {}
    for row in rows:
        before = by_address.get(row.register.address)
        by_address[row.register.address] = before.and_also(row) if before else row
    return tuple(by_address.values())


_OFFSETS_FROM = "InvenSense's motion driver and i2cdevlib"
ACCEL_OFFSETS = (
    Register(0x06, "XA_OFFS", 0, None, length=2, known_from=f"{_OFFSETS_FROM}: factory trim"),
    Register(0x08, "YA_OFFS", 0, None, length=2, known_from=f"{_OFFSETS_FROM}: factory trim"),
    Register(0x0A, "ZA_OFFS", 0, None, length=2, known_from=f"{_OFFSETS_FROM}: factory trim"),
)
PRODUCT_ID = Register(0x0C, "PRODUCT_ID", 0, None, known_from="Betaflight: the low nibble is the revision")
SELF_TEST = Register(0x0D, "SELF_TEST_X", 9, None, length=4)
GYRO_OFFSETS = (
    Register(0x13, "XG_OFFS_USR", 0, length=2, known_from=_OFFSETS_FROM),
    Register(0x15, "YG_OFFS_USR", 0, length=2, known_from=_OFFSETS_FROM),
    Register(0x17, "ZG_OFFS_USR", 0, length=2, known_from=_OFFSETS_FROM),
)
SMPLRT_DIV = Register(0x19, "SMPLRT_DIV", 11)
CONFIG = Register(0x1A, "CONFIG", 13)
GYRO_CONFIG = Register(0x1B, "GYRO_CONFIG", 14)
ACCEL_CONFIG = Register(0x1C, "ACCEL_CONFIG", 15)
ACCEL_CONFIG_2 = Register(0x1D, "ACCEL_CONFIG_2", 0, known_from="RM9250 register 29", class_6500=True)
_BEFORE_REV_42 = "the register map before rev 4.2"
LP_ACCEL_ODR = Register(0x1E, "LP_ACCEL_ODR", 0, known_from="RM9250 register 30", class_6500=True)
MOT_THR = Register(0x1F, "MOT_THR", 0, known_from=f"{_BEFORE_REV_42}; WOM_THR of RM9250 register 31")
MOT_DUR = Register(0x20, "MOT_DUR", 0, known_from=_BEFORE_REV_42)
FIFO_EN = Register(0x23, "FIFO_EN", 16)
I2C_MST_CTRL = Register(0x24, "I2C_MST_CTRL", 17)
INT_PIN_CFG = Register(0x37, "INT_PIN_CFG", 26)
INT_ENABLE = Register(0x38, "INT_ENABLE", 27)
INT_STATUS = Register(0x3A, "INT_STATUS", 28, access="clear")
ACCEL_OUT = Register(0x3B, "ACCEL_XOUT_H", 29, access="r", length=6)
TEMP_OUT = Register(0x41, "TEMP_OUT_H", 30, access="r", length=2)
GYRO_OUT = Register(0x43, "GYRO_XOUT_H", 31, access="r", length=6)
EXT_SENS_DATA = Register(0x49, "EXT_SENS_DATA_00", 32, access="r", length=24)
SIGNAL_PATH_RESET = Register(0x68, "SIGNAL_PATH_RESET", 37)
MOT_DETECT_CTRL = Register(0x69, "MOT_DETECT_CTRL", 0, known_from=_BEFORE_REV_42)
ACCEL_INTEL_CTRL = Register(0x69, "ACCEL_INTEL_CTRL", 0, known_from="RM9250 register 105", class_6500=True)
USER_CTRL = Register(0x6A, "USER_CTRL", 38)
PWR_MGMT_1 = Register(0x6B, "PWR_MGMT_1", 40, 0x40)
PWR_MGMT_2 = Register(0x6C, "PWR_MGMT_2", 42)
FIFO_COUNT = Register(0x72, "FIFO_COUNTH", 43, access="r", length=2)
FIFO_R_W = Register(0x74, "FIFO_R_W", 44, None, access="clear")
WHO_AM_I = Register(0x75, "WHO_AM_I", 45, 0x68, access="r")
GYRO_SELF_TEST_6500 = Register(
    0x00, "SELF_TEST_X_GYRO", 0, None, length=3, known_from="RM9250 registers 0 to 2", class_6500=True
)
ACCEL_SELF_TEST_6500 = Register(
    0x0D, "SELF_TEST_X_ACCEL", 0, None, length=3, known_from="RM9250 registers 13 to 15", class_6500=True
)
ACCEL_OFFSETS_6500 = (
    Register(0x77, "XA_OFFSET", 0, None, length=2, known_from="RM9250 register 119: factory trim", class_6500=True),
    Register(0x7A, "YA_OFFSET", 0, None, length=2, known_from="RM9250 register 122: factory trim", class_6500=True),
    Register(0x7D, "ZA_OFFSET", 0, None, length=2, known_from="RM9250 register 125: factory trim", class_6500=True),
)

REGISTERS: tuple[Register, ...] = (
    *ACCEL_OFFSETS,
    PRODUCT_ID,
    SELF_TEST,
    *GYRO_OFFSETS,
    SMPLRT_DIV,
    CONFIG,
    GYRO_CONFIG,
    ACCEL_CONFIG,
    ACCEL_CONFIG_2,
    LP_ACCEL_ODR,
    MOT_THR,
    MOT_DUR,
    FIFO_EN,
    I2C_MST_CTRL,
    INT_PIN_CFG,
    INT_ENABLE,
    INT_STATUS,
    ACCEL_OUT,
    TEMP_OUT,
    GYRO_OUT,
    EXT_SENS_DATA,
    SIGNAL_PATH_RESET,
    MOT_DETECT_CTRL,
    ACCEL_INTEL_CTRL,
    USER_CTRL,
    PWR_MGMT_1,
    PWR_MGMT_2,
    FIFO_COUNT,
    FIFO_R_W,
    WHO_AM_I,
    GYRO_SELF_TEST_6500,
    ACCEL_SELF_TEST_6500,
    *ACCEL_OFFSETS_6500,
)

EXT_SYNC_SET = Field(CONFIG, "EXT_SYNC_SET", 5, 3)
DLPF_CFG = Field(CONFIG, "DLPF_CFG", 2, 0)
FIFO_MODE = Field(CONFIG, "FIFO_MODE", 6, 6)
"""Of the 6500 class: a full FIFO refuses bytes (RM9250 register 26)."""
GYRO_SELF_TEST = Field(GYRO_CONFIG, "XYZG_ST", 7, 5)
GYRO_FS_SEL = Field(GYRO_CONFIG, "FS_SEL", 4, 3)
GYRO_FCHOICE_B = Field(GYRO_CONFIG, "FCHOICE_B", 1, 0)
"""Of the 6500 class: other than 0, the gyroscope's filter is gone round (RM9250 register 27)."""
ACCEL_SELF_TEST = Field(ACCEL_CONFIG, "XYZA_ST", 7, 5)
ACCEL_FS_SEL = Field(ACCEL_CONFIG, "AFS_SEL", 4, 3)
ACCEL_HPF = Field(ACCEL_CONFIG, "ACCEL_HPF", 2, 0)
FIFO_SIZE = Field(ACCEL_CONFIG_2, "FIFO_SIZE", 7, 6)
"""512 bytes, 1, 2 or 4 KiB; reserved in RM9250, known from InvenSense's motion driver and Linux's inv_mpu6050."""
ACCEL_DLPF_CFG = Field(ACCEL_CONFIG_2, "ACCEL_FCHOICE_B_and_A_DLPF_CFG", 3, 0)
LPOSC_CLKSEL = Field(LP_ACCEL_ODR, "LPOSC_CLKSEL", 3, 0)
FIFO_SENSORS = Field(FIFO_EN, "TEMP_XG_YG_ZG_ACCEL", 7, 3)
FIFO_SLAVES = Field(FIFO_EN, "SLV2_SLV1_SLV0", 2, 0)
INT_LEVEL = Field(INT_PIN_CFG, "INT_LEVEL", 7, 7)
INT_OPEN = Field(INT_PIN_CFG, "INT_OPEN", 6, 6)
LATCH_INT_EN = Field(INT_PIN_CFG, "LATCH_INT_EN", 5, 5)
INT_RD_CLEAR = Field(INT_PIN_CFG, "INT_RD_CLEAR", 4, 4)
FIFO_OFLOW_EN = Field(INT_ENABLE, "FIFO_OFLOW_EN", 4, 4)
MOT_EN = Field(INT_ENABLE, "MOT_EN", 6, 6)
"""Not in rev 4.2, as MOT_INT; WOM_EN and WOM_INT of the 6500 class (RM9250 registers 56 and 58)."""
DATA_RDY_EN = Field(INT_ENABLE, "DATA_RDY_EN", 0, 0)
MOT_INT = Field(INT_STATUS, "MOT_INT", 6, 6)
DATA_RDY_INT = Field(INT_STATUS, "DATA_RDY_INT", 0, 0)
MOT_COUNT = Field(MOT_DETECT_CTRL, "MOT_COUNT", 1, 0)
ACCEL_INTEL = Field(ACCEL_INTEL_CTRL, "ACCEL_INTEL_EN_and_MODE", 7, 6)
FIFO_OFLOW_INT = Field(INT_STATUS, "FIFO_OFLOW_INT", 4, 4)
USER_DMP_EN = Field(USER_CTRL, "DMP_EN", 7, 7)
USER_FIFO_EN = Field(USER_CTRL, "FIFO_EN", 6, 6)
USER_I2C_MST_EN = Field(USER_CTRL, "I2C_MST_EN", 5, 5)
USER_FIFO_RESET = Field(USER_CTRL, "FIFO_RESET", 2, 2)
DEVICE_RESET = Field(PWR_MGMT_1, "DEVICE_RESET", 7, 7)
SLEEP = Field(PWR_MGMT_1, "SLEEP", 6, 6)
CYCLE = Field(PWR_MGMT_1, "CYCLE", 5, 5)
GYRO_STANDBY = Field(PWR_MGMT_1, "GYRO_STANDBY", 4, 4)
"""Of the 6500 class (RM9250 register 107)."""
TEMP_DIS = Field(PWR_MGMT_1, "TEMP_DIS", 3, 3)
CLKSEL = Field(PWR_MGMT_1, "CLKSEL", 2, 0)
STANDBY = Field(PWR_MGMT_2, "LP_WAKE_CTRL_and_STBY", 7, 0)
LP_WAKE_CTRL = Field(PWR_MGMT_2, "LP_WAKE_CTRL", 7, 6)
STBY_ACCEL = Field(PWR_MGMT_2, "STBY_XA_YA_ZA", 5, 3)
STBY_GYRO = Field(PWR_MGMT_2, "STBY_XG_YG_ZG", 2, 0)

CLOCK_PLL_GYRO_X = 1
"""CLKSEL: PLL on the gyroscope's x axis, 1 % (PS 6.6) where the internal oscillator is 5 %."""
FIFO_ACCEL_TEMP_GYRO = 0b11111
"""FIFO_SENSORS: accelerometer, temperature, gyroscope; frames of 14 bytes in the order of the registers."""
FRAME_BYTES = 14


def fifo_en(slaves: int = 0) -> int:
    """FIFO_EN for frames of all sensors, and of so many slaves of the chip's I2C master, the first ones (RM p. 16)."""
    return FIFO_SENSORS.encode(FIFO_ACCEL_TEMP_GYRO) | FIFO_SLAVES.encode((1 << slaves) - 1)
