"""The Earth's field here: what the first measurements say of it, and whether a later one is like it."""

from __future__ import annotations

from dataclasses import dataclass
from math import atan2, cos, hypot, sin, sqrt

from quavelet.attitude.kernel import Quaternion, Vector
from quavelet.core.units import RAD_PER_DEG

FIRST_S = 1.0
FIRST_MEASUREMENTS = 8
"""The first fix is the mean over so long, of so many at least: the slowest magnetometer measures 8 a second."""
EARTH_UT = (20.0, 72.0)
"""The Earth's field at sea level is 22 to 67 uT (World Magnetic Model); the rest is for the calibration."""
HORIZONTAL_UT = 6.0
"""Less of it is horizontal near the magnetic poles only, where compasses are unreliable (the World Magnetic Model's
caution zone)."""
SPREAD = 0.04
"""The first measurements may differ by so much of their mean, and by SPREAD_RAD in dip, one sigma."""
SPREAD_RAD = 4.0 * RAD_PER_DEG
LIKE = 0.1
"""A field whose strength differs by more than this part, or whose dip by more than LIKE_RAD, is disturbed (as VQF has
it)."""
LIKE_RAD = 10.0 * RAD_PER_DEG


@dataclass(frozen=True, slots=True)
class LevelField:
    """A measured field in the filter's level frame.

    azimuth_rad  by which the frame must be turned about the vertical for its y axis to point along the horizontal part
    """

    strength_ut: float
    horizontal_ut: float
    dip_rad: float
    azimuth_rad: float


def levelled_field(q: Quaternion, field_ut: Vector) -> LevelField:
    """The field (body frame, uT) as the attitude `q` levels it."""
    w, x, y, z = q
    mx, my, mz = field_ut
    east = (w * w + x * x - y * y - z * z) * mx + 2.0 * (x * y - w * z) * my + 2.0 * (x * z + w * y) * mz
    north = 2.0 * (x * y + w * z) * mx + (w * w - x * x + y * y - z * z) * my + 2.0 * (y * z - w * x) * mz
    up = 2.0 * (x * z - w * y) * mx + 2.0 * (y * z + w * x) * my + (w * w - x * x - y * y + z * z) * mz
    horizontal = hypot(east, north)
    return LevelField(hypot(horizontal, up), horizontal, atan2(-up, horizontal), atan2(east, north))


@dataclass(frozen=True, slots=True)
class Reference:
    """The Earth's field here, as the first fix found it."""

    strength_ut: float
    dip_rad: float

    @property
    def horizontal_ut(self) -> float:
        return self.strength_ut * cos(self.dip_rad)

    def is_like(self, level: LevelField) -> bool:
        """Whether this field can be the Earth's. One that differs by less may still be disturbed."""
        return abs(level.strength_ut / self.strength_ut - 1.0) <= LIKE and abs(level.dip_rad - self.dip_rad) <= LIKE_RAD


@dataclass(frozen=True, slots=True)
class Fix:
    """A first fix: the frame's azimuth to magnetic north, and the field it came from."""

    azimuth_rad: float
    reference: Reference


@dataclass(frozen=True, slots=True)
class FirstFix:
    """Measurements towards a first fix: how many, over how long, and their sums.

    disturbed, steep   the ones before were no Earth's field, or one that is nearly vertical: they were thrown away
    """

    n: int = 0
    span_s: float = 0.0
    cosines: float = 0.0
    sines: float = 0.0
    strengths: float = 0.0
    strengths_ms: float = 0.0
    dips: float = 0.0
    dips_ms: float = 0.0
    disturbed: bool = False
    steep: bool = False

    def with_field(self, level: LevelField, *, after_s: float, earth_ut: tuple[float, float] = EARTH_UT) -> FirstFix:
        """One more measurement, so long after the last one; they begin anew once enough of them gave no fix.

        earth_ut   the least and the most that the Earth's field may be
        """
        enough = self._enough
        old = FirstFix(disturbed=self._unlike(earth_ut), steep=self._steep) if enough else self
        return FirstFix(
            n=old.n + 1,
            span_s=old.span_s + after_s if old.n else 0.0,
            cosines=old.cosines + cos(level.azimuth_rad),
            sines=old.sines + sin(level.azimuth_rad),
            strengths=old.strengths + level.strength_ut,
            strengths_ms=old.strengths_ms + level.strength_ut * level.strength_ut,
            dips=old.dips + level.dip_rad,
            dips_ms=old.dips_ms + level.dip_rad * level.dip_rad,
            disturbed=old.disturbed,
            steep=old.steep,
        )

    def fix(self, *, earth_ut: tuple[float, float] = EARTH_UT) -> Fix | None:
        """The fix, once there are enough that agree."""
        if not self._enough or self._unlike(earth_ut) or self._steep:
            return None
        return Fix(atan2(self.sines, self.cosines), self._mean)

    @property
    def _enough(self) -> bool:
        return self.span_s >= FIRST_S and self.n >= FIRST_MEASUREMENTS

    @property
    def _mean(self) -> Reference:
        return Reference(self.strengths / self.n, self.dips / self.n)

    def _unlike(self, earth_ut: tuple[float, float]) -> bool:
        """Whether they are no Earth's field, or differ."""
        mean = self._mean
        strength_sd = sqrt(max(0.0, self.strengths_ms / self.n - mean.strength_ut * mean.strength_ut))
        dip_sd = sqrt(max(0.0, self.dips_ms / self.n - mean.dip_rad * mean.dip_rad))
        low, high = earth_ut
        return not low <= mean.strength_ut <= high or strength_sd > SPREAD * mean.strength_ut or dip_sd > SPREAD_RAD

    @property
    def _steep(self) -> bool:
        return self._mean.horizontal_ut < HORIZONTAL_UT
