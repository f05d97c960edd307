"""The live source of raw blocks: a state machine on a clock that never sleeps in the middle of its work.

    PROBE -> RESET -> WAIT_RESET -> WAKE -> CONFIGURE -> START -> STREAM
               ^___________|___________________|  (after 1 s without success, five times at most)

Each call of `read` does what is due and returns. The waits are those of the data sheet and of the
drivers people trust; each stands beside its reason.
"""

from __future__ import annotations

import logging
from collections.abc import Callable
from enum import Enum

from quavelet.bus.protocol import I2CBus
from quavelet.core.blocks import RawBlock
from quavelet.core.clock import Clock
from quavelet.core.errors import BusError, ChipUnstable, DeviceLost
from quavelet.core.health import Health
from quavelet.core.units import NS_PER_MS, NS_PER_S
from quavelet.mpu6050 import registers as r
from quavelet.mpu6050.access import RegisterAccess
from quavelet.mpu6050.config import ChipConfig, configuration_table
from quavelet.mpu6050.decoder import Decoder, empty_raw_block
from quavelet.mpu6050.drain import Drain, Verdict
from quavelet.mpu6050.registers import FRAME_BYTES
from quavelet.mpu6050.stream import StreamInfo, scale_for
from quavelet.mpu6050.variants import MPU6050, identify

RESET_WAIT_NS = 100 * NS_PER_MS
"""RM p. 41: 100 ms after DEVICE_RESET."""
POLL_NS = 10 * NS_PER_MS
"""How often the chip is asked whether it is out of reset."""
PLL_WAIT_NS = 10 * NS_PER_MS
"""PS 6.6: the PLL settles within 10 ms."""
SETTLE_WAIT_NS = 60 * NS_PER_MS
"""PS 6.1: 30 ms for the gyroscope's zero to settle; the kernel's driver allows 60."""
RETRY_NS = 100 * NS_PER_MS
"""How often a configuration that does not hold is written again."""
GIVE_UP_NS = NS_PER_S
"""After this long in one try the chip is reset again."""
MAX_TRIES = 5
"""Resets before the chip is called unstable."""
LOST_NS = 2 * NS_PER_S
"""Without one good drain for this long the chip is called lost: a motor that starts disturbs the wires for less."""
STARVED_NS = NS_PER_S
"""An empty FIFO for this long is a chip that does not sample; at its slowest it takes a sample in 256 ms."""

log = logging.getLogger(__name__)


class Step(Enum):
    """What the source does next."""

    PROBE = "asking who answers"
    RESET = "resetting the chip"
    WAIT_RESET = "waiting for the reset to end"
    WAKE = "waking the chip"
    CONFIGURE = "writing the configuration and reading it back"
    START = "starting the FIFO"
    STREAM = "streaming"


