"""The quaternion fusion of paper 003 as it is written: recursive least squares of the drift alone. Not for use.

The difference between the quaternion of the rate and that of the accelerometer is taken for drift, although the
attitude's own error is in it too (eq. 18). With g = 1 - lambda the loop's poles lie at sqrt(1 - g), damped by
sqrt(g)/2: it rings, and what acceleration excites it with it multiplies. `fusion.py` is the form that is stable.
This one is here so that the paper can be judged by it; as a stage it says when it is lost, and starts anew.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import hypot, sqrt

import msgspec
import numpy as np

from quavelet.attitude.doubt import YAW_MAX_RAD, Doubt, Residual, after_gap, after_step, bias_sigma, sigmas, yaw_anew
from quavelet.attitude.fusion_root import Frozen, frozen, potter, sigma, thawed
from quavelet.attitude.inputs import refuse_bad
from quavelet.attitude.kernel import (
    IDENTITY,
    ZERO,
    Quaternion,
    Vector,
    levelled,
    normalised,
    standing,
    step,
    tilt_error,
    up_in_body,
)
from quavelet.attitude.pid import HOLD_S, LONG_GAP_S
from quavelet.attitude.samples import Sample, attitude_of, samples
from quavelet.attitude.settling import ACQUIRE_LIMIT_RAD_S, AGREE_S, SETTLED_RAD, UNSETTLED_RAD
from quavelet.core.blocks import AttitudeBlock, Flag, ImuBlock
from quavelet.core.errors import SettingsError


class LiteralParams(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What can be tuned; the paper gives no figures.

    forgetting    lambda of each sample
    accel_rad     sigma of one sample of the accelerometer, as a tilt
    drift_rad_s   sigma of the drift before the first measurement; it is not doubted more than this, for heading's
                  drift is not observed and forgetting would raise its variance for ever
    """

    forgetting: float = 0.98
    accel_rad: float = 2.83e-3
    drift_rad_s: float = 0.02

    def __post_init__(self) -> None:
        if not 0.5 <= self.forgetting <= 1.0:
            raise SettingsError(f"forgetting = {self.forgetting} does not fit: give 0.5 to 1")
        if not 1e-6 <= self.accel_rad <= 1.0:
            raise SettingsError(f"accel_rad = {self.accel_rad} does not fit: give 1e-6 to 1 rad")
        if not 1e-6 <= self.drift_rad_s <= 1.0:
            raise SettingsError(f"drift_rad_s = {self.drift_rad_s} does not fit: give 1e-6 to 1 rad/s")


@dataclass(frozen=True, slots=True)
class Drifting:
    """The paper's unknowns: attitude, drift w0 in rad/s with w_m = w + w0, and the root of its covariance."""

    q: Quaternion
    drift_rad_s: Vector
    root: Frozen


def begun(q: Quaternion, params: LiteralParams) -> Drifting:
    """Nothing measured yet."""
    d = params.drift_rad_s
    return Drifting(q, ZERO, ((d, 0.0, 0.0), (0.0, d, 0.0), (0.0, 0.0, d)))


def literal_step(last: Drifting, rate: Vector, force: Vector, dt: float, params: LiteralParams) -> Drifting:
    """One sample, eq. 17 to 19: the measured rate moves q by (T/2) Xi(q), Euler's step as the paper has it; the
    difference to the nearest quaternion that has gravity up is the measurement of the drift."""
    w, x, y, z = last.q
    half = 0.5 * dt
    h = (
        (-half * x, -half * y, -half * z),
        (half * w, -half * z, half * y),
        (half * z, half * w, -half * x),
        (-half * y, half * x, half * w),
    )
    q_rate = _moved(last.q, h, rate, 1.0)
    q_accel = levelled(normalised(q_rate), force)
    rows, drift = thawed(last.root), last.drift_rad_s
    variance, forgetting = 0.25 * params.accel_rad**2, params.forgetting
    for row, a, b in zip(h, q_rate, q_accel, strict=True):
        left = (a - b) - sum(c * d for c, d in zip(row, drift, strict=True))
        gx, gy, gz = potter(rows, row, variance, forgetting)
        drift = (drift[0] + gx * left, drift[1] + gy * left, drift[2] + gz * left)
        forgetting = 1.0
    for i in range(3):
        over = sigma(rows[i]) / params.drift_rad_s
        if over > 1.0:
            rows[i] = [d / over for d in rows[i]]
    return Drifting(normalised(_moved(q_rate, h, drift, -1.0)), drift, frozen(rows))


def _moved(q: Quaternion, h: tuple[Vector, Vector, Vector, Vector], rate: Vector, sign: float) -> Quaternion:
    rx, ry, rz = rate
    w, x, y, z = (a + sign * (hx * rx + hy * ry + hz * rz) for a, (hx, hy, hz) in zip(q, h, strict=True))
    return w, x, y, z


