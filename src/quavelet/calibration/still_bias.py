"""The stage that takes the gyroscope's bias from the first stillness, and tells still from moving."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from quavelet.calibration.model import Vector
from quavelet.calibration.stillness import Six, StillnessLimits, StillRun, extended, is_steady, started
from quavelet.core.blocks import Flag, ImuBlock
from quavelet.core.units import RAD_PER_DEG

FOLLOW_WINDOWS = 8
"""The bias is the mean of the first so many still windows; then it follows with this time constant."""
FOLLOW_LIMIT_RAD_S = 0.03 * RAD_PER_DEG
"""A window that differs by more is a slow turn, not a better measurement."""
REFINE_LIMIT_RAD_S = 1.0 * RAD_PER_DEG
"""What a bias over temperature may leave, after months; a steady rate above it is a turn."""


@dataclass(frozen=True, slots=True)
class StillBiasState:
    """All memory.

    run         the window being judged
    still_s     time since the board last moved
    bias_rad_s  the bias from `windows` still windows, None before the first; 0 from none where the board moved before
                it, and the calibration knew the bias
    """

    run: StillRun = StillRun()
    still_s: float = 0.0
    bias_rad_s: Vector | None = None
    windows: int = 0

    def with_window(self, mean: Vector, *, first_limit_rad_s: float) -> StillBiasState:
        """The state after a steady window of this mean rate."""
        if self.windows == 0:
            if max(map(abs, mean)) > first_limit_rad_s:
                return self
            return replace(self, bias_rad_s=mean, windows=1)
        assert self.bias_rad_s is not None, "measured in a window"
        change = (mean[0] - self.bias_rad_s[0], mean[1] - self.bias_rad_s[1], mean[2] - self.bias_rad_s[2])
        if max(map(abs, change)) > FOLLOW_LIMIT_RAD_S:
            return self
        n = min(self.windows + 1, FOLLOW_WINDOWS)
        x, y, z = (old + step / n for old, step in zip(self.bias_rad_s, change, strict=True))
        return replace(self, bias_rad_s=(x, y, z), windows=n)


class StillBias:
    """`ImuBlock` to `ImuBlock`: while a sample comes flagged BIAS_UNKNOWN, find the bias and remove it.

    window_s   how long the board must be still for its mean rate to be taken as the bias
    shows_s    how long it must be still for `still` to say so
    refine     the rate comes without the bias that the calibration knows: what is left is measured as before, but a
               board that moves before that is not waited for, and a first rate above 1 deg/s is a turn

    A board that moves is refused and watched further; its samples keep the flag. Whenever it is
    still again the bias is followed, for it drifts with temperature (PS 6.1: 20 deg/s over the whole range).
    The price: a turn slower than 0.03 deg/s is taken for drift.
    """

    def __init__(
        self,
        *,
        window_s: float = 2.0,
        shows_s: float = 0.5,
        limits: StillnessLimits | None = None,
        refine: bool = False,
    ) -> None:
        self._window_s = window_s
        self._shows_s = shows_s
        self._limits = limits or StillnessLimits()
        self._refine = refine
        self._s = StillBiasState()

    def state(self) -> StillBiasState:
        return self._s

    def restore(self, state: StillBiasState) -> None:
        self._s = state

    def process(self, block: ImuBlock) -> ImuBlock:
        n = len(block)
        still = np.zeros(n, dtype=np.bool_)
        bias = np.zeros((n, 3))
        known = np.zeros(n, dtype=np.bool_)
        s = self._s
        channels = np.concatenate([block.gyro_rad_s, block.accel_m_s2], axis=1).tolist()
        # A chip that is stuck looks more still than any board is.
        periods, gaps = block.period_s.tolist(), (block.flags & (Flag.GAP | Flag.STUCK)).tolist()
        unknown = (block.flags & Flag.BIAS_UNKNOWN).tolist()
        for k in range(n):
            s = self._next(s, tuple(channels[k]), periods[k], gap=bool(gaps[k]), measure=bool(unknown[k]))
            still[k] = s.still_s >= self._shows_s
            if s.bias_rad_s is not None and unknown[k]:
                bias[k], known[k] = s.bias_rad_s, True
        self._s = s
        return replace(
            block,
            flags=np.where(known, block.flags & ~np.uint32(Flag.BIAS_UNKNOWN), block.flags),
            gyro_rad_s=block.gyro_rad_s - bias,
            gyro_bias_rad_s=block.gyro_bias_rad_s + bias,
            still=still,
        )

    def _next(self, s: StillBiasState, sample: Six, dt_s: float, *, gap: bool, measure: bool) -> StillBiasState:
        longer = None if gap else extended(s.run, sample, dt_s, half_s=self._window_s / 2, limits=self._limits)
        if longer is None:
            s = replace(s, run=started(sample), still_s=0.0)
            return s if gap else self._moved(s)
        s = StillBiasState(longer, s.still_s + dt_s, s.bias_rad_s, s.windows)
        if longer.elapsed_s < self._window_s:
            return s
        if not is_steady(longer, limits=self._limits):
            return self._moved(replace(s, run=StillRun(), still_s=0.0))
        if measure:
            limit = REFINE_LIMIT_RAD_S if self._refine else self._limits.gyro_mean_rad_s
            s = self._moved(s.with_window(longer.mean()[:3], first_limit_rad_s=limit))
        return replace(s, run=StillRun())

    def _moved(self, s: StillBiasState) -> StillBiasState:
        """A board that moves, or shows no bias, before its bias is measured: is that of the calibration good enough?"""
        return replace(s, bias_rad_s=(0.0, 0.0, 0.0)) if self._refine and s.bias_rad_s is None else s
