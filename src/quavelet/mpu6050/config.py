"""What the chip is asked to be, and the table of register bits that makes it so."""

from __future__ import annotations

import msgspec

from quavelet.core.errors import SettingsError
from quavelet.mpu6050 import registers as r
from quavelet.mpu6050.offset_plan import OffsetPlan
from quavelet.mpu6050.registers import RegisterBits
from quavelet.mpu6050.variants import Variant

GYRO_LSB_PER_DPS: dict[int, float] = {250: 131.0, 500: 65.5, 1000: 32.8, 2000: 16.4}
"""Full scale in deg/s to counts per deg/s (PS 6.1), in the order of FS_SEL."""
ACCEL_LSB_PER_G: dict[int, float] = {2: 16384.0, 4: 8192.0, 8: 4096.0, 16: 2048.0}
"""Full scale in g to counts per g (PS 6.2), in the order of AFS_SEL."""
GYRO_BANDWIDTH_HZ: tuple[int, ...] = (256, 188, 98, 42, 20, 10, 5)
"""Gyroscope bandwidth by DLPF_CFG (RM p. 13)."""
_MAX_RATE_HZ = 1000
_WRITTEN_AS = 1e-5
"""How far a rate may be from what the divider makes: 166.667 means 1000/6, and six digits are all a message shows."""


