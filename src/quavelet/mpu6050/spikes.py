"""Samples that stand alone: the chip's low-pass filter lets nothing through that lasts for one sample only.

A bit that flips on the wires within a frame leaves everything else in it plausible, and I2C has no checksum. In a
gyroscope's word it turns the board by up to a degree or two in one sample.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from quavelet.core.blocks import Flag, RawBlock, concat
from quavelet.core.health import Health
from quavelet.core.units import NS_PER_S
from quavelet.mpu6050 import registers as r
from quavelet.mpu6050.config import ACCEL_LSB_PER_G, GYRO_BANDWIDTH_HZ, GYRO_LSB_PER_DPS
from quavelet.mpu6050.plausible import AXES
from quavelet.mpu6050.stream import StreamInfo

BANDWIDTH_PER_RATE = 0.23
"""The rule is for filters no wider than this part of the sample rate (42 Hz at 200). There even a blow spreads over
three samples; a wider one lets a sample stand alone, and vibration that folds look like anything."""
TURN_DEG = 0.3
"""What a sample that stands alone may turn the board by."""
FORCE_G = 0.5
ALONE = 4
"""It stands so many times as far off the samples around it as they are apart."""
BEFORE = 3
"""Samples before it that it is compared with; after it, one."""
AROUND = BEFORE + 1
_OF_THE_SAMPLE = Flag.GYRO_CLIPPED | Flag.ACCEL_CLIPPED | Flag.CLOCK_UNSURE | Flag.STUCK

Axes = tuple[int, ...]
"""The six axes of a frame."""


@dataclass(frozen=True, slots=True)
class SpikeState:
    """All memory.

    before       the axes of the last samples that stood, three at most, none from before a gap
    began        these are the first of the stream or after a gap, and too few to compare with
    held         samples that wait for those after them: the first four so begun, later at most two, which jumped
    owed_ns      the time of samples thrown away that the next one's gap has to hold
    owed_flags   and what is to be said of it, 0 where there is none
    """

    before: tuple[Axes, ...] = ()
    began: bool = True
    held: RawBlock | None = None
    owed_ns: int = 0
    owed_flags: int = 0


class SpikeRule:
    """Takes samples that stand alone out of the blocks; the next one is flagged as coming after a gap of their length.

    A sample that jumps at the end of a block is held back until the next block shows whether it stands alone, and so
    are two that both jump, which garbage at the end of a transfer makes of its last two frames. The first four of the
    stream and after a gap wait until there are five to be compared: none before says what they should be, and by the
    first the attitude is carried over the gap. Nothing else is ever delayed. Where a gap comes next nothing will show
    it, and a sample that jumped is thrown away, as is one between two gaps.
    """

    def __init__(self, bounds: NDArray[np.int64] | None, *, health: Health) -> None:
        """`bounds` as `spike_bounds` gives them; None switches the rule off."""
        self._bounds = bounds
        self._health = health
        self._s = SpikeState()

    def state(self) -> SpikeState:
        return self._s

    def restore(self, state: SpikeState) -> None:
        self._s = state

    def process(self, block: RawBlock) -> RawBlock:
        if self._bounds is None or not len(block):
            return block
        s, bounds = self._s, self._bounds
        if not s.began and s.held is None and not s.owed_flags and not block.flags[0] & Flag.GAP:
            axes = block.counts[:, AXES].astype(np.int64)
            before = s.before[-1] if s.before else axes[0]
            if not (np.abs(np.diff(axes, axis=0, prepend=[before])) > bounds).any():
                last = tuple(tuple(row) for row in axes[-BEFORE:].tolist())
                self._s = SpikeState((*s.before, *last)[-BEFORE:], began=False)
                return block
        return self._looked_at(block, bounds)

    def _looked_at(self, block: RawBlock, bounds: NDArray[np.int64]) -> RawBlock:
        s, old = self._s, 0 if self._s.held is None else len(self._s.held)
        if s.held is not None:
            block = concat([s.held, block])
        rows: list[Axes] = [tuple(row) for row in block.counts[:, AXES].tolist()]
        # A gap comes with the first row of a block; that of the rows held back was seen when they were new.
        gap_at = old if block.flags[old] & Flag.GAP else None
        before, began, owed_ns, owed_flags = s.before, s.began, s.owed_ns, s.owed_flags
        kept: list[int] = []
        flags, gap_ns = block.flags.copy(), block.gap_ns.copy()
        held = len(rows)
        for k, row in enumerate(rows):
            if k == gap_at:
                before, began = (), True
            sure = len(before) == BEFORE
            end = gap_at if gap_at is not None and k < gap_at else len(rows)
            after = rows[k + 1 : min(end, k + 2 + AROUND)]
            jumped = stands_alone(row, before, bounds) if sure else began
            if sure and jumped and after and stands_alone(after[0], before, bounds):
                # What spoilt the next one may have begun in this: then the one behind it is to be compared with.
                spoilt = len(after) == 1 or stands_alone(after[0], (*before, after[1]), bounds)
                after = after[1:] if spoilt else after
            around = (*before, *after[: AROUND - len(before)])
            if len(around) < AROUND and end == len(rows) and jumped:
                held = k
                break
            # A sample between two gaps has nothing that speaks for it.
            if (sure or began) and (not around or stands_alone(row, around, bounds)):
                owed_ns += round(float(block.period_s[k]) * NS_PER_S) + int(gap_ns[k])
                owed_flags |= int(flags[k]) & ~_OF_THE_SAMPLE | Flag.GAP | Flag.IMPLAUSIBLE
                self._health.gaps -= bool(flags[k] & Flag.GAP)
                self._health.spikes += 1
                self._health.samples_lost += 1
                continue
            if owed_flags:
                self._health.gaps += not flags[k] & Flag.GAP
                flags[k] |= np.uint32(owed_flags)
                gap_ns[k] += owed_ns
                owed_ns = owed_flags = 0
            kept.append(k)
            before = (*before, row)[-BEFORE:]
            began = began and len(before) < BEFORE
        marked = replace(block, flags=flags, gap_ns=gap_ns)
        self._s = SpikeState(before, began, marked[held:] if held < len(rows) else None, owed_ns, owed_flags)
        return marked[kept]


def spike_bounds(info: StreamInfo) -> NDArray[np.int64] | None:
    """How far (6,) a sample must stand off to be a spike, in counts; None where the filter is too wide to say."""
    dlpf = r.DLPF_CFG.decode(info.config)
    if dlpf >= len(GYRO_BANDWIDTH_HZ) or GYRO_BANDWIDTH_HZ[dlpf] * info.nominal_period_s > BANDWIDTH_PER_RATE:
        return None
    accel = FORCE_G * ACCEL_LSB_PER_G[info.accel_range_g]
    gyro = TURN_DEG / info.nominal_period_s * GYRO_LSB_PER_DPS[info.gyro_range_dps]
    return np.array([accel] * 3 + [gyro] * 3).astype(np.int64)


def stands_alone(row: Axes, others: tuple[Axes, ...], bounds: NDArray[np.int64]) -> bool:
    """Whether one axis lies outside all the others by more than its bound, and far more than they are apart."""
    for value, around, bound in zip(row, zip(*others, strict=True), bounds.tolist(), strict=True):
        low, high = min(around), max(around)
        off = max(low - value, value - high)
        if off > bound and off > ALONE * (high - low):
            return True
    return False
