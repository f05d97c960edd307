"""Still poses out of a stream: which stretches are still, their means and noise; the rest is left out, and counted."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import sqrt

import numpy as np

from quavelet.calibration.model import Vector
from quavelet.calibration.stillness import StillnessLimits
from quavelet.core.blocks import Flag, FloatArray, ImuBlock, concat
from quavelet.core.units import STANDARD_GRAVITY_M_S2

WINDOW_S = 0.25
SHORTEST_S = 1.0
LONGEST_S = 10.0
EDGE_WINDOWS = 1
"""Left off at either end of a stretch: a hand that lets go, or takes hold, is within the limits for a moment."""
_BAD = int(Flag.GAP | Flag.STUCK | Flag.GYRO_CLIPPED | Flag.ACCEL_CLIPPED)
FACE_COS = 0.94
"""A face is up where its axis is within 20 degrees of the vertical."""


@dataclass(frozen=True, slots=True, kw_only=True)
class StillPose:
    """Means over a stretch of stillness, as measured.

    begin_ns, end_ns             the samples it is of
    duration_s, windows          how long, and of how many windows of WINDOW_S
    gyro_rad_s, accel_m_s2       means x y z
    gyro_noise2, accel_noise2    sums of squares of the windows' means about them; by `windows` - 1 the variance
    temp_degc                    mean
    """

    begin_ns: int
    end_ns: int
    duration_s: float
    windows: int
    gyro_rad_s: Vector
    accel_m_s2: Vector
    gyro_noise2: Vector
    accel_noise2: Vector
    temp_degc: float

    @property
    def face(self) -> str | None:
        """Which axis is up, "+x" to "-z"; None where none is within 20 degrees of it."""
        return face_up(self.accel_m_s2)


@dataclass(frozen=True, slots=True)
class PoseCounts:
    """What became of the stretches.

    poses       given
    short       still, but for less than asked for
    disturbed   windows in which the board moved
    drifting    stretches cut where a mean went away from what it was: a board that leans or creeps
    """

    poses: int = 0
    short: int = 0
    disturbed: int = 0
    drifting: int = 0


@dataclass(frozen=True, slots=True)
class _Window:
    begin_ns: int
    end_ns: int
    duration_s: float
    mean: FloatArray


@dataclass(frozen=True, slots=True)
class PoseState:
    """All memory: samples of the window that is not full yet, the still windows so far, and the counts."""

    rows: ImuBlock | None = None
    windows: tuple[_Window, ...] = ()
    counts: PoseCounts = PoseCounts()


class PoseCollector:
    """`ImuBlock`s to `StillPose`s, as they end; splitting a block changes nothing.

    shortest_s   less is no pose
    longest_s    a longer stretch is given in pieces of so much: one that warms up, as many points of its temperature
    """

    def __init__(
        self,
        *,
        shortest_s: float = SHORTEST_S,
        longest_s: float = LONGEST_S,
        limits: StillnessLimits | None = None,
    ) -> None:
        self._least = max(2, round(shortest_s / WINDOW_S))
        self._most = max(self._least + 1, round(longest_s / WINDOW_S))
        self._limits = limits or StillnessLimits()
        self._s = PoseState()

    def state(self) -> PoseState:
        return self._s

    def restore(self, state: PoseState) -> None:
        self._s = state

    @property
    def counts(self) -> PoseCounts:
        return self._s.counts

    @property
    def still_s(self) -> float:
        """For how long the board has been still, without the edges that are left off; 0 while it moves."""
        return sum(window.duration_s for window in self._s.windows[EDGE_WINDOWS:])

    @property
    def current(self) -> StillPose | None:
        """The pose so far, None before there is enough of it."""
        windows = self._s.windows[EDGE_WINDOWS:]
        return _pose(windows) if len(windows) >= self._least else None

    def process(self, block: ImuBlock) -> list[StillPose]:
        """The poses that ended in these rows."""
        if not len(block):
            return []
        rows = block if self._s.rows is None else concat([self._s.rows, block])
        poses: list[StillPose] = []
        begin = 0
        while (end := _window_end(rows, begin)) is not None:
            poses += self._take(rows[begin:end])
            begin = end
        self._s = replace(self._s, rows=rows[begin:] if begin < len(rows) else None)
        return poses

    def finish(self) -> list[StillPose]:
        """The pose that the end of the data cuts off."""
        poses = self._close()
        self._s = replace(self._s, rows=None)
        return poses

    def _take(self, rows: ImuBlock) -> list[StillPose]:
        counts = self._s.counts
        window = _window(rows)
        if not _is_quiet(rows, self._limits):
            poses = self._close()
            counts = self._s.counts
            self._s = replace(self._s, counts=replace(counts, disturbed=counts.disturbed + 1))
            return poses
        windows = self._s.windows
        if windows and not _belongs(window.mean, windows, self._limits):
            if len(windows) > 2 * EDGE_WINDOWS:
                self._s = replace(self._s, counts=replace(counts, drifting=counts.drifting + 1))
            poses = self._close()
            self._s = replace(self._s, windows=(window,))
            return poses
        self._s = replace(self._s, windows=(*windows, window))
        if len(self._s.windows) < self._most + 2 * EDGE_WINDOWS:
            return []
        # The last windows wait: they may be its end.
        given, kept = self._s.windows[: -2 * EDGE_WINDOWS], self._s.windows[-2 * EDGE_WINDOWS :]
        self._s = replace(self._s, windows=kept, counts=replace(self._s.counts, poses=self._s.counts.poses + 1))
        return [_pose(given[EDGE_WINDOWS:])]

    def _close(self) -> list[StillPose]:
        windows, counts = self._s.windows, self._s.counts
        inner = windows[EDGE_WINDOWS : len(windows) - EDGE_WINDOWS]
        if len(inner) >= self._least:
            self._s = replace(self._s, windows=(), counts=replace(counts, poses=counts.poses + 1))
            return [_pose(inner)]
        self._s = replace(self._s, windows=(), counts=replace(counts, short=counts.short + bool(inner)))
        return []


def still_poses(block: ImuBlock, *, shortest_s: float = SHORTEST_S, longest_s: float = LONGEST_S) -> list[StillPose]:
    """All poses of a block."""
    collector = PoseCollector(shortest_s=shortest_s, longest_s=longest_s)
    return [*collector.process(block), *collector.finish()]


def face_up(force: Vector) -> str | None:
    """Which axis points up: "+x" to "-z" by the specific force at rest, None where none does within 20 degrees."""
    axis = max(range(3), key=lambda k: abs(force[k]))
    if abs(force[axis]) < FACE_COS * sqrt(sum(f * f for f in force)):
        return None
    return ("+" if force[axis] > 0 else "-") + "xyz"[axis]


def noise_of(poses: Sequence[StillPose]) -> tuple[FloatArray, FloatArray]:
    """Standard deviation (3,) of one window's mean, of rate and force, pooled over all poses."""
    freedom = max(1, sum(pose.windows - 1 for pose in poses))
    gyro, accel = (
        np.array([getattr(pose, name) for pose in poses]).sum(axis=0) for name in ("gyro_noise2", "accel_noise2")
    )
    return np.sqrt(gyro / freedom), np.sqrt(accel / freedom)