class ChipConfig(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Ranges, low-pass filter and sample rate. What the chip cannot do is refused.

    gyro_range_dps   full scale in deg/s; a smaller one resolves more, a larger one survives faster turns
    accel_range_g    full scale in g
    dlpf             low-pass filter, DLPF_CFG of RM p. 13: 0 to 6 are 256, 188, 98, 42, 20, 10 and 5 Hz. More filter,
                     more delay
    sample_rate_hz   what the divider can make: 1000/n, or 8000/n at dlpf 0, and no more than 1000. At least twice the
                     filter's bandwidth, or vibration folds into the angles
    """

    gyro_range_dps: int
    accel_range_g: int
    dlpf: int
    sample_rate_hz: float

    def __post_init__(self) -> None:
        _one_of("gyro_range_dps", self.gyro_range_dps, tuple(GYRO_LSB_PER_DPS))
        _one_of("accel_range_g", self.accel_range_g, tuple(ACCEL_LSB_PER_G))
        _one_of("dlpf", self.dlpf, tuple(range(len(GYRO_BANDWIDTH_HZ))))
        rate = self.sample_rate_hz
        base = gyro_output_rate_hz(self.dlpf)
        slowest = base / 256
        # `not <=` also refuses NaN.
        if not rate <= _MAX_RATE_HZ:
            raise SettingsError(
                f"sample_rate_hz = {rate:g} is too fast: the accelerometer gives 1000 Hz at most (RM p. 11), "
                f"faster frames would repeat it; ask for 1000 or less"
            )
        if not rate >= slowest:
            raise SettingsError(
                f"sample_rate_hz = {rate:g} is too slow: with dlpf = {self.dlpf} the divider reaches down to "
                f"{slowest:g} Hz; ask for more"
            )
        n = base / rate
        if abs(n - round(n)) > _WRITTEN_AS * n:
            below, above = base / (int(n) + 1), base / int(n)
            raise SettingsError(
                f"sample_rate_hz = {rate:g} cannot be made: with dlpf = {self.dlpf} the chip divides {base:g} Hz "
                f"by a whole number; the nearest are {below:g} and {above:g}"
            )

    @property
    def divider(self) -> int:
        """The value of SMPLRT_DIV."""
        return round(gyro_output_rate_hz(self.dlpf) / self.sample_rate_hz) - 1

    def warnings(self) -> list[str]:
        """What is legal and yet seldom meant."""
        bandwidth = GYRO_BANDWIDTH_HZ[self.dlpf]
        if bandwidth > self.sample_rate_hz / 2:
            return [
                f"dlpf = {self.dlpf} lets through {bandwidth} Hz, above half of sample_rate_hz = "
                f"{self.sample_rate_hz:g}: vibration will fold into the angles; take a larger dlpf or a faster rate"
            ]
        return []


def configuration_table(
    config: ChipConfig, *, variant: Variant, offsets: OffsetPlan | None = None, data_ready: bool = False
) -> tuple[RegisterBits, ...]:
    """The rows to write to this kind of chip, in order, then to read back; the FIFO is off until it is started.

    data_ready   the INT pin gives a pulse with each sample
    Raises SettingsError where this kind of chip cannot be had as asked.
    """
    if variant.class_6500 and config.dlpf == 0:
        raise SettingsError(
            f"dlpf = 0 does not go with this chip, an {variant.name}: it would give 8000 samples a second whatever is "
            f"asked for (RM9250 register 25); take dlpf = 1 to 6"
        )
    gyro = r.GYRO_FS_SEL.encode(list(GYRO_LSB_PER_DPS).index(config.gyro_range_dps))
    accel = r.ACCEL_FS_SEL.encode(list(ACCEL_LSB_PER_G).index(config.accel_range_g))
    power = r.DEVICE_RESET.mask | r.SLEEP.mask | r.CYCLE.mask | r.TEMP_DIS.mask | r.CLKSEL.mask
    filters = r.EXT_SYNC_SET.mask | r.DLPF_CFG.mask
    gyro_bits = r.GYRO_SELF_TEST.mask | r.GYRO_FS_SEL.mask
    user = r.USER_DMP_EN.mask | r.USER_FIFO_EN.mask | r.USER_I2C_MST_EN.mask
    # Of the interrupts only the overflow is used without a line; with others on, nothing would listen.
    pin, interrupts = r.INT_RD_CLEAR.mask, r.FIFO_OFLOW_EN.mask
    if data_ready:
        # Active high, push-pull, a pulse of 50 us (RM register 55): of a latched level only the first edge would come.
        pin |= r.INT_LEVEL.mask | r.INT_OPEN.mask | r.LATCH_INT_EN.mask
        interrupts |= r.DATA_RDY_EN.mask
    own: tuple[RegisterBits, ...] = ()
    if variant.class_6500:
        power |= r.GYRO_STANDBY.mask
        filters |= r.FIFO_MODE.mask
        gyro_bits |= r.GYRO_FCHOICE_B.mask
        accel_filter = r.FIFO_SIZE.encode(variant.fifo_size) | r.ACCEL_DLPF_CFG.encode(config.dlpf)
        own = (_row(r.ACCEL_CONFIG_2, accel_filter, r.FIFO_SIZE.mask | r.ACCEL_DLPF_CFG.mask),)
    return (
        _row(r.PWR_MGMT_1, r.CLKSEL.encode(r.CLOCK_PLL_GYRO_X), power),
        _row(r.PWR_MGMT_2, 0, r.STANDBY.mask),
        _row(r.CONFIG, r.DLPF_CFG.encode(config.dlpf), filters),
        _row(r.GYRO_CONFIG, gyro, gyro_bits),
        _row(r.ACCEL_CONFIG, accel, r.ACCEL_SELF_TEST.mask | r.ACCEL_FS_SEL.mask | r.ACCEL_HPF.mask),
        *own,
        _row(r.SMPLRT_DIV, config.divider, 0xFF),
        _row(r.USER_CTRL, 0, user),
        _row(r.FIFO_EN, 0, r.FIFO_SENSORS.mask | r.FIFO_SLAVES.mask),
        _row(r.INT_PIN_CFG, 0, pin),
        _row(r.INT_ENABLE, interrupts, 0xFF),
        *(offsets.rows(variant) if offsets else ()),
    )


def gyro_output_rate_hz(dlpf: int) -> float:
    """The rate the divider divides: 8 kHz with DLPF_CFG 0 or 7, else 1 kHz (RM p. 11)."""
    return 8000.0 if dlpf in (0, 7) else 1000.0


def _row(register: r.Register, set_bits: int, field_bits: int) -> RegisterBits:
    return RegisterBits(register, set_bits, field_bits & ~set_bits)


def _one_of(name: str, value: int, allowed: tuple[int, ...]) -> None:
    if value not in allowed:
        raise SettingsError(f"{name} = {value} is not possible: take one of {', '.join(map(str, allowed))}")
