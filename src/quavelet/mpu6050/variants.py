"""Which chip answered: WHO_AM_I values, and what differs between the chips."""

from __future__ import annotations

from dataclasses import dataclass

from quavelet.core.errors import WrongChip


@dataclass(frozen=True, slots=True)
class Variant:
    """What a chip of the family has of its own.

    own_accel_filter   the accelerometer's low-pass is set in a register of its own, ACCEL_CONFIG_2
    """

    who_am_i: int
    name: str
    fifo_bytes: int
    pwr_mgmt_1_reset: int
    temp_degc_per_lsb: float
    temp_degc_at_zero: float
    own_accel_filter: bool = False


# Temperature: degC = raw/340 + 36.53 (RM p. 30). FIFO: 1024 bytes (PS 7.17).
MPU6050 = Variant(0x68, "MPU-6050", 1024, 0x40, 1 / 340, 36.53)

LINE_STUCK = (0x00, 0xFF)
"""What every register reads while SDA is held low, or floats."""

VARIANTS: dict[int, Variant] = {MPU6050.who_am_i: MPU6050}

# What else is found at 0x68/0x69 or sold as an MPU-6050; told to the user, not driven.
_OTHERS: dict[int, str] = {
    0x00: "0x00 usually means SDA is held low, or a chip that is not powered",
    0xFF: "0xff usually means SDA floats: no pull-ups, or no chip",
    0x19: "0x19 is an MPU-6886",
    0x69: "0x69 is an IAM or ICM part sold as MPU-6050",
    0x70: "0x70 is an MPU-6500 (sold on many MPU-6050 boards)",
    0x71: "0x71 is an MPU-9250",
    0x72: "0x72 is a clone of the MPU-6050 with a temperature formula of its own",
    0x73: "0x73 is an MPU-9255",
    0x74: "0x74 is an MPU-6515",
    0x75: "0x75 is an MPU-6000-class clone",
    0x98: "0x98 is an ICM-20689-class part sold as MPU-6050",
}


def identify(who_am_i: int, *, bus: str, address: int) -> Variant:
    """The variant that has this WHO_AM_I. Raises WrongChip, which says what the value usually means."""
    variant = VARIANTS.get(who_am_i)
    if variant is None:
        meaning = _OTHERS.get(who_am_i, "no chip of this family is known by that value")
        raise WrongChip(
            f"WHO_AM_I of address 0x{address:02x} on {bus} is 0x{who_am_i:02x}, an MPU-6050 has 0x68: {meaning}; "
            f"check the address and what else is on the bus",
            found=who_am_i,
            known=tuple(VARIANTS),
        )
    return variant