def apart(poses: Sequence[StillPose], *, least_deg: float = 5.0) -> list[StillPose]:
    """Of poses in nearly one direction the longest: a fit must not take one face for many."""
    chosen: list[StillPose] = []
    for pose in sorted(poses, key=lambda pose: -pose.duration_s):
        mine = np.array(pose.accel_m_s2) / np.linalg.norm(pose.accel_m_s2)
        others = (np.array(other.accel_m_s2) / np.linalg.norm(other.accel_m_s2) for other in chosen)
        if all(mine @ other < np.cos(np.radians(least_deg)) for other in others):
            chosen.append(pose)
    return sorted(chosen, key=lambda pose: pose.begin_ns)


def _window_end(rows: ImuBlock, begin: int) -> int | None:
    """The end of the window that begins at this row, None where it is not full; a gap ends one early."""
    if begin >= len(rows):
        return None
    n = max(2, round(WINDOW_S / float(rows.period_s[begin])))
    gaps = np.flatnonzero(rows.flags[begin + 1 : begin + n] & Flag.GAP)
    if len(gaps):
        return begin + 1 + int(gaps[0])
    return begin + n if begin + n <= len(rows) else None


def _is_quiet(rows: ImuBlock, limits: StillnessLimits) -> bool:
    full = len(rows) >= max(2, round(WINDOW_S / float(rows.period_s[0])))
    if not full or (rows.flags & _BAD).any():
        return False
    rate = rows.gyro_rad_s.mean(axis=0)
    return bool(
        (rows.gyro_rad_s.std(axis=0) < limits.gyro_sd_rad_s).all()
        and (rows.accel_m_s2.std(axis=0) < limits.accel_sd_m_s2).all()
        and np.abs(rate).max() < limits.gyro_mean_rad_s
    )


def _belongs(mean: FloatArray, windows: tuple[_Window, ...], limits: StillnessLimits) -> bool:
    """Whether a window's mean is that of the stretch before it, as its halves must be alike."""
    before = np.array([window.mean for window in windows])
    tail = before[-4:].mean(axis=0)
    away = np.maximum(np.abs(mean - before.mean(axis=0)), np.abs(mean - tail))
    # A window is short: its mean may be three sigmas of white noise away.
    gyro = 2.0 * limits.gyro_drift_rad_s
    accel = 2.0 * limits.accel_drift_m_s2
    return bool((away[:3] < gyro).all() and (away[3:6] < accel).all())


def _window(rows: ImuBlock) -> _Window:
    mean = np.concatenate([rows.gyro_rad_s.mean(axis=0), rows.accel_m_s2.mean(axis=0), [rows.temp_degc.mean()]])
    return _Window(int(rows.t_ns[0]), int(rows.t_ns[-1]), float(rows.period_s.sum()), mean)


def _pose(windows: Sequence[_Window]) -> StillPose:
    means = np.array([window.mean for window in windows])
    mean = means.mean(axis=0)
    noise2 = ((means - mean) ** 2).sum(axis=0)
    return StillPose(
        begin_ns=windows[0].begin_ns,
        end_ns=windows[-1].end_ns,
        duration_s=sum(window.duration_s for window in windows),
        windows=len(windows),
        gyro_rad_s=vector(mean[:3]),
        accel_m_s2=vector(mean[3:6]),
        gyro_noise2=vector(noise2[:3]),
        accel_noise2=vector(noise2[3:6]),
        temp_degc=float(mean[6]),
    )


def vector(a: FloatArray) -> Vector:
    """Three numbers as plain floats."""
    x, y, z = a.tolist()
    return x, y, z


def in_g(poses: Sequence[StillPose]) -> FloatArray:
    """The mean forces (N, 3) of poses in g."""
    forces: FloatArray = np.array([pose.accel_m_s2 for pose in poses]).reshape(-1, 3) / STANDARD_GRAVITY_M_S2
    return forces
