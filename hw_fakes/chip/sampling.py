"""How the chip takes samples: when, by which oscillator, and where they show."""

from __future__ import annotations

from collections.abc import Callable

from hw_fakes.chip import registers as reg
from hw_fakes.chip.aux_master import AuxMaster
from hw_fakes.chip.fifo import Fifo
from hw_fakes.chip.interrupt import IntPin
from hw_fakes.chip.motion_detection import Detection, Event, Rules
from hw_fakes.chip.personalities import Personality
from hw_fakes.chip.prefetch import NO_DATA, Prefetch
from hw_fakes.chip.samples import CountArray, Run, SampleSource
from hw_fakes.chip.setup import Setup, decode
from quavelet.core.units import NS_PER_S

# The registers that say what to do: those of results, status, FIFO and DMP memory between them are left out.
_CONFIGURATION = ((0x00, 0x35), (reg.INT_PIN_CFG, reg.DMP_INT_STATUS), (0x62, 0x6D), (0x76, reg.COUNT))

# Of samples that nobody saw fall, the auxiliary master does the transactions of so many, the newest; older ones could
# show only in how far the chips on its bus have come.
_AUX_SAMPLES = 128


class Sampling:
    """Samples by the configuration registers, into the sensor registers, the FIFO, the status and the INT pin.

    A sample falls at its exact time but is computed only when someone can see it.

    run            the present stretch of even sampling; None while the chip does not sample
    samples_taken  since construction, as of the last `advance`
    past_end       a sample was due that the source does not have any more
    """

    def __init__(
        self,
        registers: bytearray,
        source: SampleSource,
        *,
        fifo: Fifo,
        pin: IntPin,
        personality: Personality,
        pll_error: float,
        internal_error: float,
        rules: Rules,
        aux: AuxMaster | None,
    ) -> None:
        self.run: Run | None = None
        self.samples_taken = 0
        self.past_end = False
        self._registers = registers
        self._source = source
        self._fifo = fifo
        self._pin = pin
        self._personality = personality
        self._pll_error = pll_error
        self._internal_error = internal_error
        self._setup = decode(reg.POWER_UP)
        self._configured = b""
        self._prefetch = Prefetch(source)
        self._detection = Detection(source, rules)
        self._aux = aux
        self._shadow: bytes | None = NO_DATA  # None: the newest sample, not looked at yet
        self._runs = 0
        self._taken = 0  # of the samples of this run
        self._fifo_begun = False

    def follow(self, t_ns: int) -> None:
        """Obey the configuration registers, which have been as they are since `t_ns`."""
        self._pin.follow(self._registers, t_ns)
        configured = b"".join(self._registers[first:end] for first, end in _CONFIGURATION)
        if configured == self._configured:
            return
        self._configured = configured
        self._fifo.resize(self._personality.fifo_size(self._registers))
        self._fifo.stops = self._personality.fifo_stops(self._registers)
        setup = decode(self._registers, personality=self._personality)
        if setup != self._setup:
            self._adopt(setup, t_ns)
        self._detection.follow(self._registers, self.run, setup, t_ns)
        if self._aux:
            self._aux.follow(self._registers)

    def _adopt(self, setup: Setup, t_ns: int) -> None:
        self.newest()  # shows what it was taken with
        before, self._setup = self._setup, setup
        self._prefetch.clear()
        if not setup.awake:
            self.run, self._shadow = None, NO_DATA
        elif self.run is None or _timing(before) != _timing(setup):
            self.run = self._new_run(setup, t_ns)
            self._taken = 0
        if setup.frozen != before.frozen:
            self._prefetch.held = self.newest()
        if setup.fifo_words and not self._fifo_begun and self.run:
            self._fifo_begun = True
            self._source.fifo_begins(self.run, self._taken)

    def advance(self, now_ns: int) -> None:
        """Take the samples that have fallen by `now_ns`."""
        if self.run is None:
            self.past_end = False
            return
        due, limit = self.run.samples_by(now_ns), self._source.limit(self.run)
        self.past_end = limit is not None and due > limit
        if limit is not None:
            due = min(due, limit)
        for event in self._detection.events(now_ns):
            self._detected(self.run, event, due)
        if due > self._taken:
            self._take(self.run, due)

    def newest(self) -> bytes:
        """The 14 sensor bytes of the newest sample."""
        if self._shadow is None and self.run is not None:
            self._shadow = self._prefetch.sample(self.run, self._setup, self._taken - 1)
        return self._shadow or NO_DATA

    def recompute(self) -> None:
        """Samples computed ahead are forgotten: the source has changed."""
        self._prefetch.clear()
        self._detection.forget()
        self._source.forget()

    @property
    def spoil(self) -> Callable[[CountArray], CountArray] | None:
        """What makes of samples' words those that show."""
        return self._prefetch.spoil

    @spoil.setter
    def spoil(self, spoil: Callable[[CountArray], CountArray] | None) -> None:
        self._prefetch.spoil = spoil

    def restart_detection(self) -> None:
        """The accelerometer's signal path is reset."""
        self._detection.restart()

    def blank(self) -> None:
        """The sensor registers are cleared, until the next sample."""
        self._shadow = NO_DATA
        self._registers[reg.EXT_SENS_DATA : reg.MOT_DETECT_STATUS] = bytes(24)

    def switch_off(self) -> None:
        """There is no supply: nothing is sampled, and nothing is shown."""
        self._setup = decode(reg.POWER_UP)
        self._detection.restart()
        self.run, self._shadow, self._configured = None, NO_DATA, b""

    def _detected(self, run: Run, event: Event, due: int) -> None:
        fallen = min(due, event.ticks // run.divider)
        if fallen > self._taken and self._registers[reg.INT_ENABLE] & event.interrupt:
            self._take(run, fallen)  # so that the pin moves in the order of time
        self._registers[reg.INT_STATUS] |= event.interrupt
        self._registers[reg.MOT_DETECT_STATUS] |= event.status
        if event.at_rest is not None:
            self._registers[reg.MOT_DETECT_STATUS] &= ~reg.AT_REST & 0xFF
            self._registers[reg.MOT_DETECT_STATUS] |= event.at_rest
        self._pin.happened(event.interrupt, run.time_ns(event.ticks))

    def _take(self, run: Run, due: int) -> None:
        first, self._taken = self._taken, due
        self.samples_taken += due - first
        self._shadow = None
        # Both bits are set whether or not INT_ENABLE lets them out to the pin.
        self._registers[reg.INT_STATUS] |= reg.DATA_RDY_INT
        frame = self._frame_bytes()
        # Of more samples than the FIFO holds only the newest can be seen, or where it stops, only the oldest; but one
        # more, so that it overflows.
        seen = min(due - first, self._fifo.size // frame + 1) if frame else 0
        begin = first if self._fifo.stops else due - seen
        overflow = first + (self._fifo.size - len(self._fifo)) // frame if frame else due
        external, alarms = self._external(run, first, due, range(begin, begin + seen))
        if frame and self._fifo.push(self._frames(run, begin, begin + seen, external)):
            self._registers[reg.INT_STATUS] |= reg.FIFO_OFLOW_INT
        for n in alarms:
            self._pin.sampled(run, first, n + 1, overflow)
            self._pin.happened(reg.I2C_MST_INT, run.time_ns((n + 1) * run.divider))
            first = n + 1
        self._pin.sampled(run, first, due, overflow)

    def _frame_bytes(self) -> int:
        """What a sample puts into the FIFO."""
        words = 2 * len(self._setup.fifo_words)
        if self._aux and self._registers[reg.USER_CTRL] & reg.USER_FIFO_EN:
            return words + len(self._aux.fifo_bytes(self._registers))
        return words

    def _frames(self, run: Run, begin: int, end: int, external: dict[int, bytes]) -> bytes:
        frames = self._prefetch.frames(run, self._setup, begin, end)
        if not external:
            return frames
        words = 2 * len(self._setup.fifo_words)
        return b"".join(frames[words * i : words * (i + 1)] + external[begin + i] for i in range(end - begin))

    def _external(self, run: Run, first: int, due: int, fifo: range) -> tuple[dict[int, bytes], list[int]]:
        """What the auxiliary bus adds to the frames of samples `fifo`, and which samples raised its interrupt."""
        external: dict[int, bytes] = {}
        alarms: list[int] = []
        if self._aux is None or not (self._aux.active(self._registers) or self._aux.fifo_bytes(self._registers)):
            return external, alarms
        for n in sorted({*fifo, *range(max(first, due - _AUX_SAMPLES), due)}):
            if self._aux.sample(self._registers, n, run.time_ns((n + 1) * run.divider)):
                self._registers[reg.INT_STATUS] |= reg.I2C_MST_INT
                alarms.append(n)
            if n in fifo:
                external[n] = self._aux.fifo_bytes(self._registers)
        return external, alarms

    def _new_run(self, setup: Setup, t_ns: int) -> Run:
        error = self._pll_error if setup.on_pll else self._internal_error
        self._runs += 1
        return Run(
            number=self._runs,
            start_ns=t_ns,
            awake_since_ns=self.run.awake_since_ns if self.run else t_ns,
            tick_ns=NS_PER_S / (setup.gyro_hz * (1 + error)),
            nominal_hz=setup.gyro_hz,
            divider=setup.divider,
        )


def _timing(setup: Setup) -> tuple[int, bool, int]:
    return setup.gyro_hz, setup.on_pll, setup.divider
