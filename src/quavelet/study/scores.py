"""What a method made of a recording, in figures: against truth, against gravity, and where the board lay still."""

from __future__ import annotations

from dataclasses import dataclass
from math import nan

import numpy as np

from quavelet.core.blocks import AttitudeBlock, BoolArray, Flag, FloatArray
from quavelet.core.euler import to_euler
from quavelet.core.quaternion import conjugate, inclination_between, multiply, rotate
from quavelet.core.units import DEG_PER_RAD, NS_PER_S, RAD_PER_DEG
from quavelet.recording.recorded import Truth

GRAVITY_WITHIN = 0.03
GRAVITY_RATE_RAD_S = 20.0 * RAD_PER_DEG
"""An accelerometer is believed to show gravity where its norm is within 3 % of the usual and the rate below this."""
LATEST_S = 10.0
NOT_YET = Flag.BIAS_UNKNOWN | Flag.SETTLING


@dataclass(frozen=True, slots=True)
class Score:
    """Figures in deg; NaN where the recording cannot say.

    wander      (roll, pitch, yaw) largest departure from the mean while the board lay still
    wander_rms  the same, root mean square
    gravity     rms angle between the attitude's vertical and the accelerometer, where that can be believed
    truth       rms inclination error, BROAD's metric: heading of six axes cannot be known and is not in it
    truth_max   its largest
    heading     heading error at the end, it being right at the first scored sample
    apart       rms inclination between this method and the default
    """

    wander: tuple[float, float, float]
    wander_rms: tuple[float, float, float]
    gravity: float
    truth: float
    truth_max: float
    heading: float
    apart: float


def settled_from(block: AttitudeBlock) -> int:
    """The row from which on figures count: where the attitude first says that it can be trusted, at the latest after
    ten seconds or a quarter of the recording."""
    ready = np.flatnonzero((block.flags & NOT_YET) == 0)
    latest = min(len(block) // 4, int(LATEST_S / float(np.median(block.period_s))))
    return min(int(ready[0]), latest) if len(ready) else latest


def still_rows(block: AttitudeBlock, *, start: int = 0) -> slice:
    """The longest stretch from row `start` on in which the board lay still and nothing was lost; perhaps empty."""
    still = block.still & ((block.flags & (Flag.GAP | Flag.STUCK)) == 0)
    still[:start] = False
    edges = np.flatnonzero(np.diff(np.concatenate([[False], still, [False]])))
    if not len(edges):
        return slice(0, 0)
    starts, ends = edges[::2], edges[1::2]
    longest = int(np.argmax(ends - starts))
    return slice(int(starts[longest]), int(ends[longest]))


def angles_deg(q: FloatArray) -> FloatArray:
    """Roll, pitch, yaw (N, 3) in deg, without jumps of a whole turn."""
    angles: FloatArray = DEG_PER_RAD * np.unwrap(to_euler(q), axis=0)
    return angles


def drawn_deg(q: FloatArray) -> FloatArray:
    """Roll, pitch, yaw (N, 3) in deg within a half turn, NaN where a line would cross from one end to the other."""
    angles: FloatArray = DEG_PER_RAD * to_euler(q)
    angles[1:][np.abs(np.diff(angles, axis=0)) > 180.0] = nan
    return angles


def truth_errors_deg(q: FloatArray, truth: Truth) -> FloatArray:
    """The inclination error (N,); NaN where truth is not scored."""
    error: FloatArray = np.where(truth.scored, DEG_PER_RAD * inclination_between(truth.q, q), nan)
    return error


def errors_over_time(block: AttitudeBlock, truth: Truth, *, start: int, window: int) -> tuple[FloatArray, FloatArray]:
    """Times in s since the first row, and the rms inclination error in deg of each `window` rows from `start` on; NaN
    where nothing of a window is scored."""
    n = (len(block) - start) // window
    rows = slice(start, start + n * window)
    squares = (truth_errors_deg(block.q, truth)[rows] ** 2).reshape(n, window)
    counted = np.isfinite(squares).sum(axis=1)
    sums = np.nansum(squares, axis=1)
    rms: FloatArray = np.sqrt(np.divide(sums, counted, out=np.full(n, nan), where=counted > 0))
    t_s: FloatArray = ((block.t_ns - block.t_ns[0]) / NS_PER_S)[rows].reshape(n, window).mean(axis=1)
    return t_s, rms


def score(block: AttitudeBlock, reference: AttitudeBlock, *, still: slice, start: int, truth: Truth | None) -> Score:
    """The figures of `block` from row `start` on; `reference` is the default's, with rate and force not denoised, and
    `still` a stretch of its rows."""
    wander, wander_rms = (nan, nan, nan), (nan, nan, nan)
    if still.stop - still.start > 1:
        angles = angles_deg(block.q[still])
        off = angles - angles.mean(axis=0)
        wander, wander_rms = _three(np.abs(off).max(axis=0)), _three(np.sqrt((off**2).mean(axis=0)))
    rms = largest = heading = nan
    if truth is not None:
        errors = truth_errors_deg(block.q, truth)[start:]
        if np.isfinite(errors).any():
            rms, largest = float(np.sqrt(np.nanmean(errors**2))), float(np.nanmax(errors))
            heading = _heading_error_deg(block.q, truth, start)
    apart = DEG_PER_RAD * inclination_between(reference.q, block.q)[start:]
    return Score(
        wander,
        wander_rms,
        _gravity_rms_deg(block.q, reference, start),
        rms,
        largest,
        heading,
        float(np.sqrt((apart**2).mean())),
    )


def _gravity_rms_deg(q: FloatArray, measured: AttitudeBlock, start: int) -> float:
    force = measured.accel_m_s2
    norm = np.linalg.norm(force, axis=1)
    usual = float(np.median(norm))
    believed: BoolArray = np.abs(norm - usual) <= GRAVITY_WITHIN * usual
    believed &= np.linalg.norm(measured.gyro_rad_s, axis=1) <= GRAVITY_RATE_RAD_S
    believed[:start] = False
    if usual == 0.0 or not believed.any():
        return nan
    up = rotate(conjugate(q[believed]), np.array([0.0, 0.0, 1.0]))
    cosine = (up * force[believed]).sum(axis=1) / norm[believed]
    return float(DEG_PER_RAD * np.sqrt((np.arccos(np.clip(cosine, -1.0, 1.0)) ** 2).mean()))


def _heading_error_deg(q: FloatArray, truth: Truth, start: int) -> float:
    """What is about the vertical of the turn from truth to `q`, at the last scored sample minus at the first."""
    rows = np.flatnonzero(truth.scored[start:]) + start
    off = multiply(q[rows], conjugate(truth.q[rows]))
    turn = np.unwrap(2.0 * np.arctan2(off[:, 3], off[:, 0]), period=2.0 * np.pi)
    return float(DEG_PER_RAD * (turn[-1] - turn[0]))


def _three(values: FloatArray) -> tuple[float, float, float]:
    x, y, z = values.tolist()
    return x, y, z
