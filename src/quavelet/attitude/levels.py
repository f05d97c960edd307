"""Paper 000's method 1: the tilt of each sample's accelerometer, and no heading."""

from __future__ import annotations

from dataclasses import dataclass
from math import sqrt

import numpy as np

from quavelet.attitude.doubt import TILT_FLOOR_RAD, YAW_MAX_RAD, Residual
from quavelet.attitude.inputs import refuse_bad
from quavelet.attitude.kernel import IDENTITY, Quaternion, Vector, standing
from quavelet.core.blocks import AttitudeBlock, ImuBlock
from quavelet.core.units import STANDARD_GRAVITY_M_S2

SPREAD_TAU_S = 1.0


@dataclass(frozen=True, slots=True)
class AccelerometerState:
    """The last attitude, the force through a low-pass (None before the first sample), and its mean square distance
    from that, (m/s^2)^2 an axis."""

    q: Quaternion = IDENTITY
    force: Vector | None = None
    spread: float = 0.0


class AccelerometerFilter:
    """`ImuBlock` to `AttitudeBlock`: roll = atan2(fy, fz), pitch = atan2(-fx, hypot(fy, fz)), yaw 0.

    Its sigma is the noise of the last second, which says nothing of an acceleration that lasts. The sigma of yaw is
    that of a uniform distribution: nothing is known. Where there is no force, in free fall, the attitude stands.
    """

    def __init__(self, *, residual: Residual) -> None:
        self._residual = residual
        self._s = AccelerometerState()

    def state(self) -> AccelerometerState:
        return self._s

    def restore(self, state: AccelerometerState) -> None:
        self._s = state

    def count_yaw_anew(self) -> None:
        """There is none: sigma says so as before."""

    def process(self, block: ImuBlock) -> AttitudeBlock:
        refuse_bad(block)
        n, s = len(block), self._s
        q, sigma = np.empty((n, 4)), np.empty((n, 3))
        fixed = self._residual.tilt_rad**2 + TILT_FLOOR_RAD**2
        for k, (force, dt) in enumerate(zip(block.accel_m_s2.tolist(), block.period_s.tolist(), strict=True)):
            s = _next(s, tuple(force), dt)
            q[k] = s.q
            tilt = sqrt(fixed + s.spread / STANDARD_GRAVITY_M_S2**2)
            sigma[k] = tilt, tilt, YAW_MAX_RAD
        self._s = s
        return AttitudeBlock(
            t_ns=block.t_ns,
            period_s=block.period_s,
            gap_ns=block.gap_ns,
            flags=block.flags,
            q=np.where(q[:, :1] < 0.0, -q, q),
            sigma_rad=sigma,
            gyro_rad_s=block.gyro_rad_s,
            accel_m_s2=block.accel_m_s2,
            temp_degc=block.temp_degc,
            gyro_bias_rad_s=block.gyro_bias_rad_s,
            still=block.still,
        )


def _next(s: AccelerometerState, force: Vector, dt: float) -> AccelerometerState:
    if force[0] * force[0] + force[1] * force[1] + force[2] * force[2] < 1e-12:
        return s
    if s.force is None:
        return AccelerometerState(standing(force), force)
    share = dt / (SPREAD_TAU_S + dt)
    x, y, z = (a - b for a, b in zip(force, s.force, strict=True))
    low = (s.force[0] + share * x, s.force[1] + share * y, s.force[2] + share * z)
    spread = s.spread + share * ((x * x + y * y + z * z) / 3.0 - s.spread)
    return AccelerometerState(standing(force), low, spread)
