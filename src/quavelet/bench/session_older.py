"""The calibration that a session goes over: what it does not measure anew may be kept of that."""

from __future__ import annotations

from collections.abc import Callable
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path

from quavelet.bench.session_evidence import Chip, Evidence
from quavelet.bench.session_result import Result, work_out
from quavelet.calibration.record import CalibrationRecord, reasons_worse
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


def work_out_over(evidence: Evidence, out: Path, *, even_if_worse: bool, tell: Callable[[str], None]) -> Result:
    """`work_out` by this version at this moment, over the calibration that is there; tells why that does not fit."""
    older, unfit = older_of(out, evidence.chip)
    if unfit:
        tell(f"nothing is kept of the calibration that is there: {unfit}")
    utc = datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%SZ")
    return work_out(evidence, utc=utc, version=version("quavelet"), older=older, even_if_worse=even_if_worse)


def why_worse(result: Result, out: Path) -> str:
    """What the calibration of the same chip that is there has on this one; "" where nothing, or there is none."""
    merged = result.merged
    if merged.worse and not merged.fresh:
        return ", ".join(merged.worse.values())
    try:
        old = load_record(out) if out.exists() else None
    except CalibrationError:
        return ""
    if old is None or old.chip != result.record.chip:
        return ""
    return ", ".join(reasons_worse(result.record, than=old))
