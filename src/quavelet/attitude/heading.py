"""Heading from a magnetometer, whatever filter gave the attitude: its quaternion is turned about the world's vertical.

The filter's quaternion levels the measured field, and the direction of what is horizontal in it says by what angle the
filter's azimuth is off. That offset moves only as fast as the gyroscope drifts: it is found at once by averaging, and
then followed slowly. Where the field is not the Earth's the offset is left as it is, and its sigma grows by what the
gyroscope may have drifted since.
"""

from __future__ import annotations

import logging
from collections.abc import Iterator
from dataclasses import dataclass, replace
from math import cos, hypot, pi, remainder, sin, sqrt, tan
from typing import Literal

import msgspec
import numpy as np

from quavelet.attitude.doubt import GYRO_DENSITY_RAD, YAW_MAX_RAD, Residual
from quavelet.attitude.first_fix import EARTH_UT, FirstFix, LevelField, Reference, levelled_field
from quavelet.attitude.kernel import Quaternion, Vector, product
from quavelet.core.blocks import AttitudeBlock, Flag, FloatArray, YawFrom
from quavelet.core.errors import SettingsError
from quavelet.core.units import NS_PER_S, RAD_PER_DEG

NOISE_UT = 0.6
"""One sigma of one measurement: two counts of the coarsest of the kinds, the AK8975."""
AGE_S = 0.01
"""How old a measurement may be when its sample is taken, on average over the kinds: a turning board has turned on."""
LONGEST_STEP_S = 0.1
"""Between two measurements that follow each other; after a longer pause the next one has no more weight for it."""
CLEAR_S = 0.5
"""How long the field must be the Earth's again before it is believed: it comes back through a doubtful stretch."""
GATE = 3.0
"""Sigmas by which a field's direction may differ from the one expected: a magnet across the Earth's horizontal field
turns it by 45 degrees before strength and dip show it."""
HARD_IRON_SIGMA_MAX_UT = 50.0
ELSEWHERE = 0.2
"""Between the bench of a calibration and another place the Earth's field differs by such a part: another room, or a
thousand kilometres."""
INSIST_S = 60.0
"""A field that is the Earth's but for its direction, for so long: the gyroscope must have been wrong by more than is
known of it, and this goes into sigma."""

log = logging.getLogger(__name__)


