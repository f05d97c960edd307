"""`quavelet calibrate --from`: the evidence in a recording, and whose it is."""

from __future__ import annotations

from pathlib import Path

import typer

from quavelet.bench.session_evidence import Chip, Evidence
from quavelet.bench.session_recorded import SHOWN, evidence_of
from quavelet.calibration.record import ChipIdentity, OffsetsTable
from quavelet.calibration.record_file import (
    check_writable,
    default_path,
    from_toml,
)
from quavelet.core.errors import CalibrationError, RecordingError
from quavelet.imu import offsets_table
from quavelet.mpu6050.stream import StreamInfo
from quavelet.mpu6050.variants import MPU6050
from quavelet.recording.recorded import Recorded, load_recorded
from quavelet.settings import Settings


def chip_of(identity: ChipIdentity, info: StreamInfo, offsets: OffsetsTable | None) -> Chip:
    """What the evidence keeps of a chip."""
    return Chip(
        identity=identity,
        gyro_range_dps=info.gyro_range_dps,
        accel_range_g=info.accel_range_g,
        scale=info.scale,
        offsets=offsets,
    )


def recorded_evidence(
    file: Path, out: Path | None, settings: Settings, names: tuple[str, ...], *, bus: str | None
) -> tuple[Evidence, str, Path]:
    """The evidence in a recording, what it is of, and where the calibration goes."""
    if not set(SHOWN) & set(names):
        raise typer.BadParameter(f"a recording shows {', '.join(SHOWN)}: take some of them", param_hint="--steps")
    recorded = load_recorded(file)
    if len(recorded.runs) > 1:
        raise CalibrationError(f"{file}: the chip's ranges changed in it: record again, with one of them")
    if recorded.stream is not None and bus is not None:
        raise typer.BadParameter("the recording says itself what it is of: leave --bus out")
    if out is None and not recorded.calibration:
        # Only a chip says by its factory's trim which one it is, and `run` looks for it by that.
        raise typer.BadParameter("the recording does not say which chip it is of: give --out", param_hint="--from")
    chip = _recorded_chip(recorded, settings, bus)
    out = out or default_path(chip.identity)
    check_writable(out)
    evidence = evidence_of(recorded.runs, chip, steps=names)
    if recorded.damage:
        raise RecordingError(recorded.damage)
    return evidence, f"replay:{chip.identity.bus}", out


def _recorded_chip(recorded: Recorded, settings: Settings, bus: str | None) -> Chip:
    """The chip of a recording; arrays say nothing of theirs, so it is that of the options, on a bus of the file's name
    where none is given: such a calibration `run` does not take for that of a chip."""
    info, (run,) = recorded.stream, recorded.runs
    if info is None:
        chip = settings.chip
        identity = ChipIdentity(
            who_am_i=MPU6050.who_am_i,
            name=MPU6050.name,
            bus=bus or f"recording:{recorded.path.name}",
            address=settings.bus.address,
        )
        return Chip(
            identity=identity, gyro_range_dps=chip.gyro_range_dps, accel_range_g=chip.accel_range_g, scale=run.scale
        )
    if recorded.calibration:
        record = from_toml(recorded.calibration)
        return chip_of(record.chip, info, record.offsets)
    identity = ChipIdentity(who_am_i=info.who_am_i, name=info.variant.name, bus=info.src, address=info.address)
    return chip_of(identity, info, offsets_table(recorded.settings.offsets.plan()) if recorded.settings else None)
