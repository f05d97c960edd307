"""A calibration of some parts over an older one of the same chip: what stays of that, since when, and what cannot."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import msgspec
import numpy as np

from quavelet.calibration.accelerometer import AccelerometerFit
from quavelet.calibration.record import (
    MARGIN_DEGC,
    PARTS,
    AccelerometerTable,
    CalibrationRecord,
    KeptTable,
    part_worse,
)
from quavelet.core.units import STANDARD_GRAVITY_M_S2


@dataclass(frozen=True, slots=True)
class Merged:
    """What there is to be saved.

    record   the parts that were made anew, and those of the older one that are kept
    fresh    names of the parts in it that were made anew
    worse    by part: in what the one that was made anew is worse, so that the older one is kept
    left     by part: why that of the older one cannot be kept, although it was not made anew
    """

    record: CalibrationRecord
    fresh: tuple[str, ...]
    worse: Mapping[str, str] = field(default_factory=dict)
    left: Mapping[str, str] = field(default_factory=dict)

    @property
    def kept(self) -> tuple[str, ...]:
        """Names of the parts that are the older one's."""
        return tuple(part for part in PARTS if self.record.has(part) and part not in self.fresh)


def merge(new: CalibrationRecord, older: CalibrationRecord | None, *, even_if_worse: bool = False) -> Merged:
    """The new record, with what the older one has beside it or knows better; all keep their date and temperatures.

    older           of the same chip, set the same way (`check_fits`); None: there is nothing to keep
    even_if_worse   take whatever was made anew
    """
    made = tuple(part for part in PARTS if new.has(part))
    if older is None:
        return Merged(new, made)
    worse, left, kept = {}, {}, []
    for part in PARTS:
        if not older.has(part):
            continue
        reasons = part_worse(part, new, than=older)
        if new.has(part) and (even_if_worse or not reasons):
            continue
        if wrong := _temperatures_apart(part, new, older):
            if not new.has(part):
                left[part] = wrong
            continue
        kept.append(part)
        if reasons:
            worse[part] = ", ".join(reasons)
    if new.has("accelerometer") and _axes_apart(new, older) and len({"accelerometer", "gyro_scale"} & set(kept)) == 1:
        if "gyro_scale" in kept:
            kept.remove("gyro_scale")
            left["gyro_scale"] = "its axes are not those of the accelerometer made anew: take the step 'turns', too"
        elif new.has("gyro_scale"):
            kept.append("gyro_scale")
            worse["gyro_scale"] = "it is in the axes of that accelerometer"
    record = msgspec.structs.replace(
        new,
        kept=KeptTable(**{part: older.made_of(part) for part in kept}) if kept else None,
        **{part: getattr(older, part) for part in kept},
    )
    return Merged(record, tuple(part for part in made if part not in kept), worse, left)


def _axes_apart(new: CalibrationRecord, older: CalibrationRecord) -> bool:
    a, b = new.accelerometer, older.accelerometer
    return a is not None and b is not None and a.frame != b.frame


def _temperatures_apart(part: str, new: CalibrationRecord, older: CalibrationRecord) -> str:
    """Why there is no temperature at which both hold; "" where there is, or it does not matter."""
    then, now = older.made_of(part), new.made
    inertial = any(new.has(other) for other in PARTS[:3])
    apart = max(then.lowest_degc, now.lowest_degc) - min(then.highest_degc, now.highest_degc)
    if part == "magnetometer" or not inertial or apart <= 2.0 * MARGIN_DEGC:
        return ""
    return (
        f"it was made at {then.lowest_degc:.0f} to {then.highest_degc:.0f} degC, this at {now.lowest_degc:.0f} to "
        f"{now.highest_degc:.0f}: calibrate both at about the same temperature"
    )


def accelerometer_of(table: AccelerometerTable) -> AccelerometerFit:
    """The fit of a record's table, to see other sensors by; how its errors go together is not kept."""
    sigma = np.append(np.array(table.offset_sigma_m_s2) / STANDARD_GRAVITY_M_S2, np.ravel(table.matrix_sigma))
    return AccelerometerFit(
        offset_m_s2=table.offset_m_s2,
        matrix=table.matrix,
        covariance=np.diag(sigma**2),
        frame=table.frame,
        undetermined=table.undetermined,
        residual_g=table.residual_g,
        used=(),
        rms_before_g=table.rms_before_g,
        rms_after_g=table.rms_after_g,
        placed_sigma_rad=None,
        tilt_sigma_rad=table.sigma_m_s2 / STANDARD_GRAVITY_M_S2,
    )
