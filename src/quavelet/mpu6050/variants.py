"""Which chip answered: WHO_AM_I values, and what differs between the chips.

Two classes of silicon: that of the MPU-6050, and that of the MPU-6500, which has filters of its own for the two sensors
and other registers for the factory's offsets and self-test codes (RM-MPU-9250A-00 rev 1.6, "RM9250").
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from quavelet.core.errors import WrongChip
from quavelet.mpu6050 import registers as r

_ALL_BUT_SLEEP = ~r.SLEEP.mask & 0xFF
_ALL_BUT_SLEEP_AND_CLOCK = _ALL_BUT_SLEEP & ~r.CLKSEL.mask
_FIFO_SIZES = (512, 1024, 2048, 4096)
"""By FIFO_SIZE of ACCEL_CONFIG_2."""


@dataclass(frozen=True, slots=True)
class Variant:
    """What a chip of the family has of its own.

    fifo_bytes          what its FIFO holds; in the 6500 class what it is set to hold
    temp_degc_per_lsb   and temp_degc_at_zero, where the temperature word is 0
    class_6500          filters, offsets and self-test as in the MPU-6500
    pwr_mgmt_1_reset    PWR_MGMT_1 after a reset, in the bits of pwr_mgmt_1_sure: SLEEP goes by the part's one-time
                        programming, and what clones do with the clock nobody wrote down
    motion_mg_per_lsb   a count of the motion threshold. Of the MPU-6050 it is in doubt: the register map before rev 4.2
                        and i2cdevlib say 2 mg, PS 6.2 says 32; nobody has published a measurement. Of the 6500 class
                        RM9250 register 31 says 4
    half_scale_made     early parts were made that give half the counts per g
    source              where all this is known from
    remark              what its owner should hear; empty for the chip this driver is named after
    """

    who_am_i: int
    name: str
    fifo_bytes: int
    pwr_mgmt_1_reset: int
    temp_degc_per_lsb: float
    temp_degc_at_zero: float
    class_6500: bool = False
    motion_mg_per_lsb: float = 2.0
    half_scale_made: bool = False
    pwr_mgmt_1_sure: int = _ALL_BUT_SLEEP
    source: str = ""
    remark: str = ""

    @property
    def fifo_size(self) -> int:
        """The FIFO_SIZE that makes the FIFO of a chip of the 6500 class hold `fifo_bytes`."""
        return _FIFO_SIZES.index(self.fifo_bytes)

    @property
    def wake_rates_hz(self) -> tuple[float, ...]:
        """How often it can wake in cycle mode, by LP_WAKE_CTRL (RM p. 42), or LP_ACCEL_ODR (RM9250 register 30)."""
        return tuple(500 / 2**k for k in range(11, -1, -1)) if self.class_6500 else (1.25, 5.0, 20.0, 40.0)

    @property
    def accel_offsets(self) -> tuple[r.Register, r.Register, r.Register]:
        """Where the accelerometer's offsets are, x y z, two bytes each."""
        return r.ACCEL_OFFSETS_6500 if self.class_6500 else r.ACCEL_OFFSETS


# Temperature: degC = raw/340 + 36.53 (RM p. 30). FIFO: 1024 bytes (PS 7.17).
MPU6050 = Variant(
    0x68,
    "MPU-6050",
    1024,
    0x40,
    1 / 340,
    36.53,
    half_scale_made=True,
    source="RM-MPU-6000A-00 rev 4.2; the MPU-6000 and MPU-9150 say the same of themselves",
)


def _class_6500(who_am_i: int, name: str, source: str) -> Variant:
    return Variant(
        who_am_i,
        name,
        # 512 by its data sheet, where the FIFO_SIZE bits are reserved; the vendor's driver sets it to 1024.
        1024,
        0x01,
        1 / 333.87,
        21.0,
        class_6500=True,
        motion_mg_per_lsb=4.0,
        source=source,
        remark=f"WHO_AM_I 0x{who_am_i:02x}: it is an {name}, not an MPU-6050, and is driven as one",
    )


MPU6500 = _class_6500(0x70, "MPU-6500", "RM9250, the vendor's driver, the table of Linux's inv_mpu6050")


