"""Going on from a saved attitude: only where all speaks for it, and else afresh, with the reason told."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from math import hypot

import numpy as np

from quavelet.core.blocks import AttitudeBlock, Flag, FloatArray, ImuBlock, RawBlock, concat
from quavelet.core.units import NS_PER_S, RAD_PER_DEG, STANDARD_GRAVITY_M_S2
from quavelet.pipeline import Pipeline, PipelineState
from quavelet.service.saved_state import NoState, SavedState, unpack_pipeline

RECENT_NS = 30 * NS_PER_S
"""An older state is not gone on from: who knows what became of the board."""
LOOK_NS = NS_PER_S // 2
"""How much of the first samples is looked at; they are held back for so long."""
LOOK_AT_FIELD_NS = NS_PER_S
"""The same where there is a magnetometer, which is heeded only once the filter has settled after the gap."""
SURE = 4.5
"""Sigmas of a mean beyond which it is not chance."""
NOT_WHITE = 2.0
"""Real noise makes means over half a second so many times as uncertain as white noise would."""
TILT_M_S2 = 0.1 * RAD_PER_DEG * STANDARD_GRAVITY_M_S2
RATE_RAD_S = 0.1 * RAD_PER_DEG
"""By so much the mean force and the mean rate of a board that lies as it lay may change in half a minute, besides
noise."""
GYRO_SD_RAD_S, ACCEL_SD_M_S2 = 0.5 * RAD_PER_DEG, 0.020 * STANDARD_GRAVITY_M_S2
"""A louder board moves."""


def refusal(saved: SavedState, *, version: str, boot_id: str, now_ns: int, chip: str, digest: str) -> str:
    """Why a state is not to be gone on from, as far as that can be said before the first sample; "" where it is.

    now_ns is CLOCK_BOOTTIME.
    """
    age_ns = now_ns - saved.boottime_ns
    if saved.version != version:
        return f"it is of quavelet {saved.version[:40]!r}"
    if not boot_id or saved.boot_id != boot_id:
        return "the machine has been started anew since"
    if age_ns < 0:
        return "it is from the future"
    if age_ns > RECENT_NS:
        return f"it is {age_ns / NS_PER_S:.0f} s old, {RECENT_NS // NS_PER_S} s are the most"
    if saved.chip != chip:
        return "it is of another chip"
    if saved.digest != digest:
        return "the settings, the calibration or the program are others now"
    if not saved.still:
        return "the board was moving, or its attitude not yet to be trusted"
    return ""


class Resuming:
    """A stage around the pipeline that holds the first samples back, looks whether the board is still where it was,
    and goes on from the state or afresh.

    judge gives the reason not to, "" for none; it is asked once. asleep_ns is CLOCK_BOOTTIME less CLOCK_MONOTONIC.
    """

    def __init__(
        self,
        pipeline: Pipeline,
        saved: SavedState | None,
        *,
        judge: Callable[[SavedState], str],
        asleep_ns: Callable[[], int],
        talk: Callable[[str], None],
    ) -> None:
        self._pipeline = pipeline
        self._saved = saved
        self._judge = judge
        self._asleep_ns = asleep_ns
        self._talk = talk
        self._held: list[RawBlock] = []
        self._look_ns = LOOK_NS if pipeline.state().heading is None else LOOK_AT_FIELD_NS
        self.resumed = False

    def state(self) -> PipelineState:
        return self._pipeline.state()

    def restore(self, state: PipelineState) -> None:
        self._pipeline.restore(state)

    def process(self, block: RawBlock) -> AttitudeBlock:
        saved = self._saved
        if saved is None or not len(block):
            return self._pipeline.process(block)
        if not self._held and (reason := self._judge(saved)):
            return self._afresh(block, reason)
        self._held.append(block)
        if block.t_ns[-1] - self._held[0].t_ns[0] < self._look_ns:
            return self._pipeline.process(block[:0])
        rows = concat(self._held)
        try:
            return self._resumed(saved, rows)
        except NoState as error:
            return self._afresh(rows, str(error))

    def _resumed(self, saved: SavedState, rows: RawBlock) -> AttitudeBlock:
        """The attitude of the rows, gone on with. Raises NoState, and the pipeline is as it was."""
        check_lies_as_it_lay(saved, self._pipeline.calibrated(rows))
        gap_ns = int(rows.t_ns[0]) + self._asleep_ns() - saved.boottime_ns
        if gap_ns < 0:
            raise NoState("it is from the future")
        fresh = self._pipeline.state()
        try:
            state = unpack_pipeline(saved.pipeline, like=fresh)
            self._pipeline.restore(state)
            with np.errstate(all="raise", under="ignore"):
                attitude = self._pipeline.process(_after_gap(rows, gap_ns))
            _check(attitude, state)
        except (ArithmeticError, AssertionError, AttributeError, LookupError, TypeError, ValueError) as error:
            self._pipeline.restore(fresh)
            raise NoState("what is in it does not fit") from error
        except NoState:
            self._pipeline.restore(fresh)
            raise
        self._saved, self._held, self.resumed = None, [], True
        self._talk(
            f"the attitude goes on from where it was {gap_ns / NS_PER_S:.1f} s before the first sample"
            + ("" if state.heading else "; had the board been turned about the vertical since, nothing would show it")
        )
        return attitude

    def _afresh(self, rows: RawBlock, reason: str) -> AttitudeBlock:
        self._saved, self._held = None, []
        self._talk(f"the attitude begins afresh, its state file is not used: {reason}")
        return self._pipeline.process(rows)


def check_lies_as_it_lay(saved: SavedState, rows: ImuBlock) -> None:
    """Raises NoState where the board moves, or no longer lies as it did."""
    if (rows.flags & (Flag.GAP | Flag.STUCK | Flag.IMPLAUSIBLE)).any():
        raise NoState("the first samples are doubtful")
    n = len(rows)
    force, rate = rows.accel_m_s2, rows.gyro_rad_s + rows.gyro_bias_rad_s
    if (force.std(axis=0) > ACCEL_SD_M_S2).any() or (rate.std(axis=0) > GYRO_SD_RAD_S).any():
        raise NoState("the board moves")
    if _differs(force, saved.force_m_s2, TILT_M_S2, n) or _differs(rate, saved.rate_rad_s, RATE_RAD_S, n):
        raise NoState("the board does not lie as it lay")


def _differs(rows: FloatArray, before: tuple[float, float, float], allowed: float, n: int) -> bool:
    sigma = NOT_WHITE * rows.std(axis=0) / n**0.5
    limit = [hypot(allowed, SURE * s) for s in sigma.tolist()]
    change = np.abs(rows.mean(axis=0) - np.array(before))
    # Not "greater": a NaN differs too.
    return not bool((change <= limit).all())


def _after_gap(rows: RawBlock, gap_ns: int) -> RawBlock:
    flags, gaps = rows.flags.copy(), rows.gap_ns.copy()
    flags[0] |= Flag.GAP
    gaps[0] += gap_ns
    return replace(rows, flags=flags, gap_ns=gaps)


def _check(attitude: AttitudeBlock, state: PipelineState) -> None:
    """Raises NoState where that is no attitude, or not the one that the magnetometer shows."""
    finite = all(np.isfinite(rows).all() for rows in (attitude.q, attitude.sigma_rad, attitude.gyro_bias_rad_s))
    unit = np.abs((attitude.q**2).sum(axis=1) - 1.0) < 1e-6
    if not finite or not unit.all():
        raise NoState("what is in it is no attitude")
    if (attitude.flags & Flag.FIELD_DISTURBED).any() and not (state.heading and state.heading.disturbed):
        # Turned about the vertical, as no other sensor shows; or iron has come near, which looks the same.
        raise NoState("the magnetic field is not as it was")
