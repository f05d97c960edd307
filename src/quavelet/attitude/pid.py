"""The PID complementary filter of paper 000 (its methods 2 to 4) as a stage that starts by itself.

Gravity says how far off the quaternion is, and the rate with that correction turns it (the paper's order;
it leads the sample by up to a period, about as much as the chip's low-pass makes the sample late). Three
ways through a sample:

    level     bias unknown, board still: the mean accelerometer is the tilt, nothing turns
    acquire   bias unknown, or a long gap just passed: strong gains, SETTLING until gravity agrees
    track     the gains asked for

A gap is bridged by holding the mean of the rates before and after it; what that may cost goes into sigma.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import sqrt

import msgspec
import numpy as np

from quavelet.attitude.correction import Correction, Gains, corrected
from quavelet.attitude.doubt import Doubt, Residual, after_gap, after_step, sigmas
from quavelet.attitude.kernel import (
    IDENTITY,
    ZERO,
    Method,
    Quaternion,
    Vector,
    standing,
    step,
    tilt_error,
    up_in_body,
)
from quavelet.core.blocks import AttitudeBlock, Flag, ImuBlock
from quavelet.core.errors import SettingsError
from quavelet.core.units import NS_PER_S, RAD_PER_DEG

LONG_GAP_S = 1.0
"""A longer gap is not to be bridged: nobody knows what the board did."""
ACQUIRE_KP = 2.0
"""With the integral's gain at kp^2/4 (critical damping) 20 deg/s of bias cost 0.7 deg of tilt after 5 s."""
ACQUIRE_S = 4.0
"""Time at full gain; over the same time again it falls to 1."""
ACQUIRE_LIMIT_RAD_S = 25.0 * RAD_PER_DEG
"""The integral must hold any bias: the data sheet's 20 deg/s and a margin."""
SETTLED_RAD, UNSETTLED_RAD = 2.5 * RAD_PER_DEG, 5.0 * RAD_PER_DEG
"""Root mean square error below which SETTLING ends, and above which it returns while the bias is unknown."""
SETTLED_FOR_S = 2.0


