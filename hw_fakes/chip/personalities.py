"""The family: what the MPU-6050's relatives and the clones sold under its name do differently."""

from __future__ import annotations

import struct
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from hw_fakes.chip import registers as reg

# What a write to a register of the 6500 class keeps, where it is not what the MPU-6050 keeps (RM9250 3).
_STICKS_6500 = {
    reg.CONFIG: 0x7F,
    reg.GYRO_CONFIG: 0xFB,
    reg.ACCEL_CONFIG: 0xF8,
    reg.LP_ACCEL_ODR: 0x0F,
    reg.INT_ENABLE: 0x59,
    reg.ACCEL_INTEL_CTRL: 0xC0,
    reg.PWR_MGMT_1: 0x7F,
    reg.PWR_MGMT_2: 0x3F,
}
# Gyroscope, then accelerometer, x y z: 80 to 114 deg/s, and 0.41 to 0.52 g, the middle of what the vendor's driver
# takes where there are no codes.
_RELATIVE_CODES = (0x8D, 0x90, 0xB0, 0x60, 0x68, 0x78)


@dataclass(frozen=True, slots=True)
class Personality:
    """One chip of the family. Those of the 6500 class follow RM-MPU-9250A-00 rev 1.6 ("RM9250").

    power_up            PWR_MGMT_1 after a reset
    temp_lsb_per_degc   and `temp_zero_degc`, where the temperature word is 0
    fifo_bytes          by the two top bits of register 0x1D where there are four, which is the 6500 class
    accel_filter        the register that sets the accelerometer's filter; CONFIG where it shares the gyroscope's
    accel_offsets       addresses of the high bytes, x y z; the low byte follows
    self_test           addresses of the factory's codes
    self_test_codes     what those hold where nothing else is asked for
    accel_gain          counts per g, over those of the data sheet
    revision            what bit 0 of the accelerometer's three offset words says, x the lowest; None: as in its trim
    product_id          register 0x0C
    """

    name: str
    who_am_i: int = 0x68
    power_up: int = reg.SLEEP
    temp_lsb_per_degc: float = 340.0
    temp_zero_degc: float = 36.53
    fifo_bytes: tuple[int, ...] = (1024,)
    accel_filter: int = reg.CONFIG
    accel_offsets: tuple[int, int, int] = (0x06, 0x08, 0x0A)
    self_test: tuple[int, ...] = (0x0D, 0x0E, 0x0F, 0x10)
    self_test_codes: tuple[int, ...] = reg.SELF_TEST_CODES
    accel_gain: float = 1.0
    revision: int | None = None
    product_id: int = 0

    @property
    def class_6500(self) -> bool:
        """It is one of those that have filters of their own for the two sensors, and wake on motion."""
        return self.accel_filter != reg.CONFIG

    def power_up_registers(self, accel_trim: tuple[int, int, int], self_test_codes: tuple[int, ...]) -> bytes:
        """The 128 registers after a reset."""
        registers = bytearray(reg.POWER_UP)
        registers[reg.PWR_MGMT_1], registers[reg.WHO_AM_I] = self.power_up, self.who_am_i
        registers[reg.PRODUCT_ID] |= self.product_id
        for axis, (address, trim) in enumerate(zip(self.accel_offsets, accel_trim, strict=True)):
            if self.revision is not None:
                trim = trim & ~1 | self.revision >> axis & 1
            struct.pack_into(">h", registers, address, trim)
        for address, code in zip(self.self_test, self_test_codes, strict=True):
            registers[address] = code
        return bytes(registers)

    def sticks(self, register: int) -> int:
        """The bits of a byte written to `register` that are kept."""
        kept = reg.REGISTERS[register].sticks
        return _STICKS_6500.get(register, kept) if self.class_6500 else kept

    def fifo_size(self, registers: bytes | bytearray) -> int:
        return self.fifo_bytes[registers[self.accel_filter] >> 6 if len(self.fifo_bytes) > 1 else 0]

    def fifo_stops(self, registers: bytes | bytearray) -> bool:
        """Whether a full FIFO refuses bytes (RM9250 register 26) and does not lose the oldest."""
        return self.class_6500 and bool(registers[reg.CONFIG] & reg.FIFO_MODE)

    def self_test_response(self, codes: tuple[int, ...]) -> NDArray[np.float64]:
        """Accelerometer x y z in LSB at +-8 g, then gyroscope x y z in LSB at +-250 deg/s, that the codes stand for."""
        if len(codes) == 4:
            return _response_of_four(codes)
        # RM9250 4.1 and the vendor's tables: 2620 * 1.01^(code - 1) LSB at +-2 g and +-250 deg/s, gyroscope first.
        trim = [2620 * 1.01 ** (code - 1) if code else 0.0 for code in codes]
        return np.array([*(lsb / 4 for lsb in trim[3:]), *trim[:3]])


def _response_of_four(codes: tuple[int, ...]) -> NDArray[np.float64]:
    # RM registers 13 to 16; the gyroscope's y is negative.
    response = np.zeros(6)
    for axis in range(3):
        accel = codes[axis] >> 3 & 0x1C | codes[3] >> (4 - 2 * axis) & 3
        gyro = codes[axis] & 0x1F
        response[axis] = 4096 * 0.34 * (0.92 / 0.34) ** ((accel - 1) / 30) if accel else 0.0
        response[3 + axis] = (-1 if axis == 1 else 1) * 25 * 131 * 1.046 ** (gyro - 1) if gyro else 0.0
    return response


def _relative(
    name: str, who_am_i: int, *, power_up: int = 0x01, lsb_per_degc: float = 333.87, zero_degc: float = 21.0
) -> Personality:
    return Personality(
        name=name,
        who_am_i=who_am_i,
        power_up=power_up,
        temp_lsb_per_degc=lsb_per_degc,
        temp_zero_degc=zero_degc,
        fifo_bytes=(512, 1024, 2048, 4096),
        accel_filter=0x1D,
        accel_offsets=(0x77, 0x7A, 0x7D),
        self_test=(0x00, 0x01, 0x02, 0x0D, 0x0E, 0x0F),
        self_test_codes=_RELATIVE_CODES,
    )


MPU6050 = Personality("MPU-6050")
MPU6000 = Personality("MPU-6000")
MPU9150 = Personality("MPU-9150")
MPU6500 = _relative("MPU-6500", 0x70)
MPU9250 = _relative("MPU-9250", 0x71)
MPU9255 = _relative("MPU-9255", 0x73)
MPU6515 = _relative("MPU-6515", 0x74)
ICM20689 = _relative("ICM-20689", 0x98, power_up=reg.SLEEP, lsb_per_degc=326.8, zero_degc=25.0)

# Early silicon with half the counts per g, told by its revision (Betaflight's and ArduPilot's drivers).
MPU6050_EARLY = replace(MPU6050, name="MPU-6050-early", accel_gain=0.5, revision=1)
# Clones that users report, of which nothing is printed: that they are like their classes, and how they come out of
# their reset, is taken for granted here. Their FIFO is the smallest there is.
CLONE_69 = replace(MPU6050, name="clone-0x69", who_am_i=0x69)
CLONE_72 = replace(MPU6500, name="clone-0x72", who_am_i=0x72, fifo_bytes=(512,))
CLONE_75 = replace(MPU6500, name="clone-0x75", who_am_i=0x75, fifo_bytes=(512,), power_up=reg.SLEEP)

PERSONALITIES = (
    *(MPU6050, MPU6000, MPU9150, MPU6500, MPU9250, MPU9255, MPU6515, ICM20689),
    *(MPU6050_EARLY, CLONE_69, CLONE_72, CLONE_75),
)