class ChipSource:
    """A `BlockSource` on a live chip.

    on_stream is called with the `StreamInfo` before the first drain, on_drain with every drain: what a
    recording needs. Errors: BusError while the chip is not yet known, WrongChip, ChipUnstable after five
    resets in vain, DeviceLost when it streamed and then did not answer for two seconds, or answers and
    takes no sample.
    """

    def __init__(
        self,
        bus: I2CBus,
        *,
        address: int,
        config: ChipConfig,
        clock: Clock,
        health: Health,
        on_stream: Callable[[StreamInfo], None] | None = None,
        on_drain: Callable[[Drain], None] | None = None,
    ) -> None:
        self._chip = RegisterAccess(bus, address=address)
        self._table = configuration_table(config)
        self._clock = clock
        self._health = health
        self._on_stream = on_stream
        self._on_drain = on_drain
        self._steps: dict[Step, Callable[[], None]] = {
            Step.PROBE: self._probe,
            Step.RESET: self._reset,
            Step.WAIT_RESET: self._wait_reset,
            Step.WAKE: self._wake,
            Step.CONFIGURE: self._configure,
            Step.START: self._start,
        }
        self.step = Step.PROBE
        self.decoder: Decoder | None = None
        self._due_ns = clock.now_ns()
        self._variant = MPU6050
        self._try_since_ns = 0
        self._tries = 0
        self._failing_since_ns: int | None = None
        self._seq = 0
        self._fed_ns = 0
        self._restart_due = False
        self._nothing = empty_raw_block(scale_for(config.gyro_range_dps, config.accel_range_g, variant=MPU6050))

    @property
    def info(self) -> StreamInfo | None:
        """The chip as configured, None until it streams."""
        return self.decoder.info if self.decoder else None

    @property
    def due_ns(self) -> int:
        """When the next step is due; a caller in no hurry may sleep until then."""
        return self._due_ns

    def read(self) -> RawBlock:
        """Do what is due. Gives the samples of one drain, or no rows while the chip is not streaming."""
        while self.step is not Step.STREAM:
            if self._clock.now_ns() < self._due_ns:
                return self._nothing
            self._advance()
        return self._drain(self._streaming_decoder())

    def wait_until_streaming(self) -> StreamInfo:
        """Go through the start-up, sleeping on the clock between the steps."""
        while self.step is not Step.STREAM:
            self._clock.sleep_until_ns(self._due_ns)
            self._advance()
        return self._streaming_decoder().info

    def _advance(self) -> None:
        step = self.step
        try:
            self._steps[step]()
        except BusError as error:
            # Before the chip is known the user must hear at once; later it may be in its reset.
            if step is Step.PROBE:
                raise
            self._health.bus_errors += 1
            log.debug("%s: %s", step.value, error)
            self._again(POLL_NS, error)

    def _go(self, step: Step, wait_ns: int) -> None:
        self.step = step
        self._due_ns = self._clock.now_ns() + wait_ns

    def _again(self, wait_ns: int, reason: object) -> None:
        """The same step later, or a new reset when this try has lasted too long."""
        if self._clock.now_ns() - self._try_since_ns < GIVE_UP_NS:
            self._go(self.step, wait_ns)
        elif self._tries < MAX_TRIES:
            self._health.chip_restarts += 1
            self._new_try()
        else:
            raise ChipUnstable(
                f"the chip at 0x{self._chip.address:02x} did not start in {MAX_TRIES} tries, stuck while "
                f"{self.step.value} ({reason}): check its supply voltage, then power it off and on"
            )

    def _probe(self) -> None:
        # Reading comes before any write: a clock chip at this address must not be written to.
        self._variant = identify(self._chip.read(r.WHO_AM_I), bus=self._chip.bus.name, address=self._chip.address)
        self._new_try()

    def _new_try(self) -> None:
        self._tries += 1
        self._try_since_ns = self._clock.now_ns()
        self._go(Step.RESET, 0)

    def _reset(self) -> None:
        self._chip.write(r.PWR_MGMT_1, r.DEVICE_RESET.mask)
        self._go(Step.WAIT_RESET, RESET_WAIT_NS)

    def _wait_reset(self) -> None:
        # A chip that is still in its reset may answer anything.
        who_am_i = self._chip.read(r.WHO_AM_I)
        if who_am_i != self._variant.who_am_i:
            self._again(POLL_NS, f"WHO_AM_I reads 0x{who_am_i:02x} after reset")
            return
        power = self._chip.read(r.PWR_MGMT_1)
        # SLEEP may come up either way, by the chip's one-time-programmed settings.
        if (power ^ self._variant.pwr_mgmt_1_reset) & ~r.SLEEP.mask & 0xFF:
            self._again(POLL_NS, f"PWR_MGMT_1 reads 0x{power:02x} after reset")
            return
        self._go(Step.WAKE, 0)

    def _wake(self) -> None:
        # Writes to other registers are ignored while the chip sleeps: wake first, on the PLL's clock.
        self._chip.write(r.PWR_MGMT_1, r.CLKSEL.encode(r.CLOCK_PLL_GYRO_X))
        self._go(Step.CONFIGURE, PLL_WAIT_NS)

    def _configure(self) -> None:
        for row in self._table:
            self._chip.apply(row)
        wrong = [row.register.name for row in self._table if not row.holds(self._chip.read(row.register))]
        if wrong:
            self._health.config_mismatches += len(wrong)
            self._again(RETRY_NS, f"{', '.join(wrong)} did not read back as written")
            return
        self._go(Step.START, SETTLE_WAIT_NS)

    def _start(self) -> None:
        info = self._chip.stream_info()
        self._chip.restart_fifo()
        self.decoder = Decoder(info, health=self._health)
        self._fed_ns = self._clock.now_ns()
        if self._on_stream:
            self._on_stream(info)
        self._go(Step.STREAM, 0)

    def _drain(self, decoder: Decoder) -> RawBlock:
        drain = self._read_drain(decoder)
        if self._on_drain:
            self._on_drain(drain)
        block = decoder.decode(drain)
        if decoder.verdict(drain).must_reset:
            self._restart_due = True
            try:
                self._restart_fifo_if_due()
            except BusError as error:
                self._health.bus_errors += 1  # no drain tells of it
                self._fail(error)  # and the next drain begins with the restart
        self._watch(drain)
        return block

    def _watch(self, drain: Drain) -> None:
        """A chip that was without power for a moment sleeps at its power-up values: it answers, and is empty."""
        if self._streaming_decoder().verdict(drain) is not Verdict.EMPTY:
            self._fed_ns = drain.after_ns
        elif drain.after_ns - self._fed_ns > STARVED_NS:
            raise DeviceLost(
                f"the chip at 0x{self._chip.address:02x} on {self._chip.bus.name} answers, but has taken no sample "
                f"for {STARVED_NS / NS_PER_S:g} s: its supply failed for a moment, check it, then start again"
            )

    def _restart_fifo_if_due(self) -> None:
        if self._restart_due:
            self._chip.restart_fifo()
            self._restart_due = False

    def _read_drain(self, decoder: Decoder) -> Drain:
        chip, clock, seq = self._chip, self._clock, self._seq
        self._seq += 1
        before = after = clock.now_ns()
        try:
            self._restart_fifo_if_due()
            status = chip.read(r.INT_STATUS)
            before = clock.now_ns()
            count = chip.fifo_count()
            after = clock.now_ns()
            drain = Drain(seq, before, after, status, count, b"")
            if decoder.verdict(drain) is Verdict.FRAMES:
                # One transaction for all frames: whole ones only, since count is a multiple of a frame.
                assert count % FRAME_BYTES == 0
                drain = Drain(seq, before, after, status, count, chip.read_run(r.FIFO_R_W, count))
        except BusError as error:
            self._fail(error)
            return Drain(seq, before, after, 0, 0, b"", failed=True)
        self._failing_since_ns = None
        return drain

    def _fail(self, error: BusError) -> None:
        now_ns = self._clock.now_ns()
        if self._failing_since_ns is None:
            log.warning("%s", error)  # once an outage
            self._failing_since_ns = now_ns
        if now_ns - self._failing_since_ns > LOST_NS:
            raise DeviceLost(
                f"the chip at 0x{self._chip.address:02x} on {self._chip.bus.name} has not answered for "
                f"{LOST_NS / NS_PER_S:g} s: check power and wiring, then start again"
            ) from error

    def _streaming_decoder(self) -> Decoder:
        assert self.decoder is not None, "STREAM is reached by _start alone, which makes the decoder"
        return self.decoder
