"""What the configuration registers say, decoded."""

from __future__ import annotations

import struct
from dataclasses import dataclass

from hw_fakes import registers as reg
from hw_fakes.personalities import MPU6050, Personality

GYRO_LSB_PER_DPS = (131.0, 65.5, 32.8, 16.4)
ACCEL_LSB_PER_G = (16384.0, 8192.0, 4096.0, 2048.0)

# Which of the seven words (accelerometer x y z, temperature, gyroscope x y z) each bit of FIFO_EN sends to the
# FIFO: always in the order of the register numbers (RM register 35).
_FIFO_WORDS = ((0x08, (0, 1, 2)), (0x80, (3,)), (0x40, (4,)), (0x20, (5,)), (0x10, (6,)))
_STANDBY_WORDS = ((0x20, 0), (0x10, 1), (0x08, 2), (0x04, 4), (0x02, 5), (0x01, 6))


@dataclass(frozen=True, slots=True)
class Setup:
    """The chip's configuration; words are numbered 0 to 6: accelerometer x y z, temperature, gyroscope x y z.

    awake           it samples
    on_pll          the sample clock is a gyroscope's, not the internal oscillator's
    divider         samples are every `divider`-th output of the gyroscope
    dlpf            DLPF_CFG
    accel_filter    which table the accelerometer's filter is in, and where
    self_test       word numbers under self-test
    accel_offset    the registers as they stand, bit 0 removed, 2048 LSB per g
    gyro_offset     the registers as they stand, 32.8 LSB per deg/s
    frozen          word numbers in standby
    fifo_words      word numbers that go into the FIFO, in order; empty while the FIFO is off
    """

    awake: bool
    on_pll: bool
    divider: int
    dlpf: int
    accel_filter: tuple[str, int]
    gyro_lsb_per_dps: float
    accel_lsb_per_g: float
    self_test: tuple[int, ...]
    accel_offset: tuple[int, int, int]
    gyro_offset: tuple[int, int, int]
    frozen: tuple[int, ...]
    fifo_words: tuple[int, ...]

    @property
    def fast(self) -> bool:
        """The gyroscope gives 8 kHz, not 1 kHz: the low-pass filter is off (RM register 25)."""
        return self.dlpf in (0, 7)


def decode(registers: bytes | bytearray, *, personality: Personality = MPU6050) -> Setup:
    """The setup that a register file of 128 bytes stands for."""
    power, standby, clksel = (
        registers[reg.PWR_MGMT_1],
        registers[reg.PWR_MGMT_2],
        registers[reg.PWR_MGMT_1] & reg.CLKSEL,
    )
    gyro, accel = registers[reg.GYRO_CONFIG], registers[reg.ACCEL_CONFIG]
    x, y, z = (struct.unpack_from(">h", registers, address)[0] & ~1 for address in personality.accel_offsets)
    accel_dlpf = registers[personality.accel_filter] & 7
    if personality.own_accel_filter and registers[personality.accel_filter] & 8:
        accel_dlpf = 7  # ACCEL_FCHOICE_B goes round the filter
    fifo_on = registers[reg.USER_CTRL] & reg.USER_FIFO_EN
    frozen = [word for bit, word in _STANDBY_WORDS if standby & bit]
    if power & reg.TEMP_DIS:
        frozen.append(3)
    return Setup(
        awake=not power & (reg.SLEEP | reg.DEVICE_RESET) and clksel != 7,  # 7 stops the clock (RM register 107)
        # With the clock's own gyroscope in standby the chip falls back to its internal oscillator (RM register 107); so
        # it does here for the external clocks 4 and 5, which no board wires.
        on_pll=1 <= clksel <= 3 and clksel + 3 not in frozen,
        divider=1 + registers[reg.SMPLRT_DIV],
        dlpf=registers[reg.CONFIG] & 7,
        accel_filter=("own accel" if personality.own_accel_filter else "accel", accel_dlpf),
        gyro_lsb_per_dps=GYRO_LSB_PER_DPS[gyro >> 3 & 3],
        accel_lsb_per_g=ACCEL_LSB_PER_G[accel >> 3 & 3],
        self_test=(
            *(word for word in range(3) if accel & 0x80 >> word),
            *(4 + word for word in range(3) if gyro & 0x80 >> word),
        ),
        accel_offset=(x, y, z),
        gyro_offset=struct.unpack_from(">3h", registers, reg.GYRO_OFFSETS),
        frozen=tuple(frozen),
        fifo_words=tuple(w for bit, words in _FIFO_WORDS if fifo_on and registers[reg.FIFO_EN] & bit for w in words),
    )
