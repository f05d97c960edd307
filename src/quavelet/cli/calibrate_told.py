"""What `quavelet calibrate` tells at its end on stdout: one JSON object, or a line a finding."""

from __future__ import annotations

import msgspec

from quavelet.bench.finding import Finding
from quavelet.calibration.record import CalibrationRecord
from quavelet.cli import exits
from quavelet.cli.doctor import show_lines


class Calibrated(msgspec.Struct, frozen=True, kw_only=True):
    """The JSON of `quavelet calibrate`.

    verdict   "good", "not good enough", or "worse" than the calibration that is there
    saved     where; None where it was not
    reason    why it was not saved, "" where it was
    noise     of each axis in SI, where there was a long still run
    """

    v: int
    src: str
    verdict: str
    saved: str | None
    reason: str
    findings: tuple[Finding, ...]
    record: CalibrationRecord
    noise: tuple[dict[str, str | float | dict[str, float]], ...]


def tell(told: Calibrated, *, as_json: bool) -> None:
    """All of it, the verdict last."""
    if as_json:
        exits.put(msgspec.json.encode(told).decode())
        return
    for finding in (*told.findings, _summary(told)):
        show_lines(finding)


def _summary(told: Calibrated) -> Finding:
    fake = " (of a fake chip: NOT A REAL ONE)" if "fake:" in told.src else ""
    if told.saved is None:
        return Finding(name="verdict", ok=told.verdict == "good", found=told.reason)
    return Finding(name="verdict", ok=True, found=f"{told.verdict}{fake}; saved as {told.saved}")
