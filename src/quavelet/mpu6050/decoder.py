"""Drains to raw blocks: frames, times, and the gaps between them. Live and replay run the same decoder."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from quavelet.core.blocks import CountArray, Flag, FlagArray, RawBlock, Scale
from quavelet.core.health import Health
from quavelet.core.units import NS_PER_S
from quavelet.mpu6050.drain import Drain, Loss, Verdict, judge
from quavelet.mpu6050.magnetometer.field import FieldDecoder, FieldState
from quavelet.mpu6050.magnetometer.fifo_frames import split_frames
from quavelet.mpu6050.plausible import SAME_FRAMES, SAME_NS, first_implausible, same_as_before
from quavelet.mpu6050.pulses import Pulses, PulseState
from quavelet.mpu6050.registers import FRAME_BYTES
from quavelet.mpu6050.spikes import SpikeRule, SpikeState, spike_bounds
from quavelet.mpu6050.stream import StreamInfo
from quavelet.mpu6050.timebase import TimeBase, TimeBaseState

_REASON: dict[Verdict, Flag] = {
    Verdict.OVERFLOW: Flag.GAP | Flag.OVERFLOW,
    Verdict.NEAR_FULL: Flag.GAP | Flag.OVERFLOW,
    Verdict.MISALIGNED: Flag.GAP | Flag.MISALIGNED,
}
_LOSS: dict[Loss, Flag] = {
    Loss.TRANSFER: Flag.GAP | Flag.BUS_ERROR,
    Loss.CHIP_RESET: Flag.GAP | Flag.CHIP_UPSET,
    Loss.UPSET: Flag.GAP | Flag.CHIP_UPSET,
    Loss.STARVED: Flag.GAP | Flag.CHIP_UPSET,
}
CLOSE_PERIODS = 0.15
_INT16_ENDS = (-32768, 32767)


@dataclass(frozen=True, slots=True)
class DecoderState:
    """All memory: the time base, how many samples the chip took, and a gap that waits for its end.

    taken        samples the chip has taken, those lost included
    last_ns      time of the last sample given out, -1 before the first
    pending      flags for the first sample after the gap, 0 where there is no gap
    next_seq     the drain number expected next
    doubtful     `taken` was reckoned after a gap by a count whose moment was vague; the next clear one sets it right
    last_frame   the words of the last frame that was timed, empty before the first
    alike        how many frames before it, one after the other, stood as it does on all six axes
    spikes       what the rule on samples that stand alone remembers
    pulses       which sample a pulse of the data-ready line belongs to
    field        what is known of the magnetometer
    """

    timebase: TimeBaseState
    taken: int = 0
    last_ns: int = -1
    pending: int = 0
    next_seq: int = 0
    doubtful: bool = False
    last_frame: tuple[int, ...] = ()
    alike: int = 0
    spikes: SpikeState = SpikeState()
    pulses: PulseState = PulseState()
    field: FieldState = FieldState()


class Decoder:
    """Turns each `Drain` of one stream into a `RawBlock`, possibly empty.

    must_restart  what is in the FIFO after the last drain is of no use: it has to be emptied
    """

    def __init__(self, info: StreamInfo, *, health: Health) -> None:
        self.info = info
        self.must_restart = False
        self._scale = info.scale
        self._fifo_bytes = info.variant.fifo_bytes
        self._frame_bytes = info.frame_bytes
        self._health = health
        self._timebase = TimeBase(nominal_period_s=info.nominal_period_s)
        self._pulses = Pulses(self._timebase, health=health)
        self._stuck_after = max(SAME_FRAMES, round(SAME_NS / self._timebase.nominal_ns))
        self._spikes = SpikeRule(spike_bounds(info), health=health)
        self._field = FieldDecoder(info, health=health) if info.magnetometer else None
        self._s = DecoderState(timebase=self._timebase.state())

    def state(self) -> DecoderState:
        return replace(
            self._s,
            timebase=self._timebase.state(),
            spikes=self._spikes.state(),
            pulses=self._pulses.state(),
            field=self._field.state() if self._field else FieldState(),
        )

    def restore(self, state: DecoderState) -> None:
        self._s = state
        self._spikes.restore(state.spikes)
        self._timebase.restore(state.timebase)
        self._pulses.restore(state.pulses)
        if self._field:
            self._field.restore(state.field)

    @property
    def measured_rate_hz(self) -> float | None:
        """The chip's sample rate by the host's clock, None until it is measured."""
        return 1.0 / self._timebase.period_s if self._timebase.sure else None

    @property
    def stuck_s(self) -> float:
        """For how long no axis has changed, if that is so long that the chip is taken to be stuck; else 0."""
        alike = self._s.alike
        return alike * self._timebase.period_s if alike >= self._stuck_after else 0.0

    @property
    def field_lost(self) -> bool:
        """Whether there is a magnetometer and it gives nothing, or not what it was told."""
        return self._field is not None and self._field.lost

    def verdict(self, drain: Drain) -> Verdict:
        """What this drain says about the FIFO."""
        if drain.loss:
            return Verdict.LOST
        return judge(drain.int_status, drain.fifo_count, fifo_bytes=self._fifo_bytes, frame_bytes=self._frame_bytes)

    def decode(self, drain: Drain) -> RawBlock:
        """The samples of this drain, timed and flagged."""
        if drain.seq != self._s.next_seq:
            # A recording lost drains here, and with them an unknown number of samples.
            self._s = replace(self._s, pending=self._s.pending | Flag.GAP)
        self._s = replace(self._s, next_seq=drain.seq + 1)
        verdict = self.verdict(drain)
        self._count(verdict)
        self.must_restart = verdict.must_reset
        if verdict.must_reset:
            self._s = replace(self._s, pending=self._s.pending | (_LOSS.get(drain.loss) or _REASON[verdict]))
        self._pulses.hear(drain.edges, gap=bool(self._s.pending))
        if verdict is Verdict.EMPTY and self._timebase.started and not (self._s.pending or self._s.doubtful):
            vanished = self._observe(self._s.taken, drain)
            self._s = replace(self._s, pending=int(Flag.GAP) if vanished else 0)
        if verdict is not Verdict.FRAMES:
            return empty_raw_block(self._scale)
        if self.info.data_ready:
            self._pulses.expect(drain.after_ns)
        if self._surprising(drain):
            self._health.counts_surprising += 1
            self._throw_away(Flag.CHIP_UPSET)
            return empty_raw_block(self._scale)
        counts, external = split_frames(drain.data, external_bytes=self._frame_bytes - FRAME_BYTES)
        # After a gap the temperature has nothing to compare with: a chip with a wrong one would be stopped for ever.
        known = bool(self._s.last_frame) and not self._s.pending
        good = first_implausible(counts, temp_before=self._s.last_frame[3] if known else None)
        if good < len(counts):
            good = max(0, good - 1)  # what spoilt a temperature may have begun behind that of the frame before
        block = self._timed(counts[:good], drain, whole=good == len(counts)) if good else empty_raw_block(self._scale)
        if good < len(counts):
            self._health.frames_implausible += len(counts) - good
            self._throw_away(Flag.IMPLAUSIBLE)
        if self._field and good:
            field_ut, doubt = self._field.decode(external[:good])
            block = replace(block, field_ut=field_ut, flags=block.flags | doubt)
        block = self._spikes.process(block)
        self._health.samples += len(block)
        return block

    def _surprising(self, drain: Drain) -> bool:
        """Whether the chip has taken so many or so few samples that its rate must have been changed."""
        s, base = self._s, self._timebase
        if s.pending or s.doubtful or not base.started or base.is_slow(drain.before_ns, drain.after_ns):
            return False
        return base.surprising(s.taken + drain.fifo_count // self._frame_bytes, drain.before_ns, drain.after_ns)

    def _throw_away(self, reason: Flag) -> None:
        self._health.fifo_resets += 1
        self._s = replace(self._s, pending=self._s.pending | Flag.GAP | reason)
        self.must_restart = True

    def _timed(self, counts: CountArray, drain: Drain, *, whole: bool) -> RawBlock:
        s, base, n = self._s, self._timebase, len(counts)
        flags = clip_flags(counts)
        gap_ns = np.zeros(n, dtype=np.int64)
        taken = s.taken
        reckoned = base.number_at((drain.before_ns + drain.after_ns) // 2) if base.started else 0.5
        # Close to the moment of a sample nobody knows whether it had been taken.
        close = abs(reckoned - round(reckoned)) < CLOSE_PERIODS
        slow = base.is_slow(drain.before_ns, drain.after_ns)
        vague = close or slow or not whole
        doubtful = vague and (s.doubtful or bool(s.pending))
        if base.started and (s.pending or (s.doubtful and not vague)):
            waiting = drain.fifo_count // self._frame_bytes
            missing = int(reckoned) - (taken + waiting)
            lost = max(0, missing) if s.pending else missing
            taken += lost
            self._health.samples_lost += lost
            if s.pending:
                gap_ns[0] = round(lost * base.period_s * NS_PER_S)
        if s.pending:
            flags[0] |= s.pending
            self._health.gaps += 1
        first = taken + 1
        taken += n
        # Of a drain believed in part the count holds samples that are not in `taken` yet.
        vanished = whole and (slow or not doubtful) and self._observe(taken, drain)
        if whole and not slow and doubtful and self._pulses.match(taken, drain):
            doubtful = False
        if not base.sure:
            flags |= np.uint32(Flag.CLOCK_UNSURE)
        alike = self._flag_stuck(counts, flags)
        # A new fit may move the line back by less than a period; times stay strictly increasing.
        start_ns = max(base.time_ns(first), s.last_ns + 1)
        step_ns = max(base.period_s * NS_PER_S, 1.0)
        t_ns = start_ns + np.round(np.arange(n) * step_ns).astype(np.int64)
        self._s = replace(
            s,
            taken=taken,
            last_ns=int(t_ns[-1]),
            pending=int(Flag.GAP) if vanished else 0,
            doubtful=doubtful,
            last_frame=tuple(counts[-1].tolist()),
            alike=alike,
        )
        return RawBlock(
            t_ns=t_ns,
            period_s=np.full(n, base.period_s),
            gap_ns=gap_ns,
            flags=flags,
            counts=counts,
            scale=self._scale,
        )

    def _flag_stuck(self, counts: CountArray, flags: FlagArray) -> int:
        """Flag the frames from which on the chip is taken to be stuck; how many were alike up to the last one."""
        alike = self._s.alike
        for row, same in enumerate(same_as_before(counts, self._s.last_frame)):
            alike = alike + 1 if same else 0
            if alike >= self._stuck_after:
                flags[row] |= np.uint32(Flag.STUCK)
                self._health.stuck += alike == self._stuck_after
        return alike

    def _observe(self, taken: int, drain: Drain) -> bool:
        """Tell the time base what was counted, unless nobody knows when. Whether frames have vanished from the FIFO."""
        if self._timebase.is_slow(drain.before_ns, drain.after_ns):
            self._health.slow_queries += 1
        elif self._pulses.in_use:
            self._timebase.note_query(drain.before_ns, drain.after_ns)
            return self._pulses.vanished(taken, drain)
        else:
            if not self._timebase.observe(taken, drain.before_ns, drain.after_ns):
                self._health.rate_out_of_bounds += 1
            self._pulses.match(taken, drain)
        return False

    def _count(self, verdict: Verdict) -> None:
        health = self._health
        health.drains += 1
        health.fifo_empty += verdict is Verdict.EMPTY
        health.fifo_overflows += verdict is Verdict.OVERFLOW
        health.fifo_near_full += verdict is Verdict.NEAR_FULL
        health.fifo_misaligned += verdict is Verdict.MISALIGNED
        health.fifo_resets += verdict.must_reset


def clip_flags(counts: CountArray) -> FlagArray:
    """Flags (N,) of samples that stand at the end of a range; counts as in `RawBlock`."""
    at_end = (counts == _INT16_ENDS[0]) | (counts == _INT16_ENDS[1])
    accel = at_end[:, 0:3].any(axis=1)
    gyro = at_end[:, 4:7].any(axis=1)
    flags: FlagArray = accel * np.uint32(Flag.ACCEL_CLIPPED) | gyro * np.uint32(Flag.GYRO_CLIPPED)
    return flags


def empty_raw_block(scale: Scale) -> RawBlock:
    """A block of no rows."""
    return RawBlock(
        t_ns=np.zeros(0, dtype=np.int64),
        period_s=np.zeros(0),
        gap_ns=np.zeros(0, dtype=np.int64),
        flags=np.zeros(0, dtype=np.uint32),
        counts=np.zeros((0, FRAME_BYTES // 2), dtype=np.int16),
        scale=scale,
    )
