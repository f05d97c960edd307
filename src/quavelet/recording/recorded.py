"""Any recording as raw blocks: the product's own (.qrec), or arrays in an npz file, with the truth where it has one."""

from __future__ import annotations

import zipfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from quavelet.core.blocks import BoolArray, CountArray, FloatArray, RawBlock, Scale, concat
from quavelet.core.errors import RecordingError, SettingsError
from quavelet.core.health import Health
from quavelet.core.units import NS_PER_S, RAD_PER_DEG, STANDARD_GRAVITY_M_S2
from quavelet.mpu6050.decoder import clip_flags
from quavelet.mpu6050.stream import StreamInfo
from quavelet.recording.reader import RecordingReader
from quavelet.recording.replay import ReplaySource
from quavelet.settings import Settings

SHORTEST_S = 3.0
_ZIP = b"PK\x03\x04"
_Q_REF_SCALE = 32000.0
_TEMP_DEGC_PER_LSB, _TEMP_DEGC_AT_ZERO = 1.0 / 340.0, 36.53
_NO_TEMP_DEGC = 25.0
Arrays = Mapping[str, NDArray[Any]]


@dataclass(frozen=True, slots=True, eq=False)
class Truth:
    """A measured attitude q (N, 4), body to world, and the samples (N,) it is scored on."""

    q: FloatArray
    scored: BoolArray


@dataclass(frozen=True, slots=True, eq=False)
class Recorded:
    """What a file holds.

    runs      raw blocks, each of one scale; a chip that was restarted with other ranges begins another
    settings  those it was recorded with, None where the file has none
    damage    a sentence about what could not be read of it, "" where all could
    note      a sentence about settings that this version no longer takes, "" where it takes them
    stream    the chip as it was configured last, None where the file does not say
    calibration   the text of the calibration's file that was in use, "" without one
    """

    path: Path
    runs: tuple[RawBlock, ...]
    truth: Truth | None = None
    settings: Settings | None = None
    damage: str = ""
    note: str = ""
    stream: StreamInfo | None = None
    calibration: str = ""

    @property
    def seconds(self) -> float:
        """From the first sample to the last."""
        return float(self.runs[-1].t_ns[-1] - self.runs[0].t_ns[0]) / NS_PER_S


def load_recorded(path: Path) -> Recorded:
    """The recording in `path`. Raises RecordingError, naming the file, where nothing can be done with it.

    An npz file holds these arrays of N samples; N x 3, body axes, +g up at rest:

    gyr, acc              with gyr_scale (rad/s) and acc_scale (m/s^2), or gyr_lsb_per_dps and acc_lsb_per_g
    gyro_rad_s, acc_m_s2  in their place, as they are
    fs or rate            Hz
    temp                  may be absent: counts of the chip
    q_ref (N, 4)          may be absent: the measured attitude, scalar first, body to world with z up; whole numbers
                          are divided by 32000
    q_valid, mov (N,)     may be absent: where q_ref holds, and where it is scored
    """
    recorded = _npz(path) if _begins_with(path, _ZIP) else _qrec(path)
    samples = sum(map(len, recorded.runs))
    if samples < 2 or recorded.seconds < SHORTEST_S:
        raise RecordingError(
            f"{path} has {samples} samples of {recorded.seconds if samples else 0.0:.1f} s: record "
            f"{SHORTEST_S:g} s or more"
        )
    return recorded


def _begins_with(path: Path, magic: bytes) -> bool:
    try:
        with path.open("rb") as file:
            return file.read(len(magic)) == magic
    except OSError:
        return False  # the reader of recordings says what is the matter


def _qrec(path: Path) -> Recorded:
    reader = RecordingReader(path)
    source = ReplaySource(reader, health=Health())
    runs: list[list[RawBlock]] = []
    while (block := source.read()) is not None:
        if not len(block):
            continue
        if not runs or runs[-1][0].scale != block.scale:
            runs.append([])
        runs[-1].append(block)
    try:
        reader.check()
        damage = ""
    except RecordingError as error:
        damage = str(error)
    if not runs:
        raise RecordingError(damage or f"{path} holds no samples: record again")
    settings, note = None, ""
    try:
        settings = source.settings
    except SettingsError as error:
        note = f"{error}; the defaults are in their place"
    return Recorded(
        path,
        tuple(concat(run) for run in runs),
        settings=settings,
        damage=damage,
        note=note,
        stream=source.info,
        calibration=reader.header.calibration,
    )


