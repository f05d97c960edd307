"""The calibration that a session goes over: what it does not measure anew may be kept of that."""

from __future__ import annotations

from pathlib import Path

from quavelet.bench.session_evidence import Chip
from quavelet.calibration.record import CalibrationRecord
from quavelet.calibration.record_file import load_record
from quavelet.core.errors import CalibrationError


def older_of(path: Path, chip: Chip) -> tuple[CalibrationRecord | None, str]:
    """The calibration there, None where there is none that fits the chip as it is set; and why it does not."""
    if not path.exists():
        return None, ""
    try:
        older = load_record(path)
        older.check_fits(
            chip.identity,
            gyro_range_dps=chip.gyro_range_dps,
            accel_range_g=chip.accel_range_g,
            offsets=chip.offsets,
        )
    except CalibrationError as error:
        return None, str(error)
    return older, ""
