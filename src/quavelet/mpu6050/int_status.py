"""INT_STATUS of a chip that nobody streams from: read in one place, since reading clears it."""

from __future__ import annotations

from quavelet.core.errors import BusBusy
from quavelet.mpu6050 import registers as r
from quavelet.mpu6050.access import RegisterAccess


class IntStatus:
    """The one who reads INT_STATUS, and keeps for each asker the bits that are meant for him (RM p. 28).

    A `ChipSource` is such a one itself: of a chip that streams this would take the overflow that the stream must know.

    chip   the chip
    """

    def __init__(self, chip: RegisterAccess) -> None:
        """Raises BusBusy where the chip streams, or was left streaming; BusError."""
        if chip.read(r.USER_CTRL) & r.USER_FIFO_EN.mask and chip.read(r.FIFO_EN):
            raise BusBusy(
                f"the chip at 0x{chip.address:02x} on {chip.bus.name} streams, and its interrupts belong to the "
                f"stream: stop the program that reads it, or reset the chip where none does",
                address=chip.address,
            )
        self.chip = chip
        self._held = 0

    def take(self, mask: int) -> int:
        """Those bits of `mask` that were set since they were taken last. Raises BusError."""
        self._held |= self.chip.read(r.INT_STATUS)
        taken = self._held & mask
        self._held &= ~mask
        return taken
