"""The stage: any of the filters on rate and acceleration together, every sample whole and in its own time.

A filter that looks at what comes after a sample makes it late. Then the whole sample waits: its time, flags,
bias, temperature and both sensors, so that what comes out is one instant, older than what went in.

Nothing is smeared over a gap. What waits before it comes out when the first sample after it is there, filtered as if
the board had stood still from there on; what follows begins as if it had stood still before. The same where
the chip becomes stuck or comes free. At the end of the data the samples that wait are not given: a stopped
service and a replay of what it recorded give the same. Whoever wants them calls `finish`.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from quavelet.core.blocks import BoolArray, Flag, FloatArray, ImuBlock, concat
from quavelet.core.units import NS_PER_S
from quavelet.denoise.rows import Memory, RowFilter
from quavelet.denoise.signal import check_finite

_UNKNOWN, _SUSPECT = np.uint32(Flag.BIAS_UNKNOWN), np.uint32(Flag.HEADING_SUSPECT)
_NONE = ImuBlock(
    t_ns=np.empty(0, dtype=np.int64),
    period_s=np.empty(0),
    gap_ns=np.empty(0, dtype=np.int64),
    flags=np.empty(0, dtype=np.uint32),
    gyro_rad_s=np.empty((0, 3)),
    accel_m_s2=np.empty((0, 3)),
    temp_degc=np.empty(0),
    gyro_bias_rad_s=np.empty((0, 3)),
    still=np.empty(0, dtype=np.bool_),
)


@dataclass(frozen=True, slots=True, eq=False)
class DenoiseState:
    """All memory.

    filter   the filter's
    running  whether it has seen a sample since the last gap
    early    how many of its next rows belong to before the run
    waiting  the samples that have come in and not gone out
    stuck    whether the last one was of a stuck chip
    """

    filter: Memory = Memory()
    running: bool = False
    early: int = 0
    waiting: ImuBlock = _NONE
    stuck: bool = False


class Denoise:
    """`ImuBlock` to `ImuBlock`, `delay_samples` later, by a `RowFilter` made for six columns.

    It filters the rate with its bias still on, and takes off each sample's own: a bias that has just been
    found is no jump to be smoothed. Raises ValueError where a value is not finite.

    sample_rate_hz      the nominal one; `delay_ns` is the delay by it, the same for every block
    keeps_slow_motion   False: the filter takes the rate's mean away, the bias with it, and slow turns too; then no bias
                        is taken off, none is unknown, and every sample is flagged HEADING_SUSPECT
    """

    def __init__(self, row_filter: RowFilter, *, sample_rate_hz: float, keeps_slow_motion: bool = True) -> None:
        self._filter = row_filter
        self._keeps_slow_motion = keeps_slow_motion
        self.delay_samples = row_filter.delay
        self.delay_ns = round(row_filter.delay / sample_rate_hz * NS_PER_S)
        self._running = False
        self._early = 0
        self._waiting = _NONE
        self._stuck = False

    def process(self, block: ImuBlock) -> ImuBlock:
        n = len(block)
        out: list[ImuBlock] = []
        broken = self._broken(block)
        for start, end in pairwise([*sorted({0, *np.flatnonzero(broken).tolist()}), n]):
            if start < n and broken[start]:
                out.append(self.finish())
            if start < end:
                out.append(self._run(block[start:end]))
        if not out:
            return _NONE
        return concat(out) if len(out) > 1 else out[0]

    def finish(self) -> ImuBlock:
        """The samples that wait, at the end of the data; what comes next begins a new run."""
        if not self._running:
            return _NONE
        rows = self._filter.drain()[self._early :]
        given = self._filtered(self._waiting, rows)
        self._running, self._waiting = False, _NONE
        return given

    def state(self) -> DenoiseState:
        return DenoiseState(self._filter.state(), self._running, self._early, self._waiting, self._stuck)

    def restore(self, state: DenoiseState) -> None:
        self._filter.restore(state.filter)
        self._running, self._early = state.running, state.early
        self._waiting, self._stuck = state.waiting, state.stuck

    def _broken(self, block: ImuBlock) -> BoolArray:
        """Before which rows the run ends."""
        stuck = (block.flags & Flag.STUCK) != 0
        before = np.concatenate([[self._stuck], stuck])
        self._stuck = bool(before[-1])
        gap: BoolArray = ((block.flags & Flag.GAP) != 0) | (block.gap_ns > 0) | (stuck != before[:-1])
        return gap

    def _run(self, block: ImuBlock) -> ImuBlock:
        """The rows that are due after these, which continue the run or begin one."""
        rows = np.concatenate([block.gyro_rad_s + block.gyro_bias_rad_s, block.accel_m_s2], axis=1)
        check_finite(rows)
        if not self._running:
            self._running, self._early = True, self.delay_samples
        out = self._filter.push(rows)
        skip = min(self._early, len(out))
        self._early -= skip
        due = len(out) - skip
        waiting = concat([self._waiting, block]) if len(self._waiting) else block
        self._waiting = waiting[due:]
        return self._filtered(waiting[:due], out[skip:])

    def _filtered(self, block: ImuBlock, rows: FloatArray) -> ImuBlock:
        if self._keeps_slow_motion:
            return replace(block, gyro_rad_s=rows[:, :3] - block.gyro_bias_rad_s, accel_m_s2=rows[:, 3:])
        return replace(
            block,
            gyro_rad_s=rows[:, :3],
            accel_m_s2=rows[:, 3:],
            gyro_bias_rad_s=np.zeros_like(block.gyro_bias_rad_s),
            flags=(block.flags & ~_UNKNOWN) | _SUSPECT,
        )
