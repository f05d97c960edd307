"""Early silicon of the MPU-6050, whose accelerometer gives half the counts per g: 8192 at +-2 g."""

from __future__ import annotations

from quavelet.mpu6050 import registers as r
from quavelet.mpu6050.access import RegisterAccess
from quavelet.mpu6050.measuring import read_steadily
from quavelet.mpu6050.variants import Variant

_HALF_REVISION = 1
_HALF_PRODUCT = 4


def is_half_scale(chip: RegisterAccess, *, variant: Variant) -> bool:
    """Whether this chip is one of those. Raises BusError.

    The factory writes the revision into bit 0 of the accelerometer's offset words, x the lowest, and where that says 0,
    into the low nibble of PRODUCT_ID (Betaflight's and ArduPilot's drivers tell them by it). Offsets that are written
    must leave these bits as they are.
    """
    if not variant.half_scale_made:
        return False
    x, y, z = r.ACCEL_OFFSETS
    # On one bit hangs a factor of two.
    run = read_steadily(chip, x, r.PRODUCT_ID.address - x.address + 1)
    revision = sum((run[word.address + 1 - x.address] & 1) << axis for axis, word in enumerate((x, y, z)))
    return revision == _HALF_REVISION or (revision == 0 and run[-1] & 0x0F == _HALF_PRODUCT)
