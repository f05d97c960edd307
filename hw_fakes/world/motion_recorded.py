"""A recording as motion: what a gyroscope and an accelerometer once felt, and the attitude that was measured beside."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hw_fakes.world.motion_base import Body, FloatArray, to_body
from hw_fakes.world.npz_file import arrays_in
from quavelet.core.errors import SettingsError
from quavelet.core.quaternion import conjugate, from_rotation_vector, multiply
from quavelet.core.units import STANDARD_GRAVITY_M_S2

BoolArray = NDArray[np.bool_]
Q_REF_SCALE = 32000.0
_UP = np.array([0.0, 0.0, STANDARD_GRAVITY_M_S2])


@dataclass(frozen=True, slots=True, eq=False)
class RecordedMotion(Body):
    """A recording of N samples, the first at 0 s; before it and after the last the board lies still as there.

    Rate and specific force are as they were recorded, with their noise and bias, and straight lines between samples.
    Attitude goes by the shortest turn between samples. Where it was measured it is the measured one, so it and the rate
    belong together as well as the recording's sensors did; elsewhere it is the integral of the rate.

    gyro_rad_s, accel_m_s2  (N, 3)
    fs_hz                   samples a second
    q                       (N, 4), body to world
    integrated              (N,), whether `q` is an integral and not measured
    """

    gyro_rad_s: FloatArray
    accel_m_s2: FloatArray
    fs_hz: float
    q: FloatArray
    integrated: BoolArray

    @property
    def end_s(self) -> float:
        """The time of the last sample."""
        return (len(self.q) - 1) / self.fs_hz

    def attitude(self, t_s: FloatArray) -> FloatArray:
        row, part, _ = self._between(t_s)
        return _turned(self.q[row], self.q[row + 1], part)

    def rate_rad_s(self, t_s: FloatArray) -> FloatArray:
        row, part, inside = self._between(t_s)
        rate = _mixed(self.gyro_rad_s, row, part)
        rate[~inside] = 0.0
        return rate

    def specific_force_m_s2(self, t_s: FloatArray) -> FloatArray:
        row, part, inside = self._between(t_s)
        force = _mixed(self.accel_m_s2, row, part)
        outside = ~inside
        if outside.any():
            force[outside] = to_body(self.attitude(t_s[outside]), np.broadcast_to(_UP, (int(outside.sum()), 3)))
        return force

    def _between(self, t_s: FloatArray) -> tuple[NDArray[np.int64], FloatArray, BoolArray]:
        """The sample (N,) before each time, the part of the way to the next, and whether the recording covers it."""
        at = t_s * self.fs_hz
        row = np.clip(np.floor(at), 0, len(self.q) - 2).astype(np.int64)
        return row, np.clip(at - row, 0.0, 1.0), (at >= 0) & (at <= len(self.q) - 1)


def load_motion(path: str | Path) -> RecordedMotion:
    """The recording in an npz file.

    gyr (N, 3) x gyr_scale  rad/s, body axes
    acc (N, 3) x acc_scale  m/s^2, specific force: +g up at rest
    fs                      Hz
    q_ref (N, 4)            may be absent: the measured attitude, body to world (z up), scalar first; whole numbers are
                            divided by 32000
    q_valid (N,)            may be absent: where q_ref holds

    Without q_ref the board begins at heading 0, tilted as the first quarter of a second of acc says. Raises
    SettingsError, naming the file, where it cannot be read, lacks something or holds no motion.
    """
    arrays = arrays_in(path, named_after="motion:")
    gyro = _vectors(arrays, "gyr", path) * _number(arrays, "gyr_scale", path)
    accel = _vectors(arrays, "acc", path) * _number(arrays, "acc_scale", path)
    fs_hz = _number(arrays, "fs", path)
    if len(gyro) != len(accel) or len(gyro) < 2:
        raise SettingsError(f"gyr and acc in {path} are not of one length from 2 on: record it anew")
    measured, valid = _measured(arrays, len(gyro), path)
    q, integrated = _attitude(gyro / fs_hz, measured, valid, _first_attitude(accel[: max(1, int(fs_hz / 4))]))
    return RecordedMotion(gyro, accel, fs_hz, q, integrated)


def _attitude(
    turns_rad: FloatArray, measured: FloatArray, valid: BoolArray, start: FloatArray
) -> tuple[FloatArray, BoolArray]:
    """Attitude (N, 4) from turns (N, 3) a sample: measured where valid, integrated before, between and after."""
    # A row turns to the next by the mean of their rates.
    steps = from_rotation_vector((turns_rad[:-1] + turns_rad[1:]) / 2)
    q, known = measured.copy(), np.flatnonzero(valid)
    if len(known) == 0:
        q[0], known = start, np.zeros(1, dtype=np.int64)
    for row in range(known[0] - 1, -1, -1):
        q[row] = multiply(q[row + 1], conjugate(steps[row]))
    for before, after in zip(known, [*known[1:], len(q)], strict=True):
        for row in range(before + 1, min(after, len(q))):
            q[row] = multiply(q[row - 1], steps[row - 1])
        if before + 1 < after < len(q):
            # What the integral missed by the next measurement is spread over the gap.
            reached = multiply(q[after - 1], steps[after - 1])
            missed = multiply(conjugate(reached), q[after])
            part = np.arange(1, after - before) / (after - before)
            whole = np.broadcast_to(missed, (len(part), 4))
            q[before + 1 : after] = multiply(q[before + 1 : after], _turned(np.eye(1, 4), whole, part))
    # One sign throughout, so that neighbours are near each other as numbers too.
    flips = np.cumprod(np.where((q[1:] * q[:-1]).sum(1) < 0, -1.0, 1.0))
    q[1:] *= flips[:, None]
    return q / np.linalg.norm(q, axis=1, keepdims=True), ~valid


def _first_attitude(accel: FloatArray) -> FloatArray:
    """The attitude (4,) of heading 0 in which the mean of `accel` points up."""
    x, y, z = accel.mean(0)
    roll, pitch = np.arctan2(y, z) / 2, np.arctan2(-x, np.hypot(y, z)) / 2
    about_y = np.array([np.cos(pitch), 0.0, np.sin(pitch), 0.0])
    return multiply(about_y, np.array([np.cos(roll), np.sin(roll), 0.0, 0.0]))


def _turned(p: FloatArray, q: FloatArray, part: FloatArray) -> FloatArray:
    """A `part` (N,) of the shortest turns from p to q (N, 4)."""
    way = multiply(conjugate(p), q)
    way = np.where(way[:, :1] < 0, -way, way)
    sine = np.linalg.norm(way[:, 1:], axis=1)
    half = part * np.arctan2(sine, way[:, 0])
    axis = way[:, 1:] / np.where(sine > 0, sine, 1.0)[:, None]
    return multiply(p, np.column_stack([np.cos(half), axis * np.sin(half)[:, None]]))


def _mixed(values: FloatArray, row: NDArray[np.int64], part: FloatArray) -> FloatArray:
    mixed: FloatArray = values[row] + part[:, None] * (values[row + 1] - values[row])
    return mixed


def _numbers(arrays: Mapping[str, NDArray[Any]], name: str, path: str | Path) -> FloatArray:
    if name not in arrays:
        raise SettingsError(f"{path} has no '{name}': it is not a recording of motion")
    if arrays[name].dtype.kind not in "iuf":
        raise SettingsError(f"'{name}' in {path} is {arrays[name].dtype}, not numbers: record it anew")
    numbers: FloatArray = arrays[name].astype(np.float64)
    if not np.isfinite(numbers).all() and name != "q_ref":
        raise SettingsError(f"'{name}' in {path} has numbers that are not finite: record it anew")
    return numbers


def _vectors(arrays: Mapping[str, NDArray[Any]], name: str, path: str | Path) -> FloatArray:
    vectors = _numbers(arrays, name, path)
    if vectors.ndim != 2 or vectors.shape[1] != 3:
        raise SettingsError(f"'{name}' in {path} is not of shape (N, 3): record it anew")
    return vectors


def _number(arrays: Mapping[str, NDArray[Any]], name: str, path: str | Path) -> float:
    number = _numbers(arrays, name, path)
    if number.size != 1 or not number.reshape(-1)[0] > 0:
        raise SettingsError(f"'{name}' in {path} is not one number above 0: record it anew")
    return float(number.reshape(-1)[0])


def _measured(arrays: Mapping[str, NDArray[Any]], n: int, path: str | Path) -> tuple[FloatArray, BoolArray]:
    """The measured attitude (N, 4) and where it holds (N,)."""
    if "q_ref" not in arrays:
        return np.zeros((n, 4)), np.zeros(n, dtype=np.bool_)
    q = _numbers(arrays, "q_ref", path)
    if q.shape != (n, 4):
        raise SettingsError(f"'q_ref' in {path} is not of shape (N, 4) with the N of gyr: record it anew")
    valid = arrays["q_valid"].astype(np.bool_) if "q_valid" in arrays else np.ones(n, dtype=np.bool_)
    if valid.shape != (n,):
        raise SettingsError(f"'q_valid' in {path} is not of shape (N,) with the N of gyr: record it anew")
    if arrays["q_ref"].dtype.kind != "f":
        q /= Q_REF_SCALE
    if not (np.abs(np.linalg.norm(q[valid], axis=1) - 1) < 0.01).all():
        raise SettingsError(f"'q_ref' in {path} has rows that are no unit quaternions: leave them out by q_valid")
    return np.where(valid[:, None], q, 0.0), valid
