"""The live source of raw blocks: it starts the chip, drains it, and brings it back from every trouble it can."""

from __future__ import annotations

import logging
from collections.abc import Callable
from dataclasses import replace

from quavelet.bus.protocol import DataReady, Edge, I2CBus
from quavelet.core.blocks import RawBlock
from quavelet.core.clock import Clock
from quavelet.core.errors import BusError, DeviceLost
from quavelet.core.health import Health
from quavelet.core.units import NS_PER_MS, NS_PER_S
from quavelet.mpu6050.access import RegisterAccess
from quavelet.mpu6050.config import ChipConfig
from quavelet.mpu6050.decoder import Decoder, empty_raw_block
from quavelet.mpu6050.drain import Drain, Loss, Verdict
from quavelet.mpu6050.magnetometer.asked import MagnetometerParams
from quavelet.mpu6050.offset_plan import OffsetPlan
from quavelet.mpu6050.registers import FIFO_OFLOW_INT, INT_STATUS
from quavelet.mpu6050.startup import StartUp, Step
from quavelet.mpu6050.stream import StreamInfo, scale_for
from quavelet.mpu6050.timebase import BOUND
from quavelet.mpu6050.variants import MPU6050, Variant
from quavelet.mpu6050.watch import Finding, RegisterWatch

MAX_FAILURES = 10
"""Drains that may fail, less those that succeed, before the chip is reset (as PX4's driver has it)."""
FAILURE_NS = 10 * NS_PER_MS
"""A loop that is faster than this counts no more failures."""
STARVED_NS = 100 * NS_PER_MS
"""No sample for so long, or for two periods where that is longer: the FIFO is started anew; for half as long, and the
registers are looked at; for twice as long, and the chip is reset."""
STUCK_S = 1.0
"""A chip whose axes do not change for so long is reset, once."""
MOST_EDGES = 1024
"""Of one drain; a wire that picks up noise can give any number."""
LOST_S = 10.0
"""Without a good drain for this long the device is lost: plugs are put back in less."""

log = logging.getLogger(__name__)


