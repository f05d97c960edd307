"""The stage that takes the gyroscope's bias from the first stillness, and tells still from moving."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from quavelet.calibration.model import Vector
from quavelet.calibration.stillness import Six, StillnessLimits, StillRun, extended, is_steady, started
from quavelet.core.blocks import Flag, ImuBlock


@dataclass(frozen=True, slots=True)
class StillBiasState:
    """The window being judged, the time since the board last moved, and the bias once it is measured."""

    run: StillRun = StillRun()
    still_s: float = 0.0
    bias_rad_s: Vector | None = None


class StillBias:
    """`ImuBlock` to `ImuBlock`: while a sample comes flagged BIAS_UNKNOWN, find the bias and remove it.

    window_s   how long the board must be still for its mean rate to be taken as the bias
    shows_s    how long it must be still for `still` to say so

    A board that moves is refused and watched further; its samples keep the flag.
    """

    def __init__(self, *, window_s: float = 2.0, shows_s: float = 0.5, limits: StillnessLimits | None = None) -> None:
        self._window_s = window_s
        self._shows_s = shows_s
        self._limits = limits or StillnessLimits()
        self._s = StillBiasState()

    def state(self) -> StillBiasState:
        return self._s

    def restore(self, state: StillBiasState) -> None:
        self._s = state

    def process(self, block: ImuBlock) -> ImuBlock:
        n, limits = len(block), self._limits
        still = np.zeros(n, dtype=np.bool_)
        bias = np.zeros((n, 3))
        known = np.zeros(n, dtype=np.bool_)
        run, still_s, found = self._s.run, self._s.still_s, self._s.bias_rad_s
        channels = np.concatenate([block.gyro_rad_s, block.accel_m_s2], axis=1).tolist()
        periods, gaps = block.period_s.tolist(), (block.flags & Flag.GAP).tolist()
        unknown = (block.flags & Flag.BIAS_UNKNOWN).tolist()
        for k in range(n):
            sample: Six = tuple(channels[k])
            longer = None if gaps[k] else extended(run, sample, periods[k], half_s=self._window_s / 2, limits=limits)
            run = longer or started(sample)
            still_s = still_s + periods[k] if longer else 0.0
            if run.elapsed_s >= self._window_s:
                if not is_steady(run, limits=limits):
                    still_s = 0.0
                elif found is None and unknown[k]:
                    found = run.mean()[:3]
                run = StillRun()
            still[k] = still_s >= self._shows_s
            if found is not None and unknown[k]:
                bias[k], known[k] = found, True
        self._s = StillBiasState(run, still_s, found)
        return replace(
            block,
            flags=np.where(known, block.flags & ~np.uint32(Flag.BIAS_UNKNOWN), block.flags),
            gyro_rad_s=block.gyro_rad_s - bias,
            gyro_bias_rad_s=block.gyro_bias_rad_s + bias,
            still=still,
        )