def _npz(path: Path) -> Recorded:
    arrays = _arrays(path)
    gyro, gyro_lsb = _counts(arrays, "gyr", "gyro_rad_s", _gyro_lsb(arrays, path), path)
    accel, accel_lsb = _counts(arrays, "acc", "acc_m_s2", _accel_lsb(arrays, path), path)
    n = len(gyro)
    if len(accel) != n:
        raise RecordingError(
            f"{path}: gyroscope and accelerometer have {n} and {len(accel)} rows: give as many of both"
        )
    rate_hz = _number(arrays, "fs", path) or _number(arrays, "rate", path)
    if rate_hz is None:
        raise RecordingError(f"{path} has no sample rate: add it as 'fs', in Hz")
    temp, at_zero = np.zeros(n, dtype=np.int16), _NO_TEMP_DEGC
    if "temp" in arrays and arrays["temp"].dtype == np.int16 and arrays["temp"].shape == (n,):
        temp, at_zero = arrays["temp"], _TEMP_DEGC_AT_ZERO
    counts = np.column_stack([accel, temp, gyro]).astype(np.int16)
    # Only a chip's own counts have ends: those of scaled values are where the largest value happens to be.
    of_the_chip = "gyr_lsb_per_dps" in arrays and "acc_lsb_per_g" in arrays
    raw = RawBlock(
        t_ns=np.round(np.arange(1, n + 1) * (NS_PER_S / rate_hz)).astype(np.int64),
        period_s=np.full(n, 1.0 / rate_hz),
        gap_ns=np.zeros(n, dtype=np.int64),
        flags=clip_flags(counts) if of_the_chip else np.zeros(n, dtype=np.uint32),
        counts=counts,
        scale=Scale(gyro_lsb, accel_lsb, _TEMP_DEGC_PER_LSB, at_zero),
    )
    return Recorded(path, (raw,), truth=_truth(arrays, n, path))


def _arrays(path: Path) -> Arrays:
    try:
        # Opened here, since numpy leaves a file open that turns out to be damaged.
        with path.open("rb") as opened, np.load(opened, allow_pickle=False) as file:
            return {name: np.asarray(file[name]) for name in file.files}
    except (OSError, EOFError, ValueError, AttributeError, TypeError, zipfile.BadZipFile, NotImplementedError) as error:
        raise RecordingError(f"{path} is no npz file that can be read ({error}): give another copy of it") from error


def _gyro_lsb(arrays: Arrays, path: Path) -> float | None:
    per_dps = _number(arrays, "gyr_lsb_per_dps", path)
    return RAD_PER_DEG / per_dps if per_dps else _number(arrays, "gyr_scale", path)


def _accel_lsb(arrays: Arrays, path: Path) -> float | None:
    per_g = _number(arrays, "acc_lsb_per_g", path)
    return STANDARD_GRAVITY_M_S2 / per_g if per_g else _number(arrays, "acc_scale", path)


def _counts(arrays: Arrays, name: str, name_si: str, lsb: float | None, path: Path) -> tuple[CountArray, float]:
    """Counts (N, 3) and what one means. Values that are no counts are rounded to 32767 steps of their largest, which is
    finer than any range of the chip that could have held them."""
    if name_si in arrays:
        values = _vectors(arrays, name_si, path)
    elif name not in arrays:
        raise RecordingError(f"{path} has neither '{name}' nor '{name_si}': it is no recording of motion")
    elif lsb is None:
        raise RecordingError(f"{path} does not say what a count of '{name}' is: add '{name}_scale', in SI")
    elif arrays[name].dtype == np.int16:
        return _vectors(arrays, name, path).astype(np.int16), lsb
    else:
        values = _vectors(arrays, name, path) * lsb
    step = max(float(np.abs(values).max(initial=0.0)) / 32767.0, 1e-12)
    return np.round(values / step).astype(np.int16), step


def _vectors(arrays: Arrays, name: str, path: Path) -> FloatArray:
    if arrays[name].dtype.kind not in "iuf" or arrays[name].ndim != 2 or arrays[name].shape[1] != 3:
        raise RecordingError(f"{path}: '{name}' is not N rows of three numbers: record it anew")
    vectors: FloatArray = arrays[name].astype(np.float64)
    if not np.isfinite(vectors).all():
        raise RecordingError(f"{path}: '{name}' has numbers that are not finite: leave those rows out")
    return vectors


def _number(arrays: Arrays, name: str, path: Path) -> float | None:
    if name not in arrays:
        return None
    if (
        arrays[name].size != 1
        or arrays[name].dtype.kind not in "iuf"
        or not 0 < float(arrays[name].reshape(-1)[0]) < 1e9
    ):
        raise RecordingError(f"{path}: '{name}' is not one number above 0: record it anew")
    return float(arrays[name].reshape(-1)[0])


def _truth(arrays: Arrays, n: int, path: Path) -> Truth | None:
    if "q_ref" not in arrays:
        return None
    q_ref = arrays["q_ref"]
    if q_ref.shape != (n, 4) or q_ref.dtype.kind not in "if":
        raise RecordingError(f"{path}: 'q_ref' is not {n} rows of four numbers, as many as 'gyr' has: record it anew")
    q: FloatArray = q_ref.astype(np.float64) / (1.0 if q_ref.dtype.kind == "f" else _Q_REF_SCALE)
    norm = np.linalg.norm(q, axis=1)
    scored = np.isfinite(norm)
    for name in ("q_valid", "mov"):
        if name in arrays:
            if arrays[name].shape != (n,):
                raise RecordingError(f"{path}: '{name}' has not {n} rows, as many as 'gyr' has: record it anew")
            scored &= arrays[name].astype(np.bool_)
    if not scored.any():
        return None
    if not (np.abs(norm[scored] - 1.0) < 0.01).all():
        raise RecordingError(f"{path}: 'q_ref' has rows that are no unit quaternions: mark them in 'q_valid'")
    return Truth(np.where(scored[:, None], q / np.where(scored, norm, 1.0)[:, None], [1.0, 0.0, 0.0, 0.0]), scored)