def _reported(who_am_i: int, like: Variant, source: str) -> Variant:
    """A clone of which nothing is printed: nothing is taken for granted that can be done without."""
    return replace(
        like,
        who_am_i=who_am_i,
        name=f"0x{who_am_i:02x} clone",
        fifo_bytes=512 if like.class_6500 else 1024,
        pwr_mgmt_1_sure=_ALL_BUT_SLEEP_AND_CLOCK,
        source=source,
        remark=f"WHO_AM_I 0x{who_am_i:02x}: it is a clone without a data sheet, driven as an {like.name}; "
        f"its temperature and self-test may be wrong",
    )


_TABLE = (
    MPU6050,
    MPU6500,
    _class_6500(0x71, "MPU-9250", "RM9250"),
    _class_6500(0x73, "MPU-9255", "the table of Linux's inv_mpu6050"),
    _class_6500(0x74, "MPU-6515", "the table of Linux's inv_mpu6050"),
    Variant(
        0x98,
        "ICM-20689",
        4096,
        0x40,
        1 / 326.8,
        25.0,
        class_6500=True,
        motion_mg_per_lsb=4.0,
        pwr_mgmt_1_sure=_ALL_BUT_SLEEP_AND_CLOCK,
        source="the table of Linux's inv_mpu6050; users report it on most boards sold as MPU-6050 since 2021",
        remark="WHO_AM_I 0x98: it is an ICM-20689 or a clone of one, not an MPU-6050, and is driven as one",
    ),
    # Bit 0 of WHO_AM_I is reserved (RM p. 45), so that 0x69 names the same chip as 0x68.
    _reported(0x69, MPU6050, "Klipper's list, which calls it defective"),
    _reported(0x72, MPU6500, "programs of users who set its accelerometer's filter as an MPU-6500's"),
    _reported(0x75, MPU6500, "users who found it on boards sold as MPU-9250; Klipper's list calls it defective"),
)
VARIANTS: dict[int, Variant] = {variant.who_am_i: variant for variant in _TABLE}

LINE_STUCK = (0x00, 0xFF)
"""What every register reads while SDA is held low, or floats."""

# What else is found at 0x68/0x69 or sold as an MPU-6050; told to the user, not driven.
_OTHERS: dict[int, str] = {
    0x00: "0x00 usually means SDA is held low, or a chip that is not powered",
    0xFF: "0xff usually means SDA floats: no pull-ups, or no chip",
    0x19: "0x19 is an MPU-6886",
}


def identify(who_am_i: int, *, bus: str, address: int, accept_id: int = 0) -> Variant:
    """The variant that has this WHO_AM_I.

    accept_id is a WHO_AM_I that this table need not know, 0 for none: such a chip is driven as an MPU-6500. What that
    sets beyond an MPU-6050 is, in an MPU-6050, only the threshold of an interrupt that is off; the other way round an
    accelerometer would be left without its filter.

    Raises WrongChip, which says what the value usually means, and ValueError for an accept_id that cannot be one.
    """
    if not 0 <= accept_id < 0xFF:
        raise ValueError(f"accept_id = {accept_id} is no WHO_AM_I: give 0x01 to 0xfe, or 0 for none")
    variant = VARIANTS.get(who_am_i)
    if variant is None and who_am_i == accept_id and who_am_i not in LINE_STUCK:
        return replace(
            _reported(who_am_i, MPU6500, "nothing: its owner asked for it"),
            name=f"chip 0x{who_am_i:02x} accepted as MPU-6500",
            remark=f"WHO_AM_I 0x{who_am_i:02x} is unknown, and was accepted because it was asked for: the chip is "
            f"driven as an MPU-6500, compare its scale with gravity and its temperature with the room's",
        )
    if variant is None:
        meaning = _OTHERS.get(who_am_i, "no chip of this family is known by that value")
        raise WrongChip(
            f"WHO_AM_I of address 0x{address:02x} on {bus} is 0x{who_am_i:02x}, an MPU-6050 has 0x68: {meaning}; "
            f"check the address and what else is on the bus; where it is a chip of this family all the same, set "
            f"accept_id",
            found=who_am_i,
            known=tuple(VARIANTS),
        )
    return variant
