"""From what a session measured to a calibration: each estimator in its turn, none where its step was left out."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from quavelet.bench.session_evidence import Evidence, Move
from quavelet.bench.steps.turns import turn_of
from quavelet.calibration.accelerometer import AccelerometerFit, fit_accelerometer
from quavelet.calibration.calibrate import Calibrate
from quavelet.calibration.gyro_bias import BiasFit, fit_gyro_bias
from quavelet.calibration.magnetometer import MagnetometerFit, fit_magnetometer
from quavelet.calibration.model import UNCALIBRATED, Matrix
from quavelet.calibration.noise import AxisNoise, noise_of
from quavelet.calibration.poses import StillPose
from quavelet.calibration.record import (
    CalibrationRecord,
    Made,
    accelerometer_table,
    gyro_bias_table,
    gyro_scale_table,
    magnetometer_table,
)
from quavelet.calibration.record_merge import Merged, accelerometer_of, merge
from quavelet.calibration.turns import Turn, TurnFit, fit_turns, turn_between
from quavelet.core.errors import CalibrationError
from quavelet.core.units import RAD_PER_DEG

BIAS_SIGMA_RAD_S = 0.01 * RAD_PER_DEG
"""What a bias measured some minutes before is off by, one sigma."""
LEAST_POSES = 4
SURE_SCALE = 0.003
"""What moves that nobody asked for show of the scale is taken where it is as sure as that."""


@dataclass(frozen=True, slots=True)
class Result:
    """All fits of a session, None where there was nothing to fit, and the record they make.

    refused   by estimator, why it gave nothing although its step was done
    merged    what there is to be saved: the parts made anew, and what an older calibration of the chip has beside them
    """

    evidence: Evidence
    accel: AccelerometerFit | None
    bias: BiasFit | None
    turns: TurnFit | None
    field: MagnetometerFit | None
    noise: tuple[AxisNoise, ...]
    refused: dict[str, str]
    merged: Merged

    @property
    def record(self) -> CalibrationRecord:
        return self.merged.record


def work_out(
    evidence: Evidence,
    *,
    utc: str,
    version: str,
    older: CalibrationRecord | None = None,
    even_if_worse: bool = False,
) -> Result:
    """Every fit that the evidence allows. Those that fail are named in `refused`, and leave their part uncalibrated.

    utc, version           when and by what it was made, for the record
    older, even_if_worse   a calibration of the same chip, set the same way, and what to keep of it: see `merge`
    """
    refused: dict[str, str] = {}
    accel = turns = field = None
    if evidence.placed or len(evidence.poses) >= LEAST_POSES:
        try:
            accel = fit_accelerometer(evidence.poses, placed=evidence.placed)
        except CalibrationError as error:
            refused["accelerometer"] = str(error)
    # Turns without faces are seen by the accelerometer as it is known from before.
    level = accel or (accelerometer_of(older.accelerometer) if older and older.accelerometer else None)
    poses = every_pose(evidence)
    bias = fit_gyro_bias([level.pose(pose) if level else pose for pose in poses]) if poses else None
    if bias is not None and (evidence.told or (evidence.moves and accel is not None)):
        try:
            turns = fit_turns(
                _turns(evidence, level, bias),
                bias_sigma_rad_s=BIAS_SIGMA_RAD_S,
                accelerometer=level,
                axes=_axes_known(older) if accel is None else None,
            )
        except CalibrationError as error:
            # Moves that nobody asked for may show no scale; turns that were asked for have to.
            if evidence.told:
                refused["gyroscope scale"] = str(error)
    if turns is not None and not evidence.told and turns.scale_sigma > SURE_SCALE:
        turns = None
    if not evidence.measured_bias:
        bias = None
    if evidence.field_ut:
        try:
            field = fit_magnetometer(np.array(evidence.field_ut))
        except CalibrationError as error:
            refused["magnetometer"] = str(error)
    fresh = _record(evidence, (utc, version), accel, bias, turns, field)
    merged = merge(fresh, older, even_if_worse=even_if_worse)
    return Result(evidence, accel, bias, turns, field, _noise(evidence), refused, merged)


def every_pose(evidence: Evidence) -> list[StillPose]:
    """All but those held out, each once, in the order of time."""
    ends = (pose for move in (*evidence.moves, *evidence.told) for pose in (move.before, move.after))
    held_out = {pose.begin_ns for pose in evidence.check}
    every = {pose.begin_ns: pose for pose in (*evidence.rest, *evidence.placed, *evidence.poses, *ends)}
    return [every[begin] for begin in sorted(every) if begin not in held_out]


def _axes_known(older: CalibrationRecord | None) -> tuple[Matrix, Matrix] | None:
    """The gyroscope's axes by an older calibration, which must be that of the accelerometer as well."""
    if older is None or older.gyro_scale is None or older.accelerometer is None:
        return None
    return older.gyro_scale.matrix, older.gyro_scale.matrix_sigma


def _turns(evidence: Evidence, accel: AccelerometerFit | None, bias: BiasFit) -> list[Turn]:
    # An accelerometer that is degrees off says wrong what a change of face was; a whole turn ends as it began.
    moves = evidence.moves if accel is not None else []
    turns = [_turn(move, evidence, accel, bias) for move in moves]
    for move in evidence.told:
        found = turn_of(move.turned_deg)
        assert found is not None, "only such are taken"
        axis, way = found
        turn = _turn(move, evidence, accel, bias)
        turns.append(None if turn is None else replace(turn, axis=axis, angle_rad=way * 2.0 * np.pi))
    return [turn for turn in turns if turn is not None]


def _turn(move: Move, evidence: Evidence, accel: AccelerometerFit | None, bias: BiasFit) -> Turn | None:
    """None where a rate was beyond the range."""
    rows = Calibrate(UNCALIBRATED).process(move.rows(evidence.chip.scale))
    before, after = move.before, move.after
    if accel is not None:
        rows, before, after = accel.block(rows), accel.pose(before), accel.pose(after)
    try:
        return turn_between(rows, before, after, bias_rad_s=bias.rows(rows))
    except CalibrationError:
        return None


def _record(
    evidence: Evidence,
    made: tuple[str, str],
    accel: AccelerometerFit | None,
    bias: BiasFit | None,
    turns: TurnFit | None,
    field: MagnetometerFit | None,
) -> CalibrationRecord:
    temps = [pose.temp_degc for pose in (*every_pose(evidence), *evidence.check)] or [25.0]
    return CalibrationRecord(
        chip=evidence.chip.identity,
        made=Made(
            utc=made[0],
            version=made[1],
            gyro_range_dps=evidence.chip.gyro_range_dps,
            accel_range_g=evidence.chip.accel_range_g,
            lowest_degc=min(temps),
            highest_degc=max(temps),
        ),
        accelerometer=accelerometer_table(accel) if accel else None,
        gyro_bias=gyro_bias_table(bias) if bias else None,
        gyro_scale=gyro_scale_table(turns) if turns else None,
        magnetometer=magnetometer_table(field) if field else None,
        offsets=evidence.chip.offsets,
    )


def _noise(evidence: Evidence) -> tuple[AxisNoise, ...]:
    runs = evidence.still
    if not runs:
        return ()
    # The chip's period moves by parts in ten thousand meanwhile: too little to be seen in an averaging time.
    period_s = sum(run.period_s for run in runs) / len(runs)
    return noise_of([run.si(evidence.chip.scale) for run in runs], period_s=period_s)
