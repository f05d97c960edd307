"""What must be known of a configured chip to decode its FIFO; it is also a recording's header."""

from __future__ import annotations

from dataclasses import dataclass

from quavelet.core.blocks import Scale
from quavelet.core.units import RAD_PER_DEG, STANDARD_GRAVITY_M_S2
from quavelet.mpu6050 import registers as r
from quavelet.mpu6050.config import ACCEL_LSB_PER_G, GYRO_LSB_PER_DPS, gyro_output_rate_hz
from quavelet.mpu6050.magnetometer.plan import AS_THE_CHIP, Matrix
from quavelet.mpu6050.variants import Variant, identify


@dataclass(frozen=True, slots=True, kw_only=True)
class MagnetometerStream:
    """A magnetometer whose bytes stand in each frame of the FIFO, behind the sensors' words.

    kind            its name in `KINDS`
    rate_hz, range_ut   as in `MagnetometerConfig`
    external_bytes  how many of a frame's bytes are its own
    slaves          of the chip's I2C master that read them
    to_body         rotation from its axes to the chip's
    adjustment      the factory's ASAX, ASAY, ASAZ of AKM's chips
    """

    kind: str
    rate_hz: float
    range_ut: float
    external_bytes: int
    slaves: int
    to_body: Matrix = AS_THE_CHIP
    adjustment: tuple[int, int, int] | None = None


@dataclass(frozen=True, slots=True)
class StreamInfo:
    """A chip that streams: registers as read back, never as wished.

    src        the bus's name
    address    the chip's 7-bit address
    who_am_i, config, gyro_config, accel_config, smplrt_div   register bytes
    accepted           who_am_i is unknown, and is driven all the same because its owner asked for it
    accel_half_scale   early silicon, which gives half the counts per g
    data_ready         its INT pin gives a pulse with each sample, and a line at it is listened to
    magnetometer       what it adds to each frame, None where there is none
    """

    src: str
    address: int
    who_am_i: int
    config: int
    gyro_config: int
    accel_config: int
    smplrt_div: int
    accepted: bool = False
    accel_half_scale: bool = False
    data_ready: bool = False
    magnetometer: MagnetometerStream | None = None

    @property
    def frame_bytes(self) -> int:
        """Bytes of one frame of the FIFO."""
        return r.FRAME_BYTES + (self.magnetometer.external_bytes if self.magnetometer else 0)

    @property
    def slaves(self) -> int:
        """Slaves of the chip's I2C master whose bytes stand in the frames."""
        return self.magnetometer.slaves if self.magnetometer else 0

    @property
    def variant(self) -> Variant:
        """Raises WrongChip where this version does not know the chip."""
        accept_id = self.who_am_i if self.accepted else 0
        return identify(self.who_am_i, bus=self.src, address=self.address, accept_id=accept_id)

    @property
    def remarks(self) -> tuple[str, ...]:
        """What the owner of this chip should hear of it; empty for an MPU-6050 like most."""
        half = "it is early silicon, which gives half the counts per g: that is reckoned with"
        return tuple(text for text in (self.variant.remark, half if self.accel_half_scale else "") if text)

    @property
    def gyro_range_dps(self) -> int:
        return list(GYRO_LSB_PER_DPS)[r.GYRO_FS_SEL.decode(self.gyro_config)]

    @property
    def accel_range_g(self) -> int:
        return list(ACCEL_LSB_PER_G)[r.ACCEL_FS_SEL.decode(self.accel_config)]

    @property
    def nominal_period_s(self) -> float:
        """The sample period if the chip's oscillator were exact."""
        return (1 + self.smplrt_div) / gyro_output_rate_hz(r.DLPF_CFG.decode(self.config))

    @property
    def scale(self) -> Scale:
        return scale_for(
            self.gyro_range_dps, self.accel_range_g, variant=self.variant, accel_half_scale=self.accel_half_scale
        )


def scale_for(gyro_range_dps: int, accel_range_g: int, *, variant: Variant, accel_half_scale: bool = False) -> Scale:
    """What a count means at these ranges."""
    counts_per_g = ACCEL_LSB_PER_G[accel_range_g] * (0.5 if accel_half_scale else 1.0)
    return Scale(
        gyro_rad_s_per_lsb=RAD_PER_DEG / GYRO_LSB_PER_DPS[gyro_range_dps],
        accel_m_s2_per_lsb=STANDARD_GRAVITY_M_S2 / counts_per_g,
        temp_degc_per_lsb=variant.temp_degc_per_lsb,
        temp_degc_at_zero=variant.temp_degc_at_zero,
    )
