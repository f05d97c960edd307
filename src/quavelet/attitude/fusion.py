"""The quaternion fusion of paper 003 in its stable form, as a stage that starts by itself.

Per sample: the rate less its estimated bias turns the quaternion, the covariance goes on with it, and gravity
corrects both (fusion_error.py). Two models of what the accelerometer says beside gravity:

    velocity  the board's acceleration is the derivative of a velocity that stays near zero: the specific force is
              integrated in the world, and the velocity that comes of it is measured to be none
    gravity   the board's acceleration is white noise: the paper's six states, the specific force is up

There are no gains to start strong and to fade: a wide covariance does that, and says when the tilt can be trusted.
Gaps, stuck chips and a bias that becomes known are dealt with as in pid.py.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import exp, hypot, sqrt

import numpy as np

from quavelet.attitude.doubt import (
    BIAS_LIMIT_SIGMA_RAD_S,
    ERROR_TAU_S,
    TILT_FLOOR_RAD,
    YAW_MAX_RAD,
    Residual,
    bias_sigma,
)
from quavelet.attitude.fusion_error import (
    HEADING,
    TILT_X,
    TILT_Y,
    VELOCITY_X,
    VELOCITY_Y,
    Estimate,
    Noise,
    corrected,
    first_root,
    forget,
    predicted,
)
from quavelet.attitude.fusion_params import FusionParams
from quavelet.attitude.fusion_root import Rows, add_noise, frozen, isolate, sigma, thawed
from quavelet.attitude.inputs import refuse_bad
from quavelet.attitude.kernel import ZERO, Vector, levelled, standing
from quavelet.attitude.pid import HOLD_S, LONG_GAP_S
from quavelet.attitude.samples import Sample, attitude_of, samples
from quavelet.attitude.settling import SETTLED_RAD, UNSETTLED_RAD
from quavelet.core.blocks import AttitudeBlock, Flag, ImuBlock
from quavelet.core.units import RAD_PER_DEG
from quavelet.core.units import STANDARD_GRAVITY_M_S2 as G

START_TILT_RAD = 3.0 * RAD_PER_DEG
"""How far off the first sample's accelerometer may be: 50 mg of the board's own acceleration."""
START_VELOCITY_M_S = 0.5
CLIPPED_M_S = 0.3
"""What an accelerometer that reads its end may have missed of a blow."""
PULL_S = 0.3
"""About as long as a hand's push keeps its direction."""
LOST_M_S, LOST_G, LOST_S = 3.0, 0.35, 1.0
"""A board does not keep such a velocity, or acceleration, for so long, nor falls faster than free: the attitude is
wrong."""
WARMER_DEGC = 0.25
"""The bias is doubted anew after each such change of temperature; less is the thermometer's noise."""


@dataclass(frozen=True, slots=True)
class FusionState:
    """All memory.

    estimate     None before the first sample
    rate_rad_s   the last sample's rate
    pull         the measurements' residual, low-passed: what white noise leaves of itself is small
    surprise     running mean of its square over what the covariance expects: more than 1 where the noise is not white
    turned_rad   turned about the vertical since yaw counts from zero
    settling     the attitude is not to be trusted yet
    lost_s       for how long the residual has been such that no board moves
    level_sum    sum of the accelerometer while levelling, over level_s
    stuck_s      how long the chip has been stuck up to this sample
    bias         the last sample's bias, None while it is unknown; bias_degc the temperature when it last changed,
                 warmer_degc the change since that the covariance knows of, bias_cap the sigma it began with
    """

    estimate: Estimate | None = None
    rate_rad_s: Vector = ZERO
    pull: tuple[float, float] = (0.0, 0.0)
    surprise: float = 1.0
    turned_rad: float = 0.0
    settling: bool = True
    lost_s: float = 0.0
    level_sum: Vector = ZERO
    level_s: float = 0.0
    stuck_s: float = 0.0
    bias: Vector | None = None
    bias_degc: float = 0.0
    warmer_degc: float = 0.0
    bias_cap: float = BIAS_LIMIT_SIGMA_RAD_S