@dataclass(frozen=True, slots=True)
class LiteralState:
    """All memory.

    drifting     None before the first sample
    rate_rad_s   the last sample's rate
    doubt        the running disagreement with gravity
    settling     lost, or not yet found; agreeing_s how long gravity has agreed since
    stuck_s      how long the chip has been stuck up to this sample
    bias         the last sample's bias, None while it is unknown; bias_degc the temperature when it last changed
    """

    drifting: Drifting | None = None
    rate_rad_s: Vector = ZERO
    doubt: Doubt = Doubt()
    settling: bool = True
    agreeing_s: float = 0.0
    stuck_s: float = 0.0
    bias: Vector | None = None
    bias_degc: float = 0.0


class LiteralFusionFilter:
    """`ImuBlock` to `AttitudeBlock`; an `AttitudeFilter` that is lost now and then, and says so: its samples are
    SETTLING with all directions possible, and it starts anew from the accelerometer."""

    def __init__(self, params: LiteralParams, *, residual: Residual) -> None:
        self.params = params
        self._residual = residual
        self._s = LiteralState()

    def state(self) -> LiteralState:
        return self._s

    def restore(self, state: LiteralState) -> None:
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
            at = s.drifting or begun(IDENTITY, self.params)
            q[k] = at.q
            drift[k] = at.drift_rad_s
            tilt, yaw = sigmas(s.doubt, self._residual)
            sigma[k] = tilt, tilt, yaw
            if s.settling or s.stuck_s:
                flags[k] |= Flag.SETTLING
                sigma[k] = YAW_MAX_RAD
        return attitude_of(block, q=q, sigma_rad=sigma, drift_rad_s=drift, flags=flags)

    def _next(self, s: LiteralState, sample: Sample) -> LiteralState:
        if s.drifting is None:
            return LiteralState(
                drifting=begun(standing(sample.force), self.params),
                rate_rad_s=sample.rate,
                bias=sample.bias,
                bias_degc=sample.temp_degc,
            )
        if sample.bias != s.bias:
            s = self._with_new_bias(s, s.drifting, sample)
        if sample.stuck:
            return replace(s, stuck_s=s.stuck_s + sample.gap_s + sample.dt)
        if sample.gap_s > 0.0 or s.stuck_s:
            s = self._bridged(s, sample, gap_s=sample.gap_s + s.stuck_s)
        at = s.drifting
        assert at is not None
        at = literal_step(at, sample.rate, sample.force, sample.dt, self.params)
        up = up_in_body(at.q)
        turn = sum((r - d) * u for r, d, u in zip(sample.rate, at.drift_rad_s, up, strict=True))
        sd = bias_sigma(self._residual, known=sample.bias is not None, warmer_degc=sample.temp_degc - s.bias_degc)
        # The loop's own bandwidth: sqrt(1 - lambda) a sample.
        kp = sqrt(max(1.0 - self.params.forgetting, 1e-6)) / sample.dt
        doubt = after_step(s.doubt, tilt_error(at.q, sample.force), turn, sd, sample.dt, kp)
        error = sqrt(doubt.error_ms)
        lost = not s.settling and (error > UNSETTLED_RAD or max(map(abs, at.drift_rad_s)) > ACQUIRE_LIMIT_RAD_S)
        if lost:
            at = begun(levelled(at.q, sample.force), self.params)
        agreeing_s = s.agreeing_s + sample.dt if error < SETTLED_RAD and not lost else 0.0
        return LiteralState(
            drifting=at,
            rate_rad_s=sample.rate,
            doubt=doubt,
            settling=lost or (s.settling and agreeing_s < AGREE_S),
            agreeing_s=agreeing_s,
            bias=s.bias,
            bias_degc=s.bias_degc,
        )

    def _with_new_bias(self, s: LiteralState, at: Drifting, sample: Sample) -> LiteralState:
        """The stage before removes another bias from now on; a first one replaces the drift, and yaw counts from it."""
        new, old = sample.bias, s.bias
        s = replace(s, bias=new, bias_degc=sample.temp_degc)
        if new is None:
            return s
        if old is None:
            doubt = yaw_anew(s.doubt)
            return replace(s, drifting=begun(at.q, self.params), rate_rad_s=sample.rate, doubt=doubt)
        x, y, z = (d - (b - a) for d, a, b in zip(at.drift_rad_s, old, new, strict=True))
        return replace(s, drifting=replace(at, drift_rad_s=(x, y, z)))

    def _bridged(self, s: LiteralState, sample: Sample, *, gap_s: float) -> LiteralState:
        """The state at the gap's end: the mean of the rates before and after was held; after a long gap the filter
        starts anew."""
        at = s.drifting
        assert at is not None
        x, y, z = (b - a for a, b in zip(s.rate_rad_s, sample.rate, strict=True))
        hx, hy, hz = (0.5 * (a + b) - d for a, b, d in zip(s.rate_rad_s, sample.rate, at.drift_rad_s, strict=True))
        held_s = min(gap_s, HOLD_S)
        q = step(at.q, (hx, hy, hz), held_s, "exp")
        doubt = after_gap(s.doubt, (x, y, z), gap_s, unheld=hypot(hx, hy, hz) * (gap_s - held_s))
        s = replace(s, drifting=replace(at, q=q), doubt=doubt, stuck_s=0.0)
        if gap_s <= LONG_GAP_S:
            return s
        return replace(s, drifting=begun(levelled(q, sample.force), self.params), settling=True, agreeing_s=0.0)
