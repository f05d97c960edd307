"""Whether a magnetometer is to be used, and how: the table [magnetometer] of the settings."""

from __future__ import annotations

import msgspec

from quavelet.core.errors import SettingsError
from quavelet.mpu6050.magnetometer.kinds import KINDS, Kind
from quavelet.mpu6050.magnetometer.plan import MagnetometerConfig, Matrix

NO, AUTO = "no", "auto"
LONGEST_BYTES = 10
"""Of one sample of any kind, the HMC5883L's."""


class MagnetometerParams(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The magnetometer of a board that has one (GY-87, MPU-9150, MPU-9250), read by the chip. What cannot be is
    refused.

    use       "no"; "auto": the one that is found, or none; or the name of one, where two are there: "HMC5883L",
              "QMC5883L", "AK8963", "AK8975"
    rate_hz   measurements a second; 0: what suits the kind that is found
    range_ut  full scale of an axis in uT; 0: what suits the kind that is found
    to_body   how it lies on the board: the rotation from its axes to the chip's, nine numbers row by row; empty: by
              what was found
    """

    use: str = NO
    rate_hz: float = 0.0
    range_ut: float = 0.0
    to_body: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        if self.use not in (NO, AUTO, *KINDS):
            raise SettingsError(f"use = {self.use!r} is not known: take one of {', '.join((NO, AUTO, *KINDS))}")
        for name in ("rate_hz", "range_ut"):
            value = getattr(self, name)
            if not 0.0 <= value <= 10_000.0:
                raise SettingsError(f"{name} = {value} does not fit: give a number above 0, or 0 for what suits")
        if len(self.to_body) not in (0, 9):
            raise SettingsError("to_body takes nine numbers, row by row, or none")
        # Refuses what is no rotation.
        MagnetometerConfig(rate_hz=self.rate_hz, range_ut=self.range_ut, to_body=self._matrix)

    @property
    def used(self) -> bool:
        return self.use != NO

    @property
    def wanted(self) -> str | None:
        """The kind that is asked for, None for any."""
        return self.use if self.use in KINDS else None

    def config(self, kind: Kind) -> MagnetometerConfig:
        """How this kind is to measure."""
        sensible = kind.sensible_config()
        return MagnetometerConfig(
            rate_hz=self.rate_hz or sensible.rate_hz,
            range_ut=self.range_ut or sensible.range_ut,
            to_body=self._matrix,
        )

    @property
    def _matrix(self) -> Matrix | None:
        if not self.to_body:
            return None
        a, b, c, d, e, f, g, h, i = self.to_body
        return ((a, b, c), (d, e, f), (g, h, i))
