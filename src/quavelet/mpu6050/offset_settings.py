"""A plan of offsets as settings: the table `[offsets]`, and its text."""

from __future__ import annotations

import msgspec

from quavelet.core.errors import SettingsError
from quavelet.mpu6050.offset_plan import OffsetPlan, Words

_LISTS = ("accel_factory", "gyro_factory", "accel", "gyro")


class OffsetSettings(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What is written to the chip's own offset registers after every reset, as it was measured on this very chip
    (`measured_as_toml`, src/quavelet/mpu6050/README.md); all empty: the factory's words stay.

    who_am_i                      of the chip it was measured on
    accel_factory, gyro_factory   what that chip holds after a reset, x y z
    accel, gyro                   what it shall hold, x y z
    """

    who_am_i: int = 0
    accel_factory: tuple[int, ...] = ()
    gyro_factory: tuple[int, ...] = ()
    accel: tuple[int, ...] = ()
    gyro: tuple[int, ...] = ()

    def __post_init__(self) -> None:
        given = [name for name in _LISTS if getattr(self, name)]
        missing = [name for name in _LISTS if not getattr(self, name)]
        if given and missing:
            raise SettingsError(f"{', '.join(missing)} is missing beside {given[0]}: give all of a plan, or nothing")
        if bool(given) != bool(self.who_am_i) or not 0 <= self.who_am_i <= 0xFF:
            raise SettingsError(
                f"who_am_i = {self.who_am_i} does not fit: give that of the chip whose offsets these are, 0 without any"
            )
        self.plan()

    def plan(self) -> OffsetPlan | None:
        """The plan, None where there is none."""
        if not self.accel:
            return None
        return OffsetPlan(
            self.who_am_i,
            _words("accel_factory", self.accel_factory),
            _words("gyro_factory", self.gyro_factory),
            _words("accel", self.accel),
            _words("gyro", self.gyro),
        )


def measured_as_toml(plan: OffsetPlan) -> str:
    """The table of a settings file that has this plan written after every reset of the chip."""
    lines = [f"{name} = [{', '.join(map(str, getattr(plan, name)))}]" for name in _LISTS]
    return "\n".join(["[offsets]", f"who_am_i = 0x{plan.who_am_i:02x}", *lines]) + "\n"


def _words(name: str, words: tuple[int, ...]) -> Words:
    if len(words) != 3 or not all(-32768 <= word <= 32767 for word in words):
        raise SettingsError(f"{name} = {list(words)} is not possible: give three whole numbers of 16 bits, x y z")
    return (words[0], words[1], words[2])