class HeadingParams(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The magnetometer's calibration and what heading counts from: field = soft_iron (measured - hard_iron_ut).

    hard_iron_ut        x y z in the body frame, uT; empty: that of the chip's calibration by `quavelet calibrate`, and
                        without one heading is not used and yaw stays relative
    hard_iron_sigma_ut  one sigma of what the calibration leaves of an axis, uT
    soft_iron           nine numbers, row by row; empty: none
    field_ut            strength of the Earth's field where it was calibrated; a first fix is not taken where it is
                        unlike that. 0: not known
    declination_deg     of the place, degrees east of true north, such as 4.2; "none": heading counts from magnetic
                        north
    tau_s               time constant with which the magnetometer is followed; the gyroscope bridges what is faster
    """

    hard_iron_ut: tuple[float, ...] = ()
    hard_iron_sigma_ut: float = 1.0
    soft_iron: tuple[float, ...] = ()
    field_ut: float = 0.0
    declination_deg: float | Literal["none"] = "none"
    tau_s: float = 5.0

    def __post_init__(self) -> None:
        if len(self.hard_iron_ut) not in (0, 3) or not all(abs(x) <= 5000.0 for x in self.hard_iron_ut):
            raise SettingsError("hard_iron_ut takes three numbers within +-5000 uT, or none")
        if not 0.0 <= self.hard_iron_sigma_ut <= HARD_IRON_SIGMA_MAX_UT:
            raise SettingsError(
                f"hard_iron_sigma_ut = {self.hard_iron_sigma_ut} does not fit: give 0 to {HARD_IRON_SIGMA_MAX_UT:g} uT"
            )
        if len(self.soft_iron) not in (0, 9):
            raise SettingsError("soft_iron takes nine numbers, row by row, or none")
        if self.soft_iron:
            determinant = float(np.linalg.det(np.array(self.soft_iron).reshape(3, 3)))
            if not 0.1 <= determinant <= 10.0:
                raise SettingsError("soft_iron is far from a rotation: its determinant must be near 1, take it anew")
        if self.field_ut and not EARTH_UT[0] <= self.field_ut <= EARTH_UT[1]:
            raise SettingsError(f"field_ut = {self.field_ut} is not the Earth's: give 20 to 72 uT, or 0 if not known")
        if self.declination_deg != "none" and not abs(self.declination_deg) <= 180.0:
            raise SettingsError(f'declination_deg = {self.declination_deg} is no angle: give +-180, or "none"')
        if not 0.1 <= self.tau_s <= 1000.0:
            raise SettingsError(f"tau_s = {self.tau_s} does not fit: give 0.1 to 1000 s")

    @property
    def calibrated(self) -> bool:
        return bool(self.hard_iron_ut)

    @property
    def earth_ut(self) -> tuple[float, float]:
        """The least and the most that the Earth's field may be."""
        if not self.field_ut:
            return EARTH_UT
        doubt = ELSEWHERE * self.field_ut + 3.0 * self.hard_iron_sigma_ut
        return max(EARTH_UT[0], self.field_ut - doubt), min(EARTH_UT[1], self.field_ut + doubt)


@dataclass(frozen=True, slots=True)
class HeadingState:
    """All memory.

    offset_rad   by which the filter's quaternion is turned about the vertical, None before the first fix
    reference    the Earth's field here, None before the first fix
    first        measurements towards the first fix
    random_ms    mean square of the offset's random error, rad^2
    drift_rad    what the gyroscope's bias may have made of it, each step's sigma added up, less what was followed
    turned_rad   turned about the vertical, likewise: the gyroscope's scale may be off by a part of it
    since_s      time since the last measurement
    clear_s      for how long the field has been as expected, up to CLEAR_S; CLEAR_S at the first fix
    insisted_s   for how long it has been so but for its direction
    yaw_rad      the filter's own sigma of yaw
    unsettled    the filter was not to be trusted
    fixed_degc   the chip's temperature at the last measurement that was followed
    """

    offset_rad: float | None = None
    reference: Reference | None = None
    first: FirstFix = FirstFix()
    random_ms: float = 0.0
    drift_rad: float = 0.0
    turned_rad: float = 0.0
    since_s: float = 0.0
    clear_s: float = CLEAR_S
    insisted_s: float = 0.0
    yaw_rad: float = 0.0
    unsettled: bool = False
    fixed_degc: float = 0.0

    @property
    def disturbed(self) -> bool:
        return self.clear_s < CLEAR_S or self.first.disturbed


@dataclass(frozen=True, slots=True)
class _Row:
    """One row of an `AttitudeBlock`, with the calibrated field where it has one."""

    q: Quaternion
    up_rad_s: float
    elapsed_s: float
    tilt_rad: float
    yaw_rad: float
    temp_degc: float
    gap: bool
    unknown: bool
    unsettled: bool
    field: Vector | None


class Heading:
    """Attitudes and fields to attitudes with heading; a `Stage` together with the filter before it."""

    def __init__(self, params: HeadingParams, *, residual: Residual) -> None:
        """Raises ValueError where the params hold no calibration."""
        if not params.calibrated:
            raise ValueError("a magnetometer that is not calibrated gives no heading: give hard_iron_ut")
        self.params = params
        self._residual = residual
        self._iron = np.array(params.hard_iron_ut)
        self._soft = np.array(params.soft_iron or np.eye(3)).reshape(3, 3).tolist()
        self._north, self._declination_rad = YawFrom.MAGNETIC, 0.0
        if params.declination_deg != "none":
            self._north, self._declination_rad = YawFrom.TRUE, RAD_PER_DEG * params.declination_deg
        self._earth_ut = params.earth_ut
        self._told_steep = False
        self._s = HeadingState()

    def state(self) -> HeadingState:
        return self._s

    def restore(self, state: HeadingState) -> None:
        self._s = state

    def process(self, block: AttitudeBlock, field_ut: FloatArray) -> AttitudeBlock:
        """The same rows with their yaw, its sigma, flags and `yaw_from`; `field_ut` (N, 3) as in `ImuBlock`."""
        n = len(block)
        if field_ut.shape != (n, 3):
            raise ValueError(f"the field is {field_ut.shape} where the block has {n} rows")
        q, sigma, flags = block.q.copy(), block.sigma_rad.copy(), block.flags.copy()
        yaw_from = np.zeros(n, dtype=np.uint8)
        for k, row in enumerate(self._rows(block, field_ut)):
            s = self._s = self._next(self._s, row)
            if s.disturbed:
                flags[k] |= np.uint32(Flag.FIELD_DISTURBED)
            if s.offset_rad is None or s.reference is None:
                continue
            turned = product((cos(0.5 * s.offset_rad), 0.0, 0.0, sin(0.5 * s.offset_rad)), row.q)
            q[k] = turned if turned[0] >= 0.0 else [-x for x in turned]
            sigma[k, 2] = self._sigma_rad(s, s.reference, row.tilt_rad)
            yaw_from[k] = self._north
        return replace(block, q=q, sigma_rad=sigma, flags=flags, yaw_from=yaw_from)

    def _next(self, s: HeadingState, row: _Row) -> HeadingState:
        if row.unknown:
            # Until the gyroscope's bias is known the filter's azimuth may be set anew at any time.
            return HeadingState()
        s = self._drifted(s, row)
        if row.field is None or row.unsettled:
            return s
        level = levelled_field(row.q, row.field)
        if s.offset_rad is None or s.reference is None:
            return self._sought(s, level, row)
        return self._followed(s, s.reference, s.offset_rad, level, row)

    def _drifted(self, s: HeadingState, row: _Row) -> HeadingState:
        """One more sample without a look at the field."""
        random_ms = s.random_ms + GYRO_DENSITY_RAD * GYRO_DENSITY_RAD * row.elapsed_s
        if row.gap or row.unsettled or s.unsettled:
            # What a gap may have cost only the filter knows.
            random_ms += max(0.0, row.yaw_rad * row.yaw_rad - s.yaw_rad * s.yaw_rad)
        warmer = row.temp_degc - s.fixed_degc
        bias = hypot(self._residual.gyro_bias_rad_s, self._residual.gyro_bias_rad_s_degc * warmer)
        # Not `replace`, which takes longer than all of the above.
        return HeadingState(
            offset_rad=s.offset_rad,
            reference=s.reference,
            first=s.first,
            random_ms=random_ms,
            drift_rad=s.drift_rad + bias * row.elapsed_s,
            turned_rad=s.turned_rad + row.up_rad_s * row.elapsed_s,
            since_s=s.since_s + row.elapsed_s,
            clear_s=s.clear_s,
            insisted_s=s.insisted_s,
            yaw_rad=row.yaw_rad,
            unsettled=row.unsettled,
            fixed_degc=s.fixed_degc,
        )

    def _sought(self, s: HeadingState, level: LevelField, row: _Row) -> HeadingState:
        first = s.first.with_field(level, after_s=s.since_s, earth_ut=self._earth_ut)
        fix = first.fix(earth_ut=self._earth_ut)
        if fix is None:
            if first.steep and not self._told_steep:
                self._told_steep = True
                log.warning(
                    "the magnetic field is nearly vertical here, %.1f uT across: yaw stays relative",
                    level.horizontal_ut,
                )
            return replace(s, first=first, since_s=0.0)
        return replace(
            s,
            offset_rad=remainder(fix.azimuth_rad - self._declination_rad, 2.0 * pi),
            reference=fix.reference,
            first=FirstFix(),
            random_ms=(NOISE_UT / fix.reference.horizontal_ut) ** 2 / first.n,
            drift_rad=0.0,
            turned_rad=0.0,
            since_s=0.0,
            clear_s=CLEAR_S,
            fixed_degc=row.temp_degc,
        )

    def _followed(
        self, s: HeadingState, reference: Reference, offset_rad: float, level: LevelField, row: _Row
    ) -> HeadingState:
        if not reference.is_like(level):
            return replace(s, since_s=0.0, clear_s=0.0, insisted_s=0.0)
        error = remainder(level.azimuth_rad - self._declination_rad - offset_rad, 2.0 * pi)
        noise_ms = (NOISE_UT / reference.horizontal_ut) ** 2 + (row.up_rad_s * AGE_S) ** 2
        doubt_ms = self._doubt_ms(s)
        if abs(error) > GATE * sqrt(doubt_ms + noise_ms + self._field_ms(reference, row.tilt_rad)):
            if s.insisted_s < INSIST_S:
                return replace(s, since_s=0.0, clear_s=0.0, insisted_s=s.insisted_s + s.since_s)
            return replace(s, since_s=0.0, random_ms=s.random_ms + error * error, insisted_s=0.0)
        clear_s = min(CLEAR_S, s.clear_s + s.since_s)
        if clear_s < CLEAR_S:
            return replace(s, since_s=0.0, clear_s=clear_s)
        step_s = min(s.since_s, LONGEST_STEP_S)
        # Faster where the gyroscope is the less sure of the two: after a disturbance, or a long turn.
        share = max(step_s / (self.params.tau_s + step_s), doubt_ms / (doubt_ms + noise_ms))
        kept = 1.0 - share
        return replace(
            s,
            offset_rad=remainder(offset_rad + share * error, 2.0 * pi),
            random_ms=kept * kept * s.random_ms + share * share * noise_ms,
            drift_rad=kept * s.drift_rad,
            turned_rad=kept * s.turned_rad,
            since_s=0.0,
            clear_s=clear_s,
            insisted_s=0.0,
            fixed_degc=row.temp_degc,
        )

    def _doubt_ms(self, s: HeadingState) -> float:
        """Mean square of the gyroscope's part of the offset's error, rad^2."""
        scale = self._residual.gyro_scale * s.turned_rad
        return s.random_ms + s.drift_rad * s.drift_rad + scale * scale

    def _field_ms(self, reference: Reference, tilt_rad: float) -> float:
        """Mean square of what is wrong with the field's direction for long, rad^2: iron that the calibration has left,
        and a tilt that is off, which takes a part of the vertical field for a horizontal one."""
        iron = self.params.hard_iron_sigma_ut / reference.horizontal_ut
        tilt = tan(reference.dip_rad) * tilt_rad
        return iron * iron + tilt * tilt

    def _sigma_rad(self, s: HeadingState, reference: Reference, tilt_rad: float) -> float:
        """One sigma of heading."""
        return min(sqrt(self._doubt_ms(s) + self._field_ms(reference, tilt_rad)), YAW_MAX_RAD)

    def _rows(self, block: AttitudeBlock, field_ut: FloatArray) -> Iterator[_Row]:
        columns = zip(
            block.q.tolist(),
            block.gyro_rad_s.tolist(),
            block.period_s.tolist(),
            block.gap_ns.tolist(),
            block.sigma_rad.tolist(),
            block.temp_degc.tolist(),
            block.flags.tolist(),
            (field_ut - self._iron).tolist(),
            strict=True,
        )
        for q, (wx, wy, wz), period_s, gap_ns, (tilt, _, yaw), degc, flags, (mx, my, mz) in columns:
            w, x, y, z = q
            up = 2.0 * (x * z - w * y) * wx + 2.0 * (y * z + w * x) * wy + (w * w - x * x - y * y + z * z) * wz
            (a, b, c), (d, e, f), (g, h, i) = self._soft
            known = mx == mx  # NaN is unlike itself
            field = (a * mx + b * my + c * mz, d * mx + e * my + f * mz, g * mx + h * my + i * mz) if known else None
            yield _Row(
                q=(w, x, y, z),
                up_rad_s=up,
                elapsed_s=period_s + gap_ns / NS_PER_S,
                tilt_rad=tilt,
                yaw_rad=yaw,
                temp_degc=degc,
                gap=gap_ns > 0,
                unknown=bool(flags & Flag.BIAS_UNKNOWN),
                unsettled=bool(flags & Flag.SETTLING),
                field=field,
            )
