"""What the configuration registers say, decoded."""

from __future__ import annotations

import struct
from dataclasses import dataclass

from hw_fakes.chip import registers as reg
from hw_fakes.chip.personalities import MPU6050, Personality

GYRO_LSB_PER_DPS = (131.0, 65.5, 32.8, 16.4)
ACCEL_LSB_PER_G = (16384.0, 8192.0, 4096.0, 2048.0)

# Which of the seven words (accelerometer x y z, temperature, gyroscope x y z) each bit of FIFO_EN sends to the
# FIFO: always in the order of the register numbers (RM register 35).
_FIFO_WORDS = ((0x08, (0, 1, 2)), (0x80, (3,)), (0x40, (4,)), (0x20, (5,)), (0x10, (6,)))
_STANDBY_WORDS = ((0x20, 0), (0x10, 1), (0x08, 2), (0x04, 4), (0x02, 5), (0x01, 6))

# Cycling, the chip wakes at 1.25, 5, 20 or 40 Hz: after so many outputs of 1 kHz (RM register 108).
_WAKE_TICKS = (800, 200, 50, 25)
NO_FILTER = ("none", 0)


@dataclass(frozen=True, slots=True)
class Setup:
    """The chip's configuration; words are numbered 0 to 6: accelerometer x y z, temperature, gyroscope x y z.

    awake           it samples
    on_pll          the sample clock is a gyroscope's, not the internal oscillator's
    cycle           it wakes for single samples and sleeps between
    gyro_hz         outputs of the gyroscope a second, nominally
    divider         samples are every `divider`-th output of the gyroscope
    gyro_filter     which table of `dlpf` the gyroscope's filter is in, and where
    accel_filter    likewise
    self_test       word numbers under self-test
    accel_offset    the registers as they stand, bit 0 removed, 2048 LSB per g
    gyro_offset     the registers as they stand, 32.8 LSB per deg/s
    frozen          word numbers in standby
    fifo_words      word numbers that go into the FIFO, in order; empty while the FIFO is off
    """

    awake: bool
    on_pll: bool
    cycle: bool
    gyro_hz: int
    divider: int
    gyro_filter: tuple[str, int]
    accel_filter: tuple[str, int]
    gyro_lsb_per_dps: float
    accel_lsb_per_g: float
    self_test: tuple[int, ...]
    accel_offset: tuple[int, int, int]
    gyro_offset: tuple[int, int, int]
    frozen: tuple[int, ...]
    fifo_words: tuple[int, ...]


def decode(registers: bytes | bytearray, *, personality: Personality = MPU6050) -> Setup:
    """The setup that a register file of 128 bytes stands for."""
    power, clksel = registers[reg.PWR_MGMT_1], registers[reg.PWR_MGMT_1] & reg.CLKSEL
    gyro, accel = registers[reg.GYRO_CONFIG], registers[reg.ACCEL_CONFIG]
    frozen = _frozen(registers, personality)
    cycle, gyro_hz, divider = _timing(registers, personality)
    x, y, z = (struct.unpack_from(">h", registers, address)[0] & ~1 for address in personality.accel_offsets)
    fifo_on = registers[reg.USER_CTRL] & reg.USER_FIFO_EN
    return Setup(
        awake=not power & (reg.SLEEP | reg.DEVICE_RESET) and clksel != 7,  # 7 stops the clock (RM register 107)
        # With the clock's own gyroscope in standby the chip falls back to its internal oscillator (RM register 107); so
        # it does here for the external clocks 4 and 5, which no board wires, and while it cycles.
        on_pll=1 <= clksel <= 3 and clksel + 3 not in frozen and not cycle,
        cycle=cycle,
        gyro_hz=gyro_hz,
        divider=divider,
        gyro_filter=NO_FILTER if cycle else _gyro_filter(registers, personality),
        accel_filter=NO_FILTER if cycle else _accel_filter(registers, personality),
        gyro_lsb_per_dps=GYRO_LSB_PER_DPS[gyro >> 3 & 3],
        accel_lsb_per_g=ACCEL_LSB_PER_G[accel >> 3 & 3] * personality.accel_gain,
        self_test=(
            *(word for word in range(3) if accel & 0x80 >> word),
            *(4 + word for word in range(3) if gyro & 0x80 >> word),
        ),
        accel_offset=(x, y, z),
        gyro_offset=struct.unpack_from(">3h", registers, reg.GYRO_OFFSETS),
        frozen=frozen,
        fifo_words=tuple(w for bit, words in _FIFO_WORDS if fifo_on and registers[reg.FIFO_EN] & bit for w in words),
    )


def _frozen(registers: bytes | bytearray, personality: Personality) -> tuple[int, ...]:
    power, standby = registers[reg.PWR_MGMT_1], registers[reg.PWR_MGMT_2]
    if personality.class_6500 and power & reg.GYRO_STANDBY:
        standby |= 0x07
    frozen = [word for bit, word in _STANDBY_WORDS if standby & bit]
    if power & reg.TEMP_DIS:
        frozen.append(3)
    return tuple(frozen)


def _timing(registers: bytes | bytearray, personality: Personality) -> tuple[bool, int, int]:
    """Whether the chip cycles, outputs of the gyroscope a second, and how many of them make a sample."""
    if registers[reg.PWR_MGMT_1] & reg.CYCLE:
        if personality.class_6500:  # RM9250 register 30: 500 Hz, 250 Hz, ... 0.24 Hz, and 12 to 15 are reserved
            return True, 1000, 2 << max(0, 11 - (registers[reg.LP_ACCEL_ODR] & 0x0F))
        return True, 1000, _WAKE_TICKS[registers[reg.PWR_MGMT_2] >> 6]
    _, setting = _gyro_filter(registers, personality)
    gyro_hz = {0: 8000, 7: 8000, 8: 32000, 9: 32000}.get(setting, 1000)
    # RM9250 register 25: the 6500 class divides 1 kHz only.
    divides = gyro_hz == 1000 or not personality.class_6500
    return False, gyro_hz, 1 + registers[reg.SMPLRT_DIV] if divides else 1


def _gyro_filter(registers: bytes | bytearray, personality: Personality) -> tuple[str, int]:
    setting = registers[reg.CONFIG] & 7
    if not personality.class_6500:
        return "gyro", setting
    # FCHOICE_B goes round the filter, bit 0 before bit 1 (RM9250 register 27).
    return "own gyro", (setting, 8, 9, 8)[registers[reg.GYRO_CONFIG] & 3]


def _accel_filter(registers: bytes | bytearray, personality: Personality) -> tuple[str, int]:
    byte = registers[personality.accel_filter]
    if not personality.class_6500:
        return "accel", byte & 7
    return "own accel", 7 if byte & 8 else byte & 7  # ACCEL_FCHOICE_B goes round the filter