class PidParams(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What can be tuned. The defaults did best over recorded hand motion and a robot arm with measured truth;
    the paper prints kp = 1, ki = 0.02, kd = 0.5.

    kp                    1/s, correction rate per rad of tilt error
    ki                    1/s^2, gain of the integral
    kd                    gain of the low-passed derivative of the error
    kd_tau_s              the derivative's low-pass
    integral_limit_rad_s  each axis of the integral stays within this
    method                "rk1", "rk2", "rk4" or "exp"
    """

    kp: float = 0.3
    ki: float = 0.005
    kd: float = 0.0
    kd_tau_s: float = 0.5
    integral_limit_rad_s: float = 0.05
    method: Method = "rk4"

    def __post_init__(self) -> None:
        for name in ("kp", "ki", "kd", "integral_limit_rad_s"):
            value = getattr(self, name)
            if not 0.0 <= value <= 100.0:  # NaN is refused too
                raise SettingsError(f"{name} = {value} is not a gain: give a number from 0 to 100")
        if not 1e-3 <= self.kd_tau_s <= 100.0:
            raise SettingsError(f"kd_tau_s = {self.kd_tau_s} is not a time constant: give 0.001 to 100 s")


@dataclass(frozen=True, slots=True)
class PidState:
    """All memory.

    rate_rad_s   the last sample's rate, None before the first sample
    level_sum    sum of the accelerometer while levelling
    bias_known   whether the last sample's bias was known
    settling     whether SETTLING is flagged, for settling_s so far, agreeing with gravity for agreeing_s
    acquiring    whether the strong gains are on
    """

    q: Quaternion = IDENTITY
    rate_rad_s: Vector | None = None
    correction: Correction = Correction()
    doubt: Doubt = Doubt()
    level_sum: Vector = ZERO
    bias_known: bool = False
    settling: bool = True
    settling_s: float = 0.0
    agreeing_s: float = 0.0
    acquiring: bool = False


class PidFilter:
    """`ImuBlock` to `AttitudeBlock`; an `AttitudeFilter`."""

    def __init__(self, params: PidParams, *, residual: Residual) -> None:
        self.params = params
        self._residual = residual
        self._gains = Gains(params.kp, params.ki, params.kd, params.kd_tau_s, params.integral_limit_rad_s)
        self._s = PidState()

    def state(self) -> PidState:
        return self._s

    def restore(self, state: PidState) -> None:
        self._s = state

    def process(self, block: ImuBlock) -> AttitudeBlock:
        n = len(block)
        q, sigma, flags = np.empty((n, 4)), np.empty((n, 3)), block.flags.copy()
        integral = np.empty((n, 3))
        rates, forces = block.gyro_rad_s.tolist(), block.accel_m_s2.tolist()
        periods, gaps_ns = block.period_s.tolist(), block.gap_ns.tolist()
        still, in_flags = block.still.tolist(), block.flags.tolist()
        for k in range(n):
            s = self._s = self._next(
                self._s,
                tuple(rates[k]),
                tuple(forces[k]),
                periods[k],
                gaps_ns[k] / NS_PER_S,
                still=still[k],
                bias_known=not in_flags[k] & Flag.BIAS_UNKNOWN,
            )
            q[k] = s.q if s.q[0] >= 0.0 else [-x for x in s.q]
            tilt, yaw = sigmas(s.doubt, self._residual, bias_known=s.bias_known)
            sigma[k] = tilt, tilt, yaw
            integral[k] = s.correction.integral_rad_s
            if s.settling:
                flags[k] |= Flag.SETTLING
        return AttitudeBlock(
            t_ns=block.t_ns,
            period_s=block.period_s,
            gap_ns=block.gap_ns,
            flags=flags,
            q=q,
            sigma_rad=sigma,
            gyro_rad_s=block.gyro_rad_s + integral,
            accel_m_s2=block.accel_m_s2,
            temp_degc=block.temp_degc,
            gyro_bias_rad_s=block.gyro_bias_rad_s - integral,
            still=block.still,
        )

    def _next(
        self,
        s: PidState,
        rate: Vector,
        force: Vector,
        dt: float,
        gap_s: float,
        *,
        still: bool,
        bias_known: bool,
    ) -> PidState:
        if s.rate_rad_s is None:
            q = standing(force)
            return PidState(q=q, rate_rad_s=rate, bias_known=bias_known, acquiring=not bias_known)
        if bias_known and not s.bias_known:
            s = _with_bias_known(s, rate)
        if gap_s > 0.0:
            s = _bridged(s, rate, gap_s)
        if still and not bias_known:
            return _standing_still(s, rate, force, dt)
        gains = self._acquire_gains(s) if s.acquiring else self._gains
        error, up = tilt_error(s.q, force), up_in_body(s.q)
        correction = corrected(s.correction, error, up, dt, gains)
        cx, cy, cz = correction.rate_rad_s
        held = (rate[0] + cx, rate[1] + cy, rate[2] + cz)
        turn = held[0] * up[0] + held[1] * up[1] + held[2] * up[2]
        doubt = after_step(s.doubt, error, turn, dt, gains.kp)
        settling, agreeing_s = self._settling(s, doubt, dt, bias_known=bias_known)
        return PidState(
            q=step(s.q, held, dt, self.params.method),
            rate_rad_s=rate,
            correction=correction,
            doubt=doubt,
            bias_known=bias_known,
            settling=settling,
            settling_s=s.settling_s + dt if settling else 0.0,
            agreeing_s=agreeing_s,
            acquiring=s.acquiring and (settling or not bias_known),
        )

    def _acquire_gains(self, s: PidState) -> Gains:
        kp = max(self.params.kp, 1.0)
        if s.settling:
            kp += (ACQUIRE_KP - 1.0) * min(1.0, max(0.0, 2.0 - s.settling_s / ACQUIRE_S))
        if s.bias_known:
            return replace(self._gains, kp=kp, kd=0.0)
        return Gains(kp, 0.25 * kp * kp, 0.0, self.params.kd_tau_s, ACQUIRE_LIMIT_RAD_S)

    def _settling(self, s: PidState, doubt: Doubt, dt: float, *, bias_known: bool) -> tuple[bool, float]:
        """Whether SETTLING is flagged after this step, and for how long gravity has agreed."""
        error = sqrt(doubt.error_ms)
        if not s.settling:
            return not bias_known and error > UNSETTLED_RAD, 0.0
        agreeing_s = s.agreeing_s + dt if error < SETTLED_RAD else 0.0
        if bias_known:
            # With the bias known the loop itself forgets a wrong start, to e^-5 in this time.
            return agreeing_s < SETTLED_FOR_S and s.settling_s * max(self.params.kp, 0.1) < 5.0, agreeing_s
        return agreeing_s < SETTLED_FOR_S or s.settling_s < ACQUIRE_S, agreeing_s


def _with_bias_known(s: PidState, rate: Vector) -> PidState:
    """The stage before has just begun to remove the bias: the integral's estimate of it must go, and yaw
    counts from here. After levelling nothing is left to settle."""
    was_level = s.level_sum != ZERO
    doubt = replace(s.doubt, yaw_s=0.0, turned_rad=0.0, yaw_ms=0.0)
    if was_level:
        doubt = replace(doubt, error_ms=0.0, pull_rad=ZERO, pull_ms=0.0)
    return replace(
        s,
        rate_rad_s=rate,
        correction=Correction(),
        doubt=doubt,
        level_sum=ZERO,
        settling=s.settling and not was_level,
        acquiring=s.acquiring and s.settling and not was_level,
    )


def _bridged(s: PidState, rate: Vector, gap_s: float) -> PidState:
    """The state at the gap's end; the step is long, so it is taken exactly."""
    last = s.rate_rad_s or rate
    change = (rate[0] - last[0], rate[1] - last[1], rate[2] - last[2])
    ix, iy, iz = s.correction.integral_rad_s
    held = (
        last[0] + 0.5 * change[0] + ix,
        last[1] + 0.5 * change[1] + iy,
        last[2] + 0.5 * change[2] + iz,
    )
    s = replace(s, q=step(s.q, held, gap_s, "exp"), rate_rad_s=rate, doubt=after_gap(s.doubt, change, gap_s))
    if gap_s > LONG_GAP_S:
        s = replace(s, settling=True, settling_s=0.0, agreeing_s=0.0, acquiring=True)
    return s


def _standing_still(s: PidState, rate: Vector, force: Vector, dt: float) -> PidState:
    """Still with an unknown bias: the rate says nothing, the mean accelerometer all there is to know."""
    x, y, z = s.level_sum
    level_sum = (x + force[0], y + force[1], z + force[2])
    q = standing(level_sum)
    doubt = after_step(s.doubt, tilt_error(q, force), 0.0, dt, 1.0)
    return replace(s, q=q, rate_rad_s=rate, correction=Correction(), doubt=doubt, level_sum=level_sum)