class FusionFilter:
    """`ImuBlock` to `AttitudeBlock`; an `AttitudeFilter`."""

    def __init__(self, params: FusionParams, *, residual: Residual) -> None:
        self.params = p = params
        self._residual = residual
        self._by_velocity = p.model == "velocity"
        moving, still = (p.velocity_m_s_rthz, p.rest_m_s_rthz) if self._by_velocity else (None, None)
        self._moving = Noise(
            gyro_rad_s_rthz=p.gyro_rad_s_rthz,
            gyro_share_rthz=p.gyro_share_rthz if self._by_velocity else 0.0,
            accel_m_s2_rthz=p.accel_m_s2_rthz if self._by_velocity else p.sway_m_s2_rthz,
            velocity_m_s_rthz=moving,
            bias_rad_s_rts=p.bias_walk_rad_s_rts,
        )
        self._still = replace(
            self._moving,
            gyro_rad_s_rthz=p.gyro_still_rad_s_rthz,
            accel_m_s2_rthz=p.accel_m_s2_rthz,
            velocity_m_s_rthz=still,
        )
        self._s = FusionState()

    def state(self) -> FusionState:
        return self._s

    def restore(self, state: FusionState) -> None:
        self._s = state

    def count_yaw_anew(self) -> None:
        e = self._s.estimate
        if e is not None:
            rows = thawed(e.root)
            isolate(rows, len(rows) + HEADING, 0.0)
            self._s = replace(self._s, estimate=replace(e, root=frozen(rows)), turned_rad=0.0)

    def process(self, block: ImuBlock) -> AttitudeBlock:
        refuse_bad(block)
        n = len(block)
        q, sigma, flags = np.empty((n, 4)), np.empty((n, 3)), block.flags.copy()
        drift = np.empty((n, 3))
        for k, sample in enumerate(samples(block)):
            s = self._s = self._next(self._s, sample)
            e = s.estimate
            assert e is not None
            q[k] = e.q
            sigma[k] = self._sigmas(s, e)
            drift[k] = e.bias_rad_s
            if s.settling or s.stuck_s:
                flags[k] |= Flag.SETTLING
        return attitude_of(block, q=q, sigma_rad=sigma, drift_rad_s=drift, flags=flags)

    def _sigmas(self, s: FusionState, e: Estimate) -> tuple[float, float, float]:
        """One sigma of tilt about x and y, and of yaw: the covariance, as much wider as the measurements surprise,
        and what the calibration leaves open."""
        wider = sqrt(max(1.0, s.surprise))
        floor = hypot(self._residual.tilt_rad, TILT_FLOOR_RAD)
        x, y = e.tilt_sigma_rad()
        yaw = hypot(e.heading_sigma_rad(), self._residual.gyro_scale * s.turned_rad)
        return hypot(floor, wider * x), hypot(floor, wider * y), min(yaw, YAW_MAX_RAD)

    def _next(self, s: FusionState, sample: Sample) -> FusionState:
        if s.estimate is None:
            return self._first(sample)
        if sample.bias != s.bias:
            s = self._with_new_bias(s, s.estimate, sample)
        if sample.stuck:
            return replace(s, stuck_s=s.stuck_s + sample.gap_s + sample.dt)
        if sample.gap_s > 0.0 or s.stuck_s:
            s = self._bridged(s, sample, gap_s=sample.gap_s + s.stuck_s)
        e = s.estimate
        assert e is not None
        rows = thawed(e.root)
        noise = self._still if sample.still else self._moving
        warmer = self._warmed(s, sample, rows)
        fading = exp(-0.5 * sample.dt / self.params.memory_s)
        forget(rows, fading, (s.bias_cap,) * 3 + (START_TILT_RAD,) * 2)
        e, up = predicted(e, sample.rate, sample.force, sample.dt, noise, rows)
        if sample.still and sample.bias is None:
            return self._levelled(replace(s, warmer_degc=warmer), e, sample, rows)
        e, pull, surprise = self._corrected(s, e, sample, up, noise, rows)
        doubt = sqrt(max(1.0, surprise)) * max(e.tilt_sigma_rad())
        lost = up[2] < 0.0 or hypot(*pull) > (LOST_M_S if self._by_velocity else LOST_G)
        lost_s = s.lost_s + sample.dt if lost else 0.0
        if lost_s > LOST_S:
            return self._found_anew(s, e, sample)
        # Not `replace`, which takes longer.
        return FusionState(
            estimate=e,
            rate_rad_s=sample.rate,
            pull=pull,
            surprise=surprise,
            turned_rad=s.turned_rad + self._turn(e, sample),
            settling=lost or doubt > (SETTLED_RAD if s.settling else UNSETTLED_RAD),
            lost_s=lost_s,
            bias=s.bias,
            bias_degc=s.bias_degc,
            warmer_degc=warmer,
            bias_cap=s.bias_cap,
        )

    def _first(self, sample: Sample) -> FusionState:
        cap = self._bias_sigma(sample)
        velocity = START_VELOCITY_M_S if self._by_velocity else None
        return FusionState(
            estimate=Estimate(standing(sample.force), first_root(cap, START_TILT_RAD, 0.0, velocity)),
            rate_rad_s=sample.rate,
            bias=sample.bias,
            bias_degc=sample.temp_degc,
            bias_cap=cap,
        )

    def _corrected(
        self, s: FusionState, e: Estimate, sample: Sample, up: Vector, noise: Noise, rows: Rows
    ) -> tuple[Estimate, tuple[float, float], float]:
        """The estimate after this sample's accelerometer, and the state's `pull` and `surprise`."""
        ux, uy, _ = up
        density, residual, states = noise.accel_m_s2_rthz / G, (uy / G, -ux / G), (TILT_X, TILT_Y)
        if noise.velocity_m_s_rthz is not None:
            vx, vy = e.velocity_m_s
            density, residual, states = noise.velocity_m_s_rthz, (-vx, -vy), (VELOCITY_X, VELOCITY_Y)
        # Not the direction of the force but the force: a bounded velocity has no mean acceleration, and the mean
        # force is up; the mean of directions is not.
        variance = 0.5 * density**2 / sample.dt
        if self.params.norm_gate > 0.0 and not self._by_velocity:
            variance *= 1.0 + ((hypot(*sample.force) / G - 1.0) / self.params.norm_gate) ** 4
        if sample.accel_clipped:
            if not self._by_velocity:
                return replace(e, root=frozen(rows)), s.pull, s.surprise
            add_noise(rows, VELOCITY_X, CLIPPED_M_S)
            add_noise(rows, VELOCITY_Y, CLIPPED_M_S)
        share = sample.dt / (PULL_S + sample.dt)
        x, y = (p + share * (r - p) for p, r in zip(s.pull, residual, strict=True))
        expected = sigma(rows[states[0]]) ** 2 + sigma(rows[states[1]]) ** 2 + 0.5 * density**2 / PULL_S
        share = sample.dt / (ERROR_TAU_S + sample.dt)
        surprise = s.surprise + share * ((x * x + y * y) / expected - s.surprise)
        return corrected(e, rows, states, residual, variance), (x, y), surprise

    def _found_anew(self, s: FusionState, e: Estimate, sample: Sample) -> FusionState:
        """The attitude was lost, to a clipped rate perhaps: tilt from the accelerometer, heading unknown."""
        rows = thawed(e.root)
        for i in range(len(rows) + HEADING):
            isolate(rows, i, s.bias_cap if i < TILT_X else START_TILT_RAD if i <= TILT_Y else START_VELOCITY_M_S)
        add_noise(rows, len(rows) + HEADING, YAW_MAX_RAD)
        bias = e.bias_rad_s if s.bias is None else ZERO
        e = Estimate(levelled(e.q, sample.force), frozen(rows), bias)
        return replace(s, estimate=e, rate_rad_s=sample.rate, pull=(0.0, 0.0), surprise=1.0, settling=True, lost_s=0.0)

    def _bias_sigma(self, sample: Sample) -> float:
        known = sample.bias is not None
        return max(self.params.bias_rad_s, bias_sigma(self._residual, known=known, warmer_degc=0.0))

    def _warmed(self, s: FusionState, sample: Sample, rows: Rows) -> float:
        """A bias known at one temperature is less so at another."""
        warmer = abs(sample.temp_degc - s.bias_degc)
        if s.bias is None or warmer < s.warmer_degc + WARMER_DEGC:
            return s.warmer_degc
        sd = self._residual.gyro_bias_rad_s_degc * sqrt(warmer**2 - s.warmer_degc**2)
        for i in range(3):
            add_noise(rows, i, sd)
        return warmer

    @staticmethod
    def _turn(e: Estimate, sample: Sample) -> float:
        """What this sample turned the board about the vertical, rad."""
        w, x, y, z = e.q
        up = 2.0 * (x * z - w * y), 2.0 * (y * z + w * x), w * w - x * x - y * y + z * z
        return sample.dt * sum((r - b) * v for r, b, v in zip(sample.rate, e.bias_rad_s, up, strict=True))

    def _with_new_bias(self, s: FusionState, e: Estimate, sample: Sample) -> FusionState:
        """The stage before removes another bias from now on. A first one replaces what was estimated here, and yaw
        counts from it; a later one is a better share of the same sum."""
        new, old = sample.bias, s.bias
        s = replace(s, bias=new, bias_degc=sample.temp_degc, warmer_degc=0.0)
        if new is None:
            return s
        if old is not None:
            x, y, z = (b - (to - was) for b, to, was in zip(e.bias_rad_s, new, old, strict=True))
            return replace(s, estimate=replace(e, bias_rad_s=(x, y, z)))
        rows, cap = thawed(e.root), self._bias_sigma(sample)
        for i in range(3):
            isolate(rows, i, cap)
        isolate(rows, len(rows) + HEADING, 0.0)
        e = replace(e, root=frozen(rows), bias_rad_s=ZERO)
        return replace(s, estimate=e, rate_rad_s=sample.rate, turned_rad=0.0, bias_cap=cap, level_sum=ZERO, level_s=0.0)

    def _bridged(self, s: FusionState, sample: Sample, *, gap_s: float) -> FusionState:
        """The state at the gap's end: the mean of the rates before and after was held, wrong by half of their
        difference at worst; after a long gap the accelerometer is the tilt once more."""
        e = s.estimate
        assert e is not None
        rows = thawed(e.root)
        change = tuple(b - a for a, b in zip(s.rate_rad_s, sample.rate, strict=True))
        x, y, z = (a + 0.5 * c for a, c in zip(s.rate_rad_s, change, strict=True))
        held_s = min(gap_s, HOLD_S)
        e, _ = predicted(e, (x, y, z), ZERO, held_s, self._moving, rows)
        unheld = hypot(x, y, z) * (gap_s - held_s)
        doubt = hypot(0.5 * gap_s * hypot(*change), unheld)
        long = gap_s > LONG_GAP_S
        for i in (TILT_X, TILT_Y):
            if long:
                isolate(rows, i, START_TILT_RAD)
            else:
                add_noise(rows, i, doubt)
        if self._by_velocity:
            for i in (VELOCITY_X, VELOCITY_Y):
                isolate(rows, i, START_VELOCITY_M_S)
        add_noise(rows, len(rows) + HEADING, doubt)
        q = levelled(e.q, sample.force) if long else e.q
        e = replace(e, q=q, root=frozen(rows), velocity_m_s=(0.0, 0.0))
        return replace(s, estimate=e, settling=s.settling or long, stuck_s=0.0, level_sum=ZERO, level_s=0.0)

    def _levelled(self, s: FusionState, e: Estimate, sample: Sample, rows: Rows) -> FusionState:
        """Still with an unknown bias: the rate says nothing, the mean accelerometer all there is to know."""
        level_s = s.level_s + sample.dt
        x, y, z = (a + b for a, b in zip(s.level_sum, sample.force, strict=True))
        sd = self.params.accel_m_s2_rthz / G / sqrt(2.0 * level_s)
        isolate(rows, TILT_X, sd)
        isolate(rows, TILT_Y, sd)
        if self._by_velocity:
            isolate(rows, VELOCITY_X, self.params.rest_m_s_rthz)
            isolate(rows, VELOCITY_Y, self.params.rest_m_s_rthz)
        e = Estimate(standing((x, y, z)), frozen(rows))
        return replace(
            s, estimate=e, rate_rad_s=sample.rate, surprise=1.0, settling=False, level_sum=(x, y, z), level_s=level_s
        )
