"""The default filter: an attitude that holds still when the board does, and a horizon from bounded velocity else.

    level     bias unknown, board still: the mean accelerometer is the tilt, nothing turns
    moving    the rate less its bias turns the board, and the horizon (horizon.py) corrects it
    still     the rate is all bias: nothing turns, the bias is learned, tilt follows the accelerometer's long mean

Taking the low band of the rate away is right exactly while the board is still, which is what paper 000 does at all
times. On the way from still to moving the last second, or what of the last eight shows a turn, is turned after all.
The bias is learned from chunks that have been eight seconds in the window without showing one. What is lost is a turn
about the vertical below `gate.RATE_LIMIT_RAD_S`.
"""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass
from math import hypot, sqrt

import numpy as np

from quavelet.attitude import quiet as listening
from quavelet.attitude.doubt import BIAS_LIMIT_SIGMA_RAD_S, GYRO_DENSITY_RAD, TILT_FLOOR_RAD, YAW_MAX_RAD, Residual
from quavelet.attitude.gate import Gate, entered, left, looks_still, replayed, rested, stays_still
from quavelet.attitude.horizon import Horizon, after_swing, unseen, velocity_density
from quavelet.attitude.inputs import refuse_bad
from quavelet.attitude.kernel import (
    IDENTITY,
    ZERO,
    Method,
    Quaternion,
    Vector,
    levelled,
    normalised,
    product,
    standing,
    step,
    up_in_body,
)
from quavelet.attitude.suspicion import WARM_UP_S, Suspicion, Warmth, after_window, warmed
from quavelet.attitude.swing import Row, row_of, swing_of
from quavelet.core.blocks import AttitudeBlock, Flag, FloatArray, ImuBlock
from quavelet.core.units import NS_PER_S, RAD_PER_DEG

START_TILT_RAD = 0.2
"""One sigma of the first accelerometer sample as a tilt, the board moving or not."""
LONG_GAP_S, HOLD_S = 0.25, 1.0
"""After a longer gap gravity has to say; a rate is held for no longer than a second."""
SETTLED_RAD, AGREE_S = 2.5 * RAD_PER_DEG, 1.0
"""The attitude is trusted when its tilt's sigma is below this, after so long."""
_STUCK, _BIAS_UNKNOWN, _CLIPPED = int(Flag.STUCK), int(Flag.BIAS_UNKNOWN), int(Flag.GYRO_CLIPPED)


@dataclass(frozen=True, slots=True)
class Heading:
    """What yaw has gone through since it counts from zero: seconds moving, rad turned about the vertical, rad that
    the bias' sigma adds up to, and mean square of what gaps may have cost."""

    moving_s: float = 0.0
    turned_rad: float = 0.0
    drift_rad: float = 0.0
    gap_ms: float = 0.0


@dataclass(slots=True)
class GatedState:
    """All memory. `state()` gives a copy; what it holds is never changed in place.

    rate_rad_s          the last sample's rate with its bias, None before the first sample
    bias_rad_s, known   what is taken off it; known: it has been measured at rest
    rows                rate and force of the current chunk's samples, and `chunk_s` its length
    swung, blind_s      of the current chunk while moving: see `Swing`
    tilt_ms             mean square of the tilt error while still
    agreeing_s          how long a moving board has looked still
    up_s                time since the first sample
    settled_s           time since the start or the last long gap; settling: not to be trusted yet
    """

    horizon: Horizon
    quiet: listening.Quiet
    q: Quaternion = IDENTITY
    rate_rad_s: Vector | None = None
    bias_rad_s: Vector = ZERO
    known: bool = False
    bias_degc: float = 0.0
    rows: tuple[tuple[float, ...], ...] = ()
    chunk_s: float = 0.0
    swung: tuple[Row, ...] = ()
    blind_s: float = 0.0
    gate: Gate | None = None
    level_sum: Vector = ZERO
    stuck_s: float = 0.0
    settling: bool = True
    settled_s: float = 0.0
    heading: Heading = Heading()
    suspicion: Suspicion = Suspicion()
    warmth: Warmth = Warmth()
    up_s: float = 0.0
    agreeing_s: float = 0.0


