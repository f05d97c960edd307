"""Yaw set to zero by hand: a relative yaw counts from wherever the board stood when that was asked.

The world is turned about its vertical, so that the yaw of that row is zero. Of the tilt's covariance only the diagonal
is known, and it is turned as if it were all of it: two sigmas that are alike, as most filters have them, stay so.

Sigma of yaw is what has grown since. That cannot be had from the sigma before and the sigma after, as the root of the
difference of their squares: for noise it is that, and for a constant bias an upper bound, since the squares of t0 and t
differ by more than the square of t - t0; but a scale that is off and a turn that is taken back make the sigma smaller
while the error since the zero grows. So the filter itself counts anew (`AttitudeFilter.count_yaw_anew`), which is exact
for all of them. Nobody knows yaw better than the noise of one sample lets it be known, so it is never less than that.
Where the zero is undone, the sigma of before and that of since are added up, which no correlation of the two exceeds.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import cos, sin

import numpy as np

from quavelet.attitude.doubt import GYRO_DENSITY_RAD, YAW_MAX_RAD
from quavelet.attitude.kernel import Quaternion
from quavelet.core.blocks import AttitudeBlock, Flag, FloatArray, YawFrom
from quavelet.core.errors import NotPossible
from quavelet.core.euler import to_euler
from quavelet.core.quaternion import multiply
from quavelet.core.units import RAD_PER_DEG

STEEPEST_RAD = 80.0 * RAD_PER_DEG
"""Beyond such a pitch yaw is the direction of next to nothing."""


@dataclass(frozen=True, slots=True)
class LastRow:
    """The last row as it came: its attitude, its sigma of yaw, what its yaw counts from, and whether the bias was
    unknown."""

    q: Quaternion
    sigma_rad: float
    yaw_from: int
    unknown: bool

    @property
    def yaw_rad(self) -> float:
        return float(to_euler(np.array(self.q))[2])

    @property
    def pitch_rad(self) -> float:
        return float(to_euler(np.array(self.q))[1])


@dataclass(frozen=True, slots=True)
class YawZeroState:
    """All memory.

    zero_rad    the filter's yaw that reads zero, None where yaw counts from the start
    before_rad  one sigma of yaw from the start up to where the filter counted anew; 0.0 where it never did
    last        None before the first row
    """

    zero_rad: float | None = None
    before_rad: float = 0.0
    last: LastRow | None = None


class YawZero:
    """Attitudes to attitudes whose yaw counts from the zero, where one was set; a `Stage`.

    `zero` and `undo` are for between two blocks, on the thread that calls `process`. A zero is dropped where yaw is no
    longer relative, and where the bias is unknown, for until it is known the filter may begin its azimuth anew.
    """

    def __init__(self) -> None:
        self._s = YawZeroState()

    def state(self) -> YawZeroState:
        return self._s

    def restore(self, state: YawZeroState) -> None:
        self._s = state

    @property
    def refusal(self) -> str:
        """Why yaw cannot be set to zero after the last row, and what to do; "" where it can. May be asked on any
        thread."""
        last = self._s.last
        if last is None:
            return "there is no attitude yet: wait for the first one"
        if last.yaw_from != YawFrom.RELATIVE:
            north = YawFrom(last.yaw_from).name.lower()
            return f"yaw counts from {north} north: only one that is relative can be set to zero"
        if last.unknown:
            return "yaw begins anew once the gyroscope's bias is known: let the board lie still for some seconds first"
        if abs(last.pitch_rad) > STEEPEST_RAD:
            return "x points nearly straight up or down, where there is no yaw: lay the board flatter"
        return ""

    @property
    def is_set(self) -> bool:
        return self._s.zero_rad is not None

    def zero(self) -> None:
        """The last row's yaw is zero, from the next row on. The filter has to count its sigma anew. Raises
        NotPossible."""
        s, refusal = self._s, self.refusal
        if refusal or s.last is None:
            raise NotPossible(refusal)
        self._s = replace(s, zero_rad=s.last.yaw_rad, before_rad=s.before_rad + s.last.sigma_rad)

    def undo(self) -> None:
        """Yaw counts from the start again. Raises NotPossible."""
        if not self.is_set:
            raise NotPossible("yaw counts from the start: there is no zero to be undone")
        self._s = replace(self._s, zero_rad=None)

    def process(self, block: AttitudeBlock) -> AttitudeBlock:
        n = len(block)
        if not n:
            return block
        s, unknown = self._s, bool(block.flags[-1] & Flag.BIAS_UNKNOWN)
        q, sigma = tuple(block.q[-1].tolist()), float(block.sigma_rad[-1, 2])
        last = LastRow(q, sigma, int(block.yaw_from[-1]), unknown)
        if s.zero_rad is not None or s.before_rad:
            ends = (block.yaw_from != YawFrom.RELATIVE) | ((block.flags & np.uint32(Flag.BIAS_UNKNOWN)) != 0)
            holds = int(ends.argmax()) if ends.any() else n
            block = _counted(block, s, holds)
            if holds < n:
                s = YawZeroState()
        self._s = replace(s, last=last)
        return block


def _counted(block: AttitudeBlock, s: YawZeroState, n: int) -> AttitudeBlock:
    """The block with its first `n` rows counted from the zero."""
    q, sigma = block.q.copy(), block.sigma_rad.copy()
    if s.zero_rad is None:
        sigma[:n, 2] = np.minimum(s.before_rad + sigma[:n, 2], YAW_MAX_RAD)
        return replace(block, sigma_rad=sigma)
    c, d = cos(0.5 * s.zero_rad), -sin(0.5 * s.zero_rad)
    turned = multiply(np.array([c, 0.0, 0.0, d]), q[:n])
    q[:n] = np.where(turned[:, :1] < 0.0, -turned, turned)
    x_ms, y_ms = sigma[:n, 0] ** 2, sigma[:n, 1] ** 2
    along, across = cos(s.zero_rad) ** 2, sin(s.zero_rad) ** 2
    sigma[:n, 0] = np.sqrt(along * x_ms + across * y_ms)
    sigma[:n, 1] = np.sqrt(across * x_ms + along * y_ms)
    sigma[:n, 2] = np.maximum(sigma[:n, 2], _of_one_sample(block.period_s[:n]))
    return replace(block, q=q, sigma_rad=sigma)


def _of_one_sample(period_s: FloatArray) -> FloatArray:
    """One sigma of yaw by the noise of one sample, in rad."""
    sigma: FloatArray = GYRO_DENSITY_RAD * np.sqrt(period_s)
    return sigma
