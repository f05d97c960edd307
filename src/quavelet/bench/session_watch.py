"""What a person at the bench sees of the board at any moment, and the poses and moves that the steps are made of."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

import numpy as np

from quavelet.bench.session_evidence import Move
from quavelet.calibration.calibrate import Calibrate
from quavelet.calibration.model import UNCALIBRATED
from quavelet.calibration.poses import WINDOW_S, PoseCollector, StillPose, face_up, vector
from quavelet.core.blocks import Flag, FloatArray, ImuBlock, RawBlock, concat
from quavelet.core.units import DEG_PER_RAD, NS_PER_S

POSE_S = 3.0
STILL_S = POSE_S + 0.5
"""A pose needs a little more than its own length: its ends are left off."""
COLDEST_DEGC, HOTTEST_DEGC = -30.0, 75.0
"""PS 6.1: the chip is specified from -40 to 85 degC; what it shows near the ends counts for nothing."""
LONGEST_MOVE_S = 40.0
TREND_S = 30.0
TREND_LEAST_S = 15.0


@dataclass(frozen=True, slots=True)
class Seen:
    """What the newest samples showed.

    raw, rows             they themselves, as counts and in SI, not calibrated
    poses, moves          what ended in them
    still_s               for how long the board has been still, 0 while it moves
    face                  which axis is up, None where none is
    temp_degc             of the chip
    trend_degc_min        how it goes, over the last 30 s; None before it is known
    lost                  samples are missing among them
    turned_deg            about the axis it turned most about since the last pose, less the rate that showed; 0 before
    """

    raw: RawBlock
    rows: ImuBlock
    poses: tuple[StillPose, ...]
    moves: tuple[Move, ...]
    still_s: float
    face: str | None
    temp_degc: float
    trend_degc_min: float | None
    lost: bool
    turned_deg: float


class Watch:
    """Raw blocks to what is seen. A pose is given after 3.5 s of stillness, and again each 3 s while it lasts."""

    def __init__(self, *, pose_s: float = POSE_S - 0.5, longest_s: float = POSE_S) -> None:
        """pose_s   a stillness that ends after so long is a pose, too; longest_s   see `PoseCollector`"""
        self._si = Calibrate(UNCALIBRATED)
        self._collector = PoseCollector(shortest_s=pose_s, longest_s=longest_s)
        self._before: StillPose | None = None
        self._since: list[RawBlock] = []
        self._angle_rad: FloatArray = np.zeros(3)
        self._temps: deque[tuple[float, float]] = deque()

    def seen(self, raw: RawBlock) -> Seen:
        """What these samples (at least one) show."""
        rows = self._si.process(raw)
        self._since.append(raw)
        every = self._collector.process(rows)
        moves = [move for pose in every if (move := self._move_to(pose)) is not None]
        poses = [pose for pose in every if _within(pose)]
        force = rows.accel_m_s2.mean(axis=0)
        t_s, temp = float(rows.t_ns[-1]) / NS_PER_S, float(rows.temp_degc.mean())
        return Seen(
            raw=raw,
            rows=rows,
            poses=tuple(poses),
            moves=tuple(moves),
            still_s=self._collector.still_s,
            face=face_up(vector(force)),
            temp_degc=temp,
            trend_degc_min=self._trend(t_s, temp),
            lost=bool((raw.flags & Flag.GAP).any()),
            turned_deg=self._turned(rows, every),
        )

    def ended(self) -> tuple[list[StillPose], list[Move]]:
        """The pose that the end of the samples cuts off, if there is one, and the move to it."""
        poses = self._collector.finish() if self._since else []
        return poses, [move for pose in poses if (move := self._move_to(pose)) is not None]

    def _turned(self, rows: ImuBlock, poses: list[StillPose]) -> float:
        if poses or self._before is None:
            self._angle_rad = np.zeros(3)
            return 0.0
        rate = rows.gyro_rad_s - np.array(self._before.gyro_rad_s)
        self._angle_rad = self._angle_rad + (rate * rows.period_s[:, None]).sum(axis=0)
        return float(DEG_PER_RAD * self._angle_rad[np.argmax(np.abs(self._angle_rad))])

    def _move_to(self, pose: StillPose) -> Move | None:
        before, self._before = self._before, pose
        rows = concat(self._since)
        self._since = [rows[int(np.searchsorted(rows.t_ns, pose.end_ns, side="right")) :]]
        if before is None or (pose.begin_ns - before.end_ns) > LONGEST_MOVE_S * NS_PER_S:
            return None
        if not (_within(before) and _within(pose)):
            return None
        begin, end = np.searchsorted(rows.t_ns, [before.end_ns, pose.begin_ns], side="right").tolist()
        between = rows[begin:end]
        # Pieces of one stretch leave one window between them, and two stretches more.
        if pose.begin_ns - before.end_ns < 1.5 * WINDOW_S * NS_PER_S or (between.flags & Flag.GAP).any():
            return None
        return Move.of(between, before, pose)

    def _trend(self, t_s: float, temp_degc: float) -> float | None:
        temps = self._temps
        temps.append((t_s, temp_degc))
        while temps[0][0] < t_s - TREND_S:
            temps.popleft()
        if t_s - temps[0][0] < TREND_LEAST_S:
            return None
        t, temp = np.array(temps).T
        t = t - t.mean()
        return float(60.0 * (t @ temp) / (t @ t))


def _within(pose: StillPose) -> bool:
    return COLDEST_DEGC <= pose.temp_degc <= HOTTEST_DEGC
