"""Reading and writing one chip's registers over a bus, with a second and a third try where that is safe."""

from __future__ import annotations

import errno
from collections.abc import Callable
from typing import TypeVar

from quavelet.bus.protocol import I2CBus
from quavelet.core.clock import Clock
from quavelet.core.errors import BusError
from quavelet.core.health import Health
from quavelet.core.units import NS_PER_MS
from quavelet.mpu6050 import registers as r
from quavelet.mpu6050.registers import RegisterBits
from quavelet.mpu6050.stream import StreamInfo

TRIES = 3
TRIES_WITHIN_NS = 5 * NS_PER_MS
"""No try begins later than this after the first: the loop must go on, and its next drain is another try."""

_NOT_ACKNOWLEDGED = frozenset([errno.EREMOTEIO, errno.ENXIO])
# A time-out is not among them: the adapter waits up to a second for the line, and so it would again.
_PASSING = _NOT_ACKNOWLEDGED | {errno.EIO, errno.EAGAIN}

T = TypeVar("T")


class RegisterAccess:
    """The chip at `address` on `bus`.

    Reading a register, or writing the same byte to it, may be repeated, and is, up to three times in all, at once: what
    disturbs the wires for longer is the caller's to outlast. Every method raises BusError.
    """

    def __init__(self, bus: I2CBus, *, address: int, clock: Clock, health: Health) -> None:
        self.bus = bus
        self.address = address
        self._clock = clock
        self._health = health

    def read(self, register: r.Register) -> int:
        """The register's byte."""
        return self.read_run(register, 1)[0]

    def read_run(self, register: r.Register, n: int) -> bytes:
        """`n` bytes from the register on, one coherent transaction."""
        return self._tried(lambda: self.bus.write_read(self.address, bytes([register.address]), n), _PASSING)

    def read_fifo(self, n: int) -> bytes:
        """`n` bytes out of the FIFO.

        Tried again only where the chip did not acknowledge, which it does before it gives a byte: after any other
        failure nobody knows how many bytes have gone.
        """
        port = bytes([r.FIFO_R_W.address])
        return self._tried(lambda: self.bus.write_read(self.address, port, n), _NOT_ACKNOWLEDGED)

    def write(self, register: r.Register, byte: int) -> None:
        self._tried(lambda: self.bus.write(self.address, bytes([register.address, byte])), _PASSING)

    def apply(self, row: RegisterBits) -> None:
        """Read, change the row's bits, write."""
        self.write(row.register, row.applied_to(self.read(row.register)))

    def fifo_count(self) -> int:
        """Bytes in the FIFO. Reading both halves at once latches them together (RM p. 43)."""
        return int.from_bytes(self.read_run(r.FIFO_COUNT, 2), "big")

    def restart_fifo(self, *, slaves: int = 0) -> None:
        """Empty the FIFO and let it fill with frames of 14 bytes, and of what so many slaves of the chip's I2C master
        read, which then goes on.

        The order matters: FIFO_RESET acts only while the FIFO is off (RM p. 38), and no sensor may write
        while it is emptied, or the first frame is a part of one.
        """
        master = r.USER_I2C_MST_EN.mask if slaves else 0
        self.write(r.FIFO_EN, 0)
        self.write(r.USER_CTRL, master)
        self.write(r.USER_CTRL, master | r.USER_FIFO_RESET.mask)
        self.write(r.USER_CTRL, master | r.USER_FIFO_EN.mask)
        self.read(r.INT_STATUS)  # clears an overflow that belongs to what was thrown away
        self.write(r.FIFO_EN, r.fifo_en(slaves))

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

    def _tried(self, transfer: Callable[[], T], worth: frozenset[int]) -> T:
        end_ns = self._clock.now_ns() + TRIES_WITHIN_NS
        for left in reversed(range(TRIES)):
            try:
                return transfer()
            except BusError as error:
                self._health.bus_errors += 1
                if not left or error.errno not in worth or self._clock.now_ns() > end_ns:
                    raise
                self._health.bus_retries += 1
        raise AssertionError("the last try returns or raises")
