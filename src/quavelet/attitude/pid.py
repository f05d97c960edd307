"""The PID complementary filter of paper 000 (its methods 2 to 4) as a stage that starts by itself.

Gravity says how far off the quaternion is, and the rate with that correction turns it (the paper's order;
it leads the sample by up to a period, about as much as the chip's low-pass makes the sample late). Three
ways through a sample:

    level     bias unknown, board still: the mean accelerometer is the tilt, nothing turns
    acquire   bias unknown, or a long gap just passed: strong gains, SETTLING until gravity agrees
    track     the gains asked for

A gap is bridged by holding the mean of the rates before and after it, and where it was long the accelerometer is the
tilt once more; what that may cost goes into sigma. While the
chip is stuck the attitude stands and is not to be trusted, and what comes after that is a gap as long.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import hypot, sqrt

import msgspec
import numpy as np

from quavelet.attitude.correction import Correction, Gains, corrected
from quavelet.attitude.doubt import Doubt, Residual, after_gap, after_step, bias_sigma, sigmas, yaw_anew
from quavelet.attitude.inputs import refuse_bad
from quavelet.attitude.kernel import (
    IDENTITY,
    ZERO,
    Method,
    Quaternion,
    Vector,
    levelled,
    standing,
    step,
    tilt_error,
    up_in_body,
)
from quavelet.attitude.samples import Sample, attitude_of, samples
from quavelet.attitude.settling import Settling, gains_of, restarted, settled
from quavelet.attitude.settling import after_step as settled_further
from quavelet.core.blocks import AttitudeBlock, Flag, ImuBlock
from quavelet.core.errors import SettingsError

LONG_GAP_S = 0.25
"""After a longer gap nobody knows what the board did in it: gravity has to say."""
HOLD_S = 1.0
"""A rate that is held for longer turns the board any number of times: from here on it is doubt."""


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
    stuck_s      how long the chip has been stuck up to this sample
    bias         the last sample's bias, None while it is unknown; bias_degc the temperature when it last changed
    """

    q: Quaternion = IDENTITY
    rate_rad_s: Vector | None = None
    correction: Correction = Correction()
    doubt: Doubt = Doubt()
    settling: Settling = Settling()
    level_sum: Vector = ZERO
    stuck_s: float = 0.0
    bias: Vector | None = None
    bias_degc: float = 0.0


class PidFilter:
    """`ImuBlock` to `AttitudeBlock`; an `AttitudeFilter`. With all gains zero gravity is asked at the start only."""

    def __init__(self, params: PidParams, *, residual: Residual) -> None:
        self.params = params
        self._residual = residual
        self._open_loop = not (params.kp or params.ki or params.kd)
        self._gains = Gains(params.kp, params.ki, params.kd, params.kd_tau_s, params.integral_limit_rad_s)
        self._s = PidState()

    def state(self) -> PidState:
        return self._s

    def restore(self, state: PidState) -> None:
        self._s = state

    def count_yaw_anew(self) -> None:
        self._s = replace(self._s, doubt=yaw_anew(self._s.doubt))

    def process(self, block: ImuBlock) -> AttitudeBlock:
        refuse_bad(block)
        n = len(block)
        q, sigma, flags = np.empty((n, 4)), np.empty((n, 3)), block.flags.copy()
        drift = np.empty((n, 3))
        for k, sample in enumerate(samples(block)):
            s = self._s = self._next(self._s, sample)
            q[k] = s.q
            tilt, yaw = sigmas(s.doubt, self._residual)
            sigma[k] = tilt, tilt, yaw
            drift[k] = [-x for x in s.correction.integral_rad_s]
            if s.settling.settling or s.stuck_s:
                flags[k] |= Flag.SETTLING
        return attitude_of(block, q=q, sigma_rad=sigma, drift_rad_s=drift, flags=flags)

    def _next(self, s: PidState, sample: Sample) -> PidState:
        known = sample.bias is not None
        if s.rate_rad_s is None:
            return PidState(
                q=standing(sample.force),
                rate_rad_s=sample.rate,
                settling=restarted(bias_known=known),
                bias=sample.bias,
                bias_degc=sample.temp_degc,
            )
        if sample.bias != s.bias:
            s = _with_new_bias(s, sample)
        if sample.stuck:
            return replace(s, stuck_s=s.stuck_s + sample.gap_s + sample.dt)
        if sample.gap_s > 0.0 or s.stuck_s:
            s = _bridged(s, sample, gap_s=sample.gap_s + s.stuck_s, open_loop=self._open_loop)
        drift = bias_sigma(self._residual, known=known, warmer_degc=sample.temp_degc - s.bias_degc)
        if sample.still and not known:
            return _levelled(s, sample, drift)
        gains = self._gains if self._open_loop else gains_of(s.settling, self._gains, bias_known=known)
        error, up = tilt_error(s.q, sample.force), up_in_body(s.q)
        correction = corrected(s.correction, error, up, sample.dt, gains)
        wx, wy, wz = sample.rate
        cx, cy, cz = correction.rate_rad_s
        held = (wx + cx, wy + cy, wz + cz)
        turn = held[0] * up[0] + held[1] * up[1] + held[2] * up[2]
        doubt = after_step(s.doubt, error, turn, drift, sample.dt, gains.kp or 1.0)
        # Not `replace`, which takes longer than all of the above.
        return PidState(
            q=step(s.q, held, sample.dt, self.params.method),
            rate_rad_s=sample.rate,
            correction=correction,
            doubt=doubt,
            settling=settled_further(s.settling, sqrt(doubt.error_ms), sample.dt, self.params.kp, bias_known=known),
            bias=s.bias,
            bias_degc=s.bias_degc,
        )


