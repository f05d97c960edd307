"""The attitude of a whole recording in a few points, however long it is, and where it has gaps."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from quavelet.core.blocks import AttitudeBlock, RawBlock
from quavelet.core.euler import to_euler
from quavelet.core.units import DEG_PER_RAD, NS_PER_MS, NS_PER_S

Point = tuple[int, float, float, float]

MOST_POINTS = 2000
MOST_GAPS = 500
FAR_PERIODS = 10
FIRST_STEP_NS = 50 * NS_PER_MS


@dataclass(frozen=True, slots=True)
class Overview:
    """A recording from afar; times from its first drain on.

    t_s, roll_deg, pitch_deg, yaw_deg   (N,) up to 2000 points, as far apart as it takes
    gaps                                [from_s, to_s] without samples, up to 500; of more, neighbours stand as one
    """

    t_s: list[float]
    roll_deg: list[float]
    pitch_deg: list[float]
    yaw_deg: list[float]
    gaps: list[tuple[float, float]]


class OverviewSoFar:
    """Takes what a recording gives, in its order; of too many points only those twice as far apart stay."""

    def __init__(self, *, most_points: int = MOST_POINTS, most_gaps: int = MOST_GAPS) -> None:
        self._most_points = most_points
        self._most_gaps = most_gaps
        self._step_ns = FIRST_STEP_NS
        self._next_ns = 0
        self._points: list[Point] = []
        self._gaps: list[tuple[int, int]] = []
        self._near_ns = NS_PER_MS
        self._raw_ns: int | None = None

    def see_raw(self, block: RawBlock, *, since_ns: int) -> None:
        """At least one sample; their times are `since_ns` later than those from the first drain on."""
        first_ns = int(block.t_ns[0]) - since_ns
        far_ns = FAR_PERIODS * block.period_s[0] * NS_PER_S
        # A chip that comes back otherwise set begins another stream, which does not know when the one before ended.
        if self._raw_ns is not None and not block.gap_ns[0] and first_ns - self._raw_ns > far_ns:
            self._gaps.append((self._raw_ns, first_ns))
        self._raw_ns = int(block.t_ns[-1]) - since_ns
        for row in np.flatnonzero(block.gap_ns).tolist():
            end_ns = int(block.t_ns[row]) - since_ns
            self._gaps.append((max(0, end_ns - int(block.gap_ns[row])), end_ns))
        while len(self._gaps) > self._most_gaps:
            self._gaps = _joined(self._gaps, self._near_ns)
            self._near_ns *= 2

    def see(self, block: AttitudeBlock, *, since_ns: int) -> None:
        """The attitude, likewise."""
        at_ns = block.t_ns - since_ns
        last_ns = int(at_ns[-1])
        while self._next_ns <= last_ns:
            row = int(np.searchsorted(at_ns, self._next_ns))
            roll, pitch, yaw = (DEG_PER_RAD * to_euler(block.q[row])).tolist()
            self._points.append((int(at_ns[row]), roll, pitch, yaw))
            while len(self._points) > self._most_points:
                self._step_ns *= 2
                self._points = _apart(self._points, self._step_ns)
            self._next_ns = self._points[-1][0] + self._step_ns

    def overview(self) -> Overview:
        points, gaps = list(self._points), list(self._gaps)
        return Overview(
            t_s=[round(point[0] / NS_PER_S, 3) for point in points],
            roll_deg=[round(point[1], 2) for point in points],
            pitch_deg=[round(point[2], 2) for point in points],
            yaw_deg=[round(point[3], 2) for point in points],
            gaps=[(round(begin / NS_PER_S, 3), round(end / NS_PER_S, 3)) for begin, end in gaps],
        )


def _apart(points: list[Point], step_ns: int) -> list[Point]:
    """Those at least `step_ns` after the one before."""
    kept = points[:1]
    for point in points[1:]:
        if point[0] - kept[-1][0] >= step_ns:
            kept.append(point)
    return kept


def _joined(gaps: list[tuple[int, int]], near_ns: int) -> list[tuple[int, int]]:
    """Those with less than `near_ns` between them as one."""
    joined = gaps[:1]
    for begin, end in gaps[1:]:
        if begin - joined[-1][1] < near_ns:
            joined[-1] = (joined[-1][0], max(joined[-1][1], end))
        else:
            joined.append((begin, end))
    return joined
