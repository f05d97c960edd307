"""What a calibration found, as it is kept: one record for each chip, every value with its unit and its sigma."""

from __future__ import annotations

from math import inf

import msgspec
import numpy as np

from quavelet.calibration.accelerometer import AccelerometerFit
from quavelet.calibration.gyro_bias import BiasFit
from quavelet.calibration.magnetometer import MagnetometerFit
from quavelet.calibration.model import (
    IDENTITY,
    NO_MATRIX,
    UNCALIBRATED,
    BiasCurve,
    ImuCalibration,
    MagnetometerCalibration,
    Matrix,
    Vector,
)
from quavelet.calibration.poses import vector
from quavelet.calibration.turns import TurnFit
from quavelet.core.blocks import FloatArray
from quavelet.core.errors import CalibrationError
from quavelet.core.units import STANDARD_GRAVITY_M_S2

MARGIN_DEGC = 5.0
"""So far beyond the temperatures of the calibration it is still used without a flag."""
SCALE_DRIFT = 0.001
"""One sigma of what 5 degC do to a scale: 2 % from -40 to 85 degC (PS 6.1)."""


class ChipIdentity(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Which chip it is. It has no serial number, so that its factory's own trim stands for one.

    fingerprint   the factory's words in the chip, "" where they cannot be read: then bus and address must agree
    """

    who_am_i: int
    name: str
    bus: str
    address: int
    fingerprint: str = ""

    @property
    def is_fake(self) -> bool:
        return self.bus.startswith("fake:")


class Made(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """When and how: ISO 8601 in UTC, the package's version, the ranges, and the chip's temperatures meanwhile."""

    utc: str
    version: str
    gyro_range_dps: int
    accel_range_g: int
    lowest_degc: float
    highest_degc: float


class AccelerometerTable(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """true = matrix (measured - offset). `frame`: "faces" of the board, or the "sensor"'s own axes."""

    offset_m_s2: Vector
    offset_sigma_m_s2: Vector
    matrix: Matrix
    matrix_sigma: Matrix
    frame: str
    undetermined: tuple[str, ...]
    sigma_m_s2: float
    rms_before_g: float
    rms_after_g: float
    residual_g: tuple[float, ...]


class GyroBiasTable(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Bias: sum of coefficient_k (temperature - reference)^k, and what 1 m/s^2 of force adds."""

    reference_degc: float
    coefficients_rad_s: tuple[Vector, ...]
    lowest_degc: float
    highest_degc: float
    sigma_rad_s: float
    slope_sigma_rad_s_degc: float
    per_force_rad_s: Matrix
    residual_rms_rad_s: float


class GyroScaleTable(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """rate = matrix (measured - bias), in the axes of the accelerometer."""

    matrix: Matrix
    matrix_sigma: Matrix
    undetermined: tuple[str, ...]
    scale_sigma: float
    residual_deg: tuple[tuple[float, ...], ...]


class MagnetometerTable(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """true = soft_iron (measured - hard_iron)."""

    hard_iron_ut: Vector
    hard_iron_sigma_ut: Vector
    soft_iron: Matrix
    field_ut: float
    field_sigma: float
    coverage: float
    rms_before: float
    rms_after: float


class OffsetsTable(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What was written to the chip's own offset registers before it was calibrated, x y z each (see `OffsetPlan`)."""

    accel_factory: tuple[int, int, int]
    gyro_factory: tuple[int, int, int]
    accel: tuple[int, int, int]
    gyro: tuple[int, int, int]


class KeptTable(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """When and how the parts were made that are older than the record; None for those that are as old."""

    accelerometer: Made | None = None
    gyro_bias: Made | None = None
    gyro_scale: Made | None = None
    magnetometer: Made | None = None


PARTS = ("accelerometer", "gyro_bias", "gyro_scale", "magnetometer")


class CalibrationRecord(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """All of a file; parts that were not calibrated are None. `made` is of those that `kept` does not name."""

    chip: ChipIdentity
    made: Made
    kept: KeptTable | None = None
    accelerometer: AccelerometerTable | None = None
    gyro_bias: GyroBiasTable | None = None
    gyro_scale: GyroScaleTable | None = None
    magnetometer: MagnetometerTable | None = None
    offsets: OffsetsTable | None = None

    def has(self, part: str) -> bool:
        """Whether this part of PARTS was calibrated."""
        return getattr(self, part) is not None

    def made_of(self, part: str) -> Made:
        """When and how this part of PARTS was made."""
        kept: Made | None = getattr(self.kept, part) if self.kept else None
        return kept or self.made

    def in_words(self) -> str:
        """Its date, and those of the parts that are older."""
        older = [
            f"{in_words(part)} of {self.made_of(part).utc}"
            for part in PARTS
            if self.has(part) and self.made_of(part) != self.made
        ]
        return f"{self.made.utc} ({', '.join(older)})" if older else self.made.utc

    def span_degc(self) -> tuple[float, float]:
        """The temperatures at which all of its inertial parts were made; all there are where it has none."""
        every = [self.made_of(part) for part in PARTS[:3] if self.has(part)]
        lowest = max((made.lowest_degc for made in every), default=-inf)
        return lowest, min((made.highest_degc for made in every), default=inf)

    def calibration(self) -> ImuCalibration:
        """As the pipeline takes it; what was not calibrated is as in an uncalibrated chip."""
        accel, bias, scale, magnetometer = self.accelerometer, self.gyro_bias, self.gyro_scale, self.magnetometer
        curve = None if bias is None else _curve(bias)
        known = curve is not None and curve.is_known
        lowest_degc, highest_degc = self.span_degc()
        return ImuCalibration(
            gyro_bias_curve=curve,
            gyro_matrix=scale.matrix if scale else IDENTITY,
            gyro_per_force=bias.per_force_rad_s if bias else NO_MATRIX,
            accel_offset_m_s2=accel.offset_m_s2 if accel else (0.0, 0.0, 0.0),
            accel_matrix=accel.matrix if accel else IDENTITY,
            accel_sigma_m_s2=accel.sigma_m_s2 if accel else UNCALIBRATED.accel_sigma_m_s2,
            gyro_scale_sigma=float(np.hypot(scale.scale_sigma, SCALE_DRIFT))
            if scale
            else UNCALIBRATED.gyro_scale_sigma,
            gyro_bias_sigma_rad_s=curve.sigma_rad_s if curve and known else UNCALIBRATED.gyro_bias_sigma_rad_s,
            gyro_bias_sigma_rad_s_degc=(
                curve.slope_sigma_rad_s_degc if curve and known else UNCALIBRATED.gyro_bias_sigma_rad_s_degc
            ),
            lowest_degc=lowest_degc - MARGIN_DEGC,
            highest_degc=highest_degc + MARGIN_DEGC,
            magnetometer=None
            if magnetometer is None
            else MagnetometerCalibration(
                hard_iron_ut=magnetometer.hard_iron_ut,
                hard_iron_sigma_ut=magnetometer.hard_iron_sigma_ut,
                soft_iron=magnetometer.soft_iron,
                field_ut=magnetometer.field_ut,
                field_sigma=magnetometer.field_sigma,
            ),
        )

    def check_fits(
        self, chip: ChipIdentity, *, gyro_range_dps: int, accel_range_g: int, offsets: OffsetsTable | None = None
    ) -> None:
        """Raises CalibrationError, with the reason, where this is not the calibration of this chip as it is set.

        offsets   what is written to the chip's own offset registers, None for the factory's words
        """
        mine, made = self.chip, self.made
        if mine.is_fake != chip.is_fake:
            raise CalibrationError(f"it was made on {mine.bus} and this is {chip.bus}: a fake chip is not a real one")
        if mine.who_am_i != chip.who_am_i:
            raise CalibrationError(
                f"it is of a chip with WHO_AM_I 0x{mine.who_am_i:02x}, this one has 0x{chip.who_am_i:02x}: calibrate it"
            )
        if mine.fingerprint and chip.fingerprint:
            if mine.fingerprint != chip.fingerprint:
                raise CalibrationError(
                    "it is of another chip of the same kind, by the factory's trim: calibrate this one"
                )
        elif (mine.bus, mine.address) != (chip.bus, chip.address):
            raise CalibrationError(
                f"it is of the chip at 0x{mine.address:02x} on {mine.bus}, this one is at 0x{chip.address:02x} on "
                f"{chip.bus}, and its factory's trim cannot be compared: calibrate it"
            )
        if (made.gyro_range_dps, made.accel_range_g) != (gyro_range_dps, accel_range_g):
            raise CalibrationError(
                f"it was made at {made.gyro_range_dps} deg/s and {made.accel_range_g} g, the chip is set to "
                f"{gyro_range_dps} deg/s and {accel_range_g} g: set the same in [chip], or calibrate anew"
            )
        if self.offsets != offsets:
            raise CalibrationError(
                "it was made with other words in the chip's offset registers: set the same in [offsets], or calibrate "
                "anew"
            )


_SIGMA_OF = {
    "accelerometer": "sigma_m_s2",
    "gyro_bias": "sigma_rad_s",
    "gyro_scale": "scale_sigma",
    "magnetometer": "field_sigma",
}


def in_words(part: str) -> str:
    return part.replace("_", " ")


def reasons_worse(new: CalibrationRecord, *, than: CalibrationRecord) -> tuple[str, ...]:
    """What `than` has or knows better than the new record, in words; none where the new one may take its place."""
    missing = [f"it has no {in_words(part)}" for part in PARTS if than.has(part) and not new.has(part)]
    return (*missing, *(reason for part in PARTS for reason in part_worse(part, new, than=than)))


def part_worse(part: str, new: CalibrationRecord, *, than: CalibrationRecord) -> tuple[str, ...]:
    """In what one of PARTS is worse, in words; nothing where one of the two has none."""
    old_table, new_table = getattr(than, part), getattr(new, part)
    if old_table is None or new_table is None:
        return ()
    reasons = []
    ratio = getattr(new_table, _SIGMA_OF[part]) / max(getattr(old_table, _SIGMA_OF[part]), 1e-12)
    if ratio > 1.25:
        reasons.append(f"its {in_words(part)} is {ratio:.1f} times less sure")
    if part in ("accelerometer", "gyro_scale"):
        hidden = [name for name in new_table.undetermined if name not in old_table.undetermined]
        reasons += [f"its {in_words(part)} does not show {', '.join(hidden)}"] if hidden else []
    if part == "accelerometer" and (old_table.frame, new_table.frame) == ("faces", "sensor"):
        reasons.append("its axes are the sensor's, not those of the board's faces")
    if part == "gyro_bias":
        old_span, new_span = (table.highest_degc - table.lowest_degc for table in (old_table, new_table))
        if new_span < 0.8 * old_span:
            reasons.append(f"its bias is known over {new_span:.0f} degC, not over {old_span:.0f}")
    return tuple(reasons)


def is_better(new: CalibrationRecord, *, than: CalibrationRecord) -> bool:
    """Whether the new record has all the old one has, as sure and over as many temperatures."""
    return not reasons_worse(new, than=than)


def accelerometer_table(fit: AccelerometerFit) -> AccelerometerTable:
    return AccelerometerTable(
        offset_m_s2=fit.offset_m_s2,
        offset_sigma_m_s2=vector(fit.sigma[:3] * STANDARD_GRAVITY_M_S2),
        matrix=fit.matrix,
        matrix_sigma=_matrix(fit.sigma[3:]),
        frame=fit.frame,
        undetermined=fit.undetermined,
        sigma_m_s2=fit.accel_sigma_m_s2,
        rms_before_g=fit.rms_before_g,
        rms_after_g=fit.rms_after_g,
        residual_g=fit.residual_g,
    )


def gyro_bias_table(fit: BiasFit) -> GyroBiasTable:
    curve = fit.curve()
    return GyroBiasTable(
        reference_degc=curve.reference_degc,
        coefficients_rad_s=curve.coefficients_rad_s,
        lowest_degc=curve.lowest_degc,
        highest_degc=curve.highest_degc,
        sigma_rad_s=curve.sigma_rad_s,
        slope_sigma_rad_s_degc=curve.slope_sigma_rad_s_degc,
        per_force_rad_s=fit.per_force,
        residual_rms_rad_s=float(np.sqrt((fit.residual_rad_s**2).mean())),
    )


def gyro_scale_table(fit: TurnFit) -> GyroScaleTable:
    return GyroScaleTable(
        matrix=fit.matrix,
        matrix_sigma=_matrix(fit.sigma),
        undetermined=fit.undetermined,
        scale_sigma=fit.scale_sigma,
        # A turn whose angle was not known has no residual about the vertical.
        residual_deg=tuple(tuple(r for r in row if r == r) for row in fit.residual_deg.tolist()),
    )


def magnetometer_table(fit: MagnetometerFit) -> MagnetometerTable:
    return MagnetometerTable(
        hard_iron_ut=fit.calibration.hard_iron_ut,
        hard_iron_sigma_ut=fit.calibration.hard_iron_sigma_ut,
        soft_iron=fit.calibration.soft_iron,
        field_ut=fit.field_ut,
        field_sigma=fit.calibration.field_sigma,
        coverage=fit.coverage,
        rms_before=fit.rms_before,
        rms_after=fit.rms_after,
    )


def _curve(table: GyroBiasTable) -> BiasCurve:
    return BiasCurve(
        reference_degc=table.reference_degc,
        coefficients_rad_s=table.coefficients_rad_s,
        lowest_degc=table.lowest_degc,
        highest_degc=table.highest_degc,
        sigma_rad_s=table.sigma_rad_s,
        slope_sigma_rad_s_degc=table.slope_sigma_rad_s_degc,
    )


def _matrix(nine: FloatArray) -> Matrix:
    x, y, z = (vector(row) for row in nine.reshape(3, 3))
    return x, y, z