class ChipSource:
    """A `BlockSource` on a live chip.

    line is the wire from the chip's INT pin: with it the times of samples are those of its pulses, and without them,
    should it fail, those that follow from counts.
    What is to stand in the chip's offset registers is given, or found (`StartUp`), and written after every reset.
    on_stream is called with the `StreamInfo` before the first drain, on_drain with every drain: what a
    recording needs. Errors: BusError while the chip is not yet known, WrongChip, ChipUnstable where it does not
    start, DeviceLost when it streamed and then gave nothing of use for `lost_s`, or was exchanged for another.
    """

    def __init__(
        self,
        bus: I2CBus,
        *,
        address: int,
        config: ChipConfig,
        clock: Clock,
        health: Health,
        lost_s: float = LOST_S,
        accept_id: int = 0,
        offsets: OffsetPlan | None = None,
        find_offsets: Callable[[Variant], OffsetPlan | None] | None = None,
        line: DataReady | None = None,
        magnetometer: MagnetometerParams | None = None,
        on_stream: Callable[[StreamInfo], None] | None = None,
        on_drain: Callable[[Drain], None] | None = None,
    ) -> None:
        self._chip = RegisterAccess(bus, address=address, clock=clock, health=health)
        self._clock = clock
        self._health = health
        self._lost_ns = round(lost_s * NS_PER_S)
        self._on_stream = on_stream
        self._on_drain = on_drain
        self._line = line
        self._line_failed = False
        self._start_up = StartUp(
            self._chip,
            config,
            clock=clock,
            health=health,
            accept_id=accept_id,
            offsets=offsets,
            find_offsets=find_offsets,
            data_ready=line is not None,
            magnetometer=magnetometer,
        )
        self._watch: RegisterWatch | None = None
        self.decoder: Decoder | None = None
        self._seq = 0
        self._failures = 0
        self._counted_ns = 0
        self._good_ns = 0
        self._fed_ns = 0
        self._asked_why = False
        self._starved_once = False
        self._stuck_tried = False
        self._restart_due = False
        self._check_due = False
        self._disturbed: BusError | None = None
        self._trouble: BusError | str = ""
        self._nothing = empty_raw_block(scale_for(config.gyro_range_dps, config.accel_range_g, variant=MPU6050))

    @property
    def info(self) -> StreamInfo | None:
        """The chip as configured, None until it streams."""
        return self._start_up.info

    @property
    def step(self) -> Step:
        """What is done next."""
        return self._start_up.step

    @property
    def due_ns(self) -> int:
        """When the next step is due; a caller in no hurry may sleep until then."""
        return self._start_up.due_ns

    def read(self) -> RawBlock:
        """Do what is due. Gives the samples of one drain, or no rows while the chip is not streaming."""
        while not self._start_up.streaming:
            if self._clock.now_ns() < self.due_ns:
                return self._nothing
            self._advance()
        drain = self._drain()
        return self._nothing if drain is None else self._taken_in(drain)

    def wait_until_streaming(self) -> StreamInfo:
        """Go through the start-up, sleeping on the clock between the steps."""
        while not self._start_up.streaming:
            self._clock.sleep_until_ns(self.due_ns)
            self._advance()
        assert self.info is not None, "a chip that streams is known"
        return self.info

    def _advance(self) -> None:
        self._start_up.advance()
        if self._start_up.streaming:
            self._begin_stream()
        elif self.decoder is not None:
            self._lose_if_late(self._start_up.reason or self._trouble)

    def _begin_stream(self) -> None:
        info, now_ns = self._start_up.info, self._clock.now_ns()
        assert info is not None, "a chip that streams is known"
        self._watch = RegisterWatch(
            self._chip,
            self._start_up.table,
            who_am_i=info.who_am_i,
            since_ns=now_ns,
            health=self._health,
            slaves=info.slaves,
        )
        self._fed_ns, self._failures, self._restart_due = now_ns, 0, False
        self._asked_why = self._starved_once = False
        # A chip that was brought back goes on in the same stream: its samples are numbered on over the gap.
        if self.decoder is None or self.decoder.info != info:
            self.decoder = Decoder(info, health=self._health)
            self._good_ns = now_ns
            self._nothing = empty_raw_block(info.scale)
            if self._on_stream:
                self._on_stream(info)

    def _drain(self) -> Drain | None:
        """One look at the chip; None where a transfer failed that took nothing with it."""
        if self._failures > MAX_FAILURES:
            self._health.outages += 1
            return self._bring_back(self._disturbed or "what is read from it cannot be")
        try:
            return self._looked()
        except BusError as error:
            self._fail(error)
            return None

    def _looked(self) -> Drain:
        assert self.decoder is not None and self._watch is not None, "made by _begin_stream"
        chip, clock, decoder = self._chip, self._clock, self.decoder
        if self._restart_due:
            chip.restart_fifo(slaves=decoder.info.slaves)
            self._restart_due = False
        if self._watch.due(clock.now_ns()) or self._check_due:
            finding = self._watch.check_all() if self._check_due else self._watch.check_some(clock.now_ns())
            self._check_due = False
            if finding is not Finding.GOOD:
                return self._mend(finding)
        self._start_up.magnetometer.tend(lost=decoder.field_lost)
        status = chip.read(INT_STATUS)
        before, count, after = self._counted()
        drain = self._new_drain(before, after, status, count)
        if decoder.verdict(drain) is Verdict.MISALIGNED:
            # Perhaps the count was disturbed on its way: another look costs less than the FIFO.
            before, count, after = self._counted()
            drain = self._new_drain(before, after, status, count)
        if decoder.verdict(drain) is Verdict.EMPTY:
            return self._hungry(drain)
        if decoder.verdict(drain) is Verdict.FRAMES:
            return self._with_frames(drain)
        return drain

    def _with_frames(self, drain: Drain) -> Drain:
        # One transaction for all frames: whole ones only, since the count is a multiple of a frame.
        assert self.info is not None, "a chip that streams is known"
        assert drain.fifo_count % self.info.frame_bytes == 0
        try:
            data = self._chip.read_fifo(drain.fifo_count)
            status = drain.int_status | self._overflow_since(drain)
        except BusError as error:
            self._fail(error)
            return self._lost(Loss.TRANSFER)
        if status & FIFO_OFLOW_INT.mask:
            data = b""
        return replace(drain, int_status=status, data=data)

    def _overflow_since(self, drain: Drain) -> int:
        """INT_STATUS once more where the FIFO had the time to overflow after the count, with the host busy elsewhere:
        frames read after that are torn."""
        assert self.info is not None, "a chip that streams is known"
        room = self.info.variant.fifo_bytes - drain.fifo_count
        shortest_ns = self.info.nominal_period_s * NS_PER_S * (1.0 - BOUND)
        new = 1 + (self._clock.now_ns() - drain.before_ns) / shortest_ns
        return self._chip.read(INT_STATUS) if new * self.info.frame_bytes >= room else 0

    def _counted(self) -> tuple[int, int, int]:
        before = self._clock.now_ns()
        count = self._chip.fifo_count()
        return before, count, self._clock.now_ns()

    def _mend(self, finding: Finding) -> Drain:
        if finding is Finding.RESET:
            return self._bring_back("its registers have changed")
        return self._lost(Loss.UPSET)

    def _hungry(self, drain: Drain) -> Drain:
        """An empty FIFO, which is a sign of trouble if it lasts."""
        assert self.info is not None and self._watch is not None, "made by _begin_stream"
        patience_ns = max(STARVED_NS, round(2 * self.info.nominal_period_s * NS_PER_S))
        empty_ns = drain.after_ns - self._fed_ns
        if empty_ns > 2 * patience_ns:
            return self._bring_back(f"it has taken no sample for {empty_ns / NS_PER_S:.1f} s")
        if empty_ns > patience_ns // 2 and not self._asked_why:
            self._asked_why = True
            finding = self._watch.check_all()
            return drain if finding is Finding.GOOD else self._mend(finding)
        if empty_ns > patience_ns and not self._starved_once:
            self._starved_once = True
            self._health.starved += 1
            finding = self._watch.check_all()
            return self._lost(Loss.STARVED) if finding is Finding.GOOD else self._mend(finding)
        return drain

    def _taken_in(self, drain: Drain) -> RawBlock:
        assert self.decoder is not None, "made by _begin_stream"
        self._seq += 1
        if self._line is not None:
            drain = replace(drain, edges=self._edges(self._line))
        if self._on_drain:
            self._on_drain(drain)
        block = self.decoder.decode(drain)
        if not self.decoder.must_restart:
            self._succeed(drain)
        elif self._start_up.streaming:
            self._restart(drain)
        return block

    def _edges(self, line: DataReady) -> tuple[Edge, ...]:
        """The pulses since the last look. A line that fails must not stop the stream, which goes on without."""
        try:
            edges = line.wait(0.0)
        except BusError as error:
            if not self._line_failed:
                log.warning("%s; until then samples are timed by counts", error)
            self._line_failed = True
            return ()
        self._line_failed = False
        return tuple(edges[-MOST_EDGES:])

    def _restart(self, drain: Drain) -> None:
        """The FIFO holds nothing of use: empty it, now or, where that fails, at the next drain."""
        assert self.decoder is not None, "made by _begin_stream"
        verdict = self.decoder.verdict(drain)
        if verdict in (Verdict.OVERFLOW, Verdict.NEAR_FULL):
            self._good_ns = drain.after_ns  # the chip does its work, the host was late
        elif verdict is not Verdict.LOST:
            self._count_failure()
        if drain.loss is not Loss.STARVED:
            self._fed_ns = drain.after_ns
        self._restart_due = self._check_due = True
        try:
            self._chip.restart_fifo(slaves=self.decoder.info.slaves)
            self._restart_due = False
        except BusError as error:
            self._fail(error)

    def _succeed(self, drain: Drain) -> None:
        assert self.decoder is not None, "made by _begin_stream"
        self._failures = max(0, self._failures - 1)
        self._disturbed = None
        if drain.fifo_count:
            self._good_ns = self._fed_ns = drain.after_ns
            self._asked_why = self._starved_once = False
        else:
            self._lose_if_late("it has taken no sample, its supply may have failed for a moment")
        stuck_s = self.decoder.stuck_s
        if stuck_s > STUCK_S and not self._stuck_tried:
            self._stuck_tried = True
            lost = self._bring_back(f"no axis has changed for {stuck_s:.1f} s")
            self._taken_in(lost)
        elif not stuck_s:
            self._stuck_tried = False

    def _fail(self, error: BusError) -> None:
        if self._disturbed is None:
            log.warning("%s", error)  # once an outage
        self._disturbed = error
        self._count_failure()
        self._lose_if_late(error)

    def _count_failure(self) -> None:
        now_ns = self._clock.now_ns()
        if now_ns - self._counted_ns >= FAILURE_NS:
            self._counted_ns = now_ns
            self._failures += 1

    def _bring_back(self, reason: BusError | str) -> Drain:
        log.warning("the chip at 0x%02x is reset: %s", self._chip.address, reason)
        self._trouble = reason
        self._start_up.begin_again()
        return self._lost(Loss.CHIP_RESET)

    def _lose_if_late(self, reason: BusError | str) -> None:
        silent_ns = self._clock.now_ns() - self._good_ns
        if silent_ns > self._lost_ns:
            raise DeviceLost(
                f"the chip at 0x{self._chip.address:02x} on {self._chip.bus.name} has given nothing for "
                f"{silent_ns / NS_PER_S:.0f} s: check power and wiring, then start again ({reason})"
            ) from (reason if isinstance(reason, BusError) else None)

    def _lost(self, loss: Loss) -> Drain:
        now_ns = self._clock.now_ns()
        return self._new_drain(now_ns, now_ns, 0, 0, loss=loss)

    def _new_drain(
        self, before_ns: int, after_ns: int, status: int, count: int, data: bytes = b"", *, loss: Loss = Loss.NONE
    ) -> Drain:
        return Drain(self._seq, before_ns, after_ns, status, count, data, loss)
