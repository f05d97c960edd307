"""Reading and writing one chip's registers over a bus."""

from __future__ import annotations

from quavelet.bus.protocol import I2CBus
from quavelet.mpu6050 import registers as r
from quavelet.mpu6050.config import RegisterBits
from quavelet.mpu6050.stream import StreamInfo


class RegisterAccess:
    """The chip at `address` on `bus`. Every method is one or a few bus transactions and raises BusError."""

    def __init__(self, bus: I2CBus, *, address: int) -> None:
        self.bus = bus
        self.address = address

    def read(self, register: r.Register) -> int:
        """The register's byte."""
        return self.bus.write_read(self.address, bytes([register.address]), 1)[0]

    def read_run(self, register: r.Register, n: int) -> bytes:
        """`n` bytes from the register on, one coherent transaction."""
        return self.bus.write_read(self.address, bytes([register.address]), n)

    def write(self, register: r.Register, byte: int) -> None:
        self.bus.write(self.address, bytes([register.address, byte]))

    def apply(self, row: RegisterBits) -> None:
        """Read, change the row's bits, write."""
        self.write(row.register, row.applied_to(self.read(row.register)))

    def fifo_count(self) -> int:
        """Bytes in the FIFO. Reading both halves at once latches them together (RM p. 43)."""
        return int.from_bytes(self.read_run(r.FIFO_COUNT, 2), "big")

    def restart_fifo(self) -> None:
        """Empty the FIFO and let it fill with 14-byte frames.

        The order matters: FIFO_RESET acts only while the FIFO is off (RM p. 38), and no sensor may write
        while it is emptied, or the first frame is a part of one.
        """
        self.write(r.FIFO_EN, 0)
        self.write(r.USER_CTRL, 0)
        self.write(r.USER_CTRL, r.USER_FIFO_RESET.mask)
        self.write(r.USER_CTRL, r.USER_FIFO_EN.mask)
        self.read(r.INT_STATUS)  # clears an overflow that belongs to what was thrown away
        self.write(r.FIFO_EN, r.FIFO_SENSORS.encode(r.FIFO_ACCEL_TEMP_GYRO))

    def stream_info(self) -> StreamInfo:
        """Ranges and rates as they stand in the chip."""
        return StreamInfo(
            src=self.bus.name,
            address=self.address,
            who_am_i=self.read(r.WHO_AM_I),
            config=self.read(r.CONFIG),
            gyro_config=self.read(r.GYRO_CONFIG),
            accel_config=self.read(r.ACCEL_CONFIG),
            smplrt_div=self.read(r.SMPLRT_DIV),
        )
