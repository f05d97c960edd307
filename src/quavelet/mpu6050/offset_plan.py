"""What is to stand in the offset registers, as data: each reset loses it, and it is written again from here."""

from __future__ import annotations

from dataclasses import dataclass

from quavelet.core.errors import CalibrationError
from quavelet.mpu6050 import registers as r
from quavelet.mpu6050.variants import Variant

Words = tuple[int, int, int]
"""One register pair for each axis x y z, as a signed number of 16 bits."""
ACCEL_LSB_PER_G = 2048
"""Of the accelerometer's offset words, in every range; bit 0 is the chip's own, so that a step is 0.98 mg. (The
vendor's driver; RM9250 register 119: 15 bits of 0.98 mg, which are the same bits.)"""
GYRO_LSB_PER_DPS = 32.8
"""Of the gyroscope's offset words, in every range (the vendor's driver)."""
_CHIP_BIT = 1


@dataclass(frozen=True, slots=True)
class OffsetPlan:
    """Offset words for one chip, and its factory's, from which they were reckoned.

    who_am_i         of the chip
    accel_factory    what the chip holds after a reset: trim that the maker measured
    gyro_factory     likewise, usually 0
    accel, gyro      what it shall hold; bit 0 of the accelerometer's is the factory's
    """

    who_am_i: int
    accel_factory: Words
    gyro_factory: Words
    accel: Words
    gyro: Words

    def __post_init__(self) -> None:
        for name in ("accel_factory", "gyro_factory", "accel", "gyro"):
            words = getattr(self, name)
            if len(words) != 3 or not all(-32768 <= word <= 32767 for word in words):
                raise CalibrationError(f"{name} = {words} are not three words of 16 bits: measure the offsets again")
        if any((a ^ b) & _CHIP_BIT for a, b in zip(self.accel, self.accel_factory, strict=True)):
            raise CalibrationError(
                f"bit 0 of accel = {self.accel} is not the factory's: it is the chip's own, measure the offsets again"
            )

    def rows(self, variant: Variant) -> tuple[r.RegisterBits, ...]:
        """The rows of the configuration that write these offsets. Raises CalibrationError for another kind of chip."""
        if variant.who_am_i != self.who_am_i:
            raise CalibrationError(
                f"these offsets are of a chip with WHO_AM_I 0x{self.who_am_i:02x}, this one has "
                f"0x{variant.who_am_i:02x}: measure them anew, or leave them out"
            )
        accel = zip(variant.accel_offsets, self.accel, strict=True)
        gyro = zip(r.GYRO_OFFSETS, self.gyro, strict=True)
        return (
            *(row for register, word in accel for row in word_rows(register, word, keep=_CHIP_BIT)),
            *(row for register, word in gyro for row in word_rows(register, word)),
        )


def word_rows(register: r.Register, word: int, *, keep: int = 0) -> tuple[r.RegisterBits, r.RegisterBits]:
    """The rows that put `word` into a register pair, high byte first, but for the bits `keep` of its low byte."""
    high, low = (word & 0xFFFF).to_bytes(2, "big")
    return (
        r.RegisterBits(register.byte(0), high, ~high & 0xFF),
        r.RegisterBits(register.byte(1), low & ~keep, ~low & ~keep & 0xFF),
    )