class GatedFilter:
    """`ImuBlock` to `AttitudeBlock`; an `AttitudeFilter`.

    tau_s      time constant of the horizon while moving
    relearn_s  a constant rate that is held for so long, no other axis showing motion, is taken for a bias in the
               first minutes and while the chip's temperature changes; 0: never
    gate       False: the board is taken to move at all times
    """

    def __init__(
        self,
        *,
        residual: Residual,
        tau_s: float = 4.0,
        relearn_s: float = 0.0,
        gate: bool = True,
        method: Method = "exp",
    ) -> None:
        self._residual = residual
        self._density = velocity_density(tau_s)
        self._relearn_s = relearn_s
        self._gated = gate
        self._method: Method = method
        self._s = GatedState(unseen(residual), listening.unheard())

    def state(self) -> GatedState:
        return copy(self._s)

    def restore(self, state: GatedState) -> None:
        self._s = copy(state)

    def count_yaw_anew(self) -> None:
        self._s.heading = Heading()

    def process(self, block: ImuBlock) -> AttitudeBlock:
        refuse_bad(block)
        n, s = len(block), self._s
        q, sigma, bias = np.empty((n, 4)), np.empty((n, 3)), np.empty((n, 3))
        flags, still = block.flags.copy(), block.still.copy()
        raw = block.gyro_rad_s + block.gyro_bias_rad_s
        columns = zip(
            raw.tolist(),
            block.accel_m_s2.tolist(),
            block.period_s.tolist(),
            block.gap_ns.tolist(),
            block.flags.tolist(),
            block.still.tolist(),
            block.gyro_bias_rad_s.tolist(),
            block.temp_degc.tolist(),
            strict=True,
        )
        for k, (rate, force, dt, gap_ns, flag, at_rest, given, temp_degc) in enumerate(columns):
            if s.rate_rad_s is None:
                self._begin(s, tuple(rate), tuple(force), temp_degc)
            elif flag & _STUCK:
                self._interrupt(s)
                s.stuck_s += dt + gap_ns / NS_PER_S
            elif gap_ns or s.stuck_s:
                self._bridge(s, tuple(rate), tuple(force), gap_ns / NS_PER_S + s.stuck_s)
            if not flag & _BIAS_UNKNOWN and not s.known:
                self._adopt(s, tuple(given), temp_degc)
            if not flag & _STUCK:
                s.blind_s += dt if flag & _CLIPPED else 0.0
                self._take(s, tuple(rate), tuple(force), dt, at_rest, temp_degc)
            q[k] = s.q if s.q[0] >= 0.0 else [-x for x in s.q]
            sigma[k] = self._sigmas(s)
            bias[k] = s.bias_rad_s
            if self._gated and s.known:
                still[k] = s.gate is not None
            if s.settling or s.stuck_s:
                flags[k] |= Flag.SETTLING
            if s.suspicion.suspect:
                flags[k] |= Flag.HEADING_SUSPECT
        return AttitudeBlock(
            t_ns=block.t_ns,
            period_s=block.period_s,
            gap_ns=block.gap_ns,
            flags=flags,
            q=q,
            sigma_rad=sigma,
            gyro_rad_s=raw - bias,
            accel_m_s2=block.accel_m_s2,
            temp_degc=block.temp_degc,
            gyro_bias_rad_s=bias,
            still=still,
        )

    def _begin(self, s: GatedState, rate: Vector, force: Vector, temp_degc: float) -> None:
        s.q, s.rate_rad_s, s.warmth = standing(force), rate, Warmth(temp_degc, temp_degc)
        s.horizon = s.horizon.restarted(s.q, START_TILT_RAD, np.full(3, BIAS_LIMIT_SIGMA_RAD_S**2))

    def _adopt(self, s: GatedState, bias: Vector, temp_degc: float) -> None:
        """The first bias measured at rest; yaw counts from here."""
        self._close(s, temp_degc)
        s.known, s.bias_rad_s, s.bias_degc, s.heading = True, bias, temp_degc, Heading()
        variance = np.full(3, self._residual.gyro_bias_rad_s**2)
        s.horizon = s.horizon.restarted(s.q, sqrt(s.horizon.tilt_ms), variance)
        if s.level_sum != ZERO:
            s.settling, s.level_sum = False, ZERO

    def _take(self, s: GatedState, rate: Vector, force: Vector, dt: float, at_rest: bool, temp_degc: float) -> None:
        """One sample."""
        s.rate_rad_s = rate
        s.up_s += dt
        s.settled_s += dt
        s.warmth = warmed(s.warmth, temp_degc, dt)
        if not s.known and at_rest:
            self._level(s, force)
            return
        s.rows += ((*rate, *force),)
        s.chunk_s += dt
        bx, by, bz = s.bias_rad_s
        x, y, z = rate[0] - bx, rate[1] - by, rate[2] - bz
        xx, xy, xz, yx, yy, yz, zx, zy, zz = s.horizon.matrix
        w = (
            x + (xx * x + xy * y + xz * z),
            y + (yx * x + yy * y + yz * z),
            z + (zx * x + zy * y + zz * z),
        )
        if s.gate is None:
            self._turn(s, w, force, dt)
        elif left(s.gate, w):
            self._leave(s, s.gate, listening.as_chunk(s.rows, s.chunk_s))
            return
        if s.chunk_s >= listening.CHUNK_S - 0.5 * dt:
            self._close(s, temp_degc)

    def _turn(self, s: GatedState, w: Vector, force: Vector, dt: float) -> None:
        """A step of the moving board."""
        s.swung += (row_of(s.q, w, force, dt),)
        s.q = step(s.q, w, dt, self._method)

    def _level(self, s: GatedState, force: Vector) -> None:
        """Still with an unknown bias: the rate says nothing, the mean accelerometer all there is to know."""
        x, y, z = s.level_sum
        s.level_sum = (x + force[0], y + force[1], z + force[2])
        s.q = standing(s.level_sum)
        s.horizon = s.horizon.restarted(s.q, TILT_FLOOR_RAD, s.horizon.bias_variance)
        self._empty(s)

    def _empty(self, s: GatedState) -> None:
        s.rows, s.chunk_s, s.swung, s.blind_s = (), 0.0, (), 0.0

    def _close(self, s: GatedState, temp_degc: float) -> None:
        """The current chunk ends here."""
        if not s.rows:
            return
        duration_s = s.chunk_s
        chunk = listening.as_chunk(s.rows, duration_s)
        if s.gate is None:
            self._correct(s)
            self._age_heading(s, chunk, temp_degc)
        if self._gated and s.known:
            self._listen(s, chunk, temp_degc)
        self._empty(s)
        if s.settling and s.settled_s >= AGREE_S and s.horizon.tilt_ms < SETTLED_RAD**2:
            s.settling = False

    def _correct(self, s: GatedState) -> None:
        swing = swing_of(s.swung, blind_s=s.blind_s)
        s.horizon, found = after_swing(s.horizon, swing, density=self._density)
        x, y = found.tilt_rad
        s.q = normalised(product((1.0, 0.5 * x, 0.5 * y, 0.0), s.q))
        s.bias_rad_s = _sum(s.bias_rad_s, found.bias_rad_s)

    def _age_heading(self, s: GatedState, chunk: FloatArray, temp_degc: float) -> None:
        up = np.array(up_in_body(s.q))
        turned = float(((chunk[0, 2:5] - s.bias_rad_s) * up).sum()) * s.chunk_s
        sigma = sqrt(float((up * up * s.horizon.bias_variance).sum()))
        drift = hypot(sigma, self._residual.gyro_bias_rad_s_degc * (temp_degc - s.bias_degc) if s.known else 0.0)
        h = s.heading
        s.heading = Heading(h.moving_s + s.chunk_s, h.turned_rad + turned, h.drift_rad + drift * s.chunk_s, h.gap_ms)

    def _listen(self, s: GatedState, chunk: FloatArray, temp_degc: float) -> None:
        """Is the board still from here on, or no more?"""
        s.quiet, gone, window = listening.heard(s.quiet, chunk, still=s.gate is not None)
        bias = np.array(s.bias_rad_s)
        if s.gate is not None:
            s.q, s.gate, bias = rested(s.gate, s.q, chunk, gone, bias, s.quiet)
            s.bias_rad_s, s.bias_degc = _vector(bias), temp_degc
            if window is None or not stays_still(s.gate, s.quiet, window, bias):
                self._leave(s, s.gate, np.empty((0, 14)))
            return
        if window is None:
            return
        looks = looks_still(s.quiet, window, bias, s.horizon.bias_variance)
        s.agreeing_s = s.agreeing_s + s.chunk_s if looks else 0.0
        if s.agreeing_s >= listening.WINDOW_S:
            # For so long, that the whole last second is one of stillness: it is the first the bias learns from.
            s.agreeing_s = 0.0
            s.gate = entered(window, s.quiet, s.horizon)
            s.quiet = listening.shortened(s.quiet)
            s.settling, s.suspicion = False, Suspicion()
            return
        s.suspicion, taken = after_window(
            s.suspicion,
            s.quiet,
            window,
            bias,
            chunk,
            relearn_s=self._relearn_s,
            may_relearn=s.up_s < WARM_UP_S or s.warmth.changes,
        )
        if taken is not None:
            # What that rate turned meanwhile was the bias: about the vertical it is taken back.
            up = np.array(up_in_body(s.q))
            back = -float(((taken.mean_rad_s - bias) * up).sum()) * taken.duration_s
            s.q = step(s.q, _vector(back * up), 1.0, "exp")
            s.bias_rad_s = _vector(taken.mean_rad_s)
            variance = s.quiet.density2[:3] / taken.duration_s
            s.horizon = s.horizon.restarted(s.q, sqrt(s.horizon.tilt_ms), variance)

    def _leave(self, s: GatedState, gate: Gate, partial: FloatArray) -> None:
        """From still to moving: what the rate of the last seconds turned is turned after all."""
        replay = replayed(gate, s.quiet, partial, s.q, np.array(s.bias_rad_s))
        s.q = step(s.q, replay.turn_rad, 1.0, "exp")
        s.bias_rad_s = _vector(replay.bias)
        s.horizon = s.horizon.restarted(s.q, replay.tilt_rad, replay.bias_variance)
        s.gate = None
        if len(partial):
            s.quiet = listening.interrupted(s.quiet)
        self._empty(s)

    def _interrupt(self, s: GatedState) -> None:
        """Samples are missing: what was collected stands by itself."""
        if s.gate is not None:
            s.horizon = s.horizon.restarted(s.q, sqrt(s.gate.tilt_ms), s.gate.bias_variance)
            s.gate = None
        elif s.rows:
            self._correct(s)
        s.quiet = listening.interrupted(s.quiet)
        s.agreeing_s = 0.0
        self._empty(s)

    def _bridge(self, s: GatedState, rate: Vector, force: Vector, gap_s: float) -> None:
        """The state at the gap's end: the mean of the rates before and after it held, and where it was long the
        accelerometer is the tilt once more."""
        self._interrupt(s)
        s.stuck_s = 0.0
        last = s.rate_rad_s or rate
        bx, by, bz = s.bias_rad_s
        held = (0.5 * (last[0] + rate[0]) - bx, 0.5 * (last[1] + rate[1]) - by, 0.5 * (last[2] + rate[2]) - bz)
        held_s = min(gap_s, HOLD_S)
        s.q = step(s.q, held, held_s, "exp")
        x, y, z = rate[0] - last[0], rate[1] - last[1], rate[2] - last[2]
        unheld = hypot(*held) * (gap_s - held_s)
        cost = 0.25 * (x * x + y * y + z * z) * gap_s * gap_s + unheld * unheld
        h = s.heading
        s.heading = Heading(h.moving_s, h.turned_rad, h.drift_rad, h.gap_ms + cost)
        tilt_ms = s.horizon.tilt_ms + cost
        if gap_s > LONG_GAP_S:
            s.q = levelled(s.q, force)
            s.settling, s.settled_s, tilt_ms = True, 0.0, START_TILT_RAD**2
        s.horizon = s.horizon.restarted(s.q, sqrt(tilt_ms), s.horizon.bias_variance)

    def _sigmas(self, s: GatedState) -> tuple[float, float, float]:
        """One sigma in rad of tilt (about each horizontal axis) and of yaw since it counts from zero."""
        tilt_ms = s.horizon.tilt_ms if s.gate is None else s.gate.tilt_ms
        tilt = sqrt(self._residual.tilt_rad**2 + TILT_FLOOR_RAD**2 + tilt_ms)
        h = s.heading
        scale = self._residual.gyro_scale * h.turned_rad
        yaw = sqrt(GYRO_DENSITY_RAD**2 * h.moving_s + h.drift_rad**2 + scale * scale + h.gap_ms)
        return tilt, tilt, min(yaw, YAW_MAX_RAD)


def _sum(a: Vector, b: Vector) -> Vector:
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


def _vector(a: FloatArray) -> Vector:
    x, y, z = a.tolist()
    return x, y, z
