"""What tells one chip from another of its kind: the factory's own words in it, for want of a serial number."""

from __future__ import annotations

from quavelet.mpu6050.access import RegisterAccess
from quavelet.mpu6050.factory_trim import read_codes
from quavelet.mpu6050.offset_plan import OffsetPlan
from quavelet.mpu6050.offsets import read_words
from quavelet.mpu6050.variants import Variant


def fingerprint_of(chip: RegisterAccess, *, variant: Variant, offsets: OffsetPlan | None = None) -> str:
    """The factory's self-test codes and accelerometer offsets as hexadecimal; "" where the factory wrote none.

    Only read: a chip that streams is not disturbed. `offsets` are what was written over the factory's. Raises BusError.
    """
    codes = read_codes(chip, variant=variant)
    words = offsets.accel_factory if offsets else read_words(chip, variant=variant).accel_factory
    numbers = (*codes.accel, *codes.gyro)
    if not any(numbers) and not any(words):
        return ""
    return bytes(numbers).hex() + "-" + "".join(f"{word & 0xFFFF:04x}" for word in words)