def _with_new_bias(s: PidState, sample: Sample) -> PidState:
    """The stage before removes another bias from now on. When it is the first one, the integral's own estimate
    must go, yaw counts from here, and after levelling nothing is left to settle."""
    new = replace(s, bias=sample.bias, bias_degc=sample.temp_degc)
    if s.bias is not None or sample.bias is None:
        return new
    doubt = yaw_anew(s.doubt)
    new = replace(new, rate_rad_s=sample.rate, correction=Correction(), doubt=doubt)
    if s.level_sum == ZERO:
        return new
    doubt = replace(doubt, error_ms=0.0, pull_rad=ZERO, pull_ms=0.0)
    return replace(new, doubt=doubt, settling=settled())


def _bridged(s: PidState, sample: Sample, *, gap_s: float, open_loop: bool) -> PidState:
    """The state at the gap's end; the step is long, so it is taken exactly."""
    last = s.rate_rad_s or sample.rate
    change = (sample.rate[0] - last[0], sample.rate[1] - last[1], sample.rate[2] - last[2])
    ix, iy, iz = s.correction.integral_rad_s
    held = (last[0] + 0.5 * change[0] + ix, last[1] + 0.5 * change[1] + iy, last[2] + 0.5 * change[2] + iz)
    held_s = min(gap_s, HOLD_S)
    q = step(s.q, held, held_s, "exp")
    s = replace(s, q=q, doubt=after_gap(s.doubt, change, gap_s, unheld=hypot(*held) * (gap_s - held_s)), stuck_s=0.0)
    if gap_s <= LONG_GAP_S or open_loop:
        return s
    settling = restarted(bias_known=s.bias is not None, after_gap=True)
    return replace(s, q=levelled(q, sample.force), settling=settling)


def _levelled(s: PidState, sample: Sample, drift_rad_s: float) -> PidState:
    """Still with an unknown bias: the rate says nothing, the mean accelerometer all there is to know."""
    x, y, z = s.level_sum
    level_sum = (x + sample.force[0], y + sample.force[1], z + sample.force[2])
    q = standing(level_sum)
    doubt = after_step(s.doubt, tilt_error(q, sample.force), 0.0, drift_rad_s, sample.dt, 1.0)
    return replace(s, q=q, rate_rad_s=sample.rate, correction=Correction(), doubt=doubt, level_sum=level_sum)
