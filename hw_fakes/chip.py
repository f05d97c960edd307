"""The MPU-6050 at the level of I2C messages: registers, power, FIFO and status, in the time of a clock."""

from __future__ import annotations

from hw_fakes import registers as reg
from hw_fakes.fifo import Fifo
from hw_fakes.imperfections import TYPICAL, Imperfections
from hw_fakes.interrupt import Edge, IntPin
from hw_fakes.motion import Motion, Still
from hw_fakes.personalities import MPU6050, Personality
from hw_fakes.prefetch import NO_DATA, Prefetch
from hw_fakes.samples import Run, SampleSource
from hw_fakes.setup import Setup, decode
from hw_fakes.signal_path import MotionSource
from hw_fakes.target import Nack
from quavelet.core.clock import Clock
from quavelet.core.errors import EndOfData
from quavelet.core.units import NS_PER_MS, NS_PER_S

RESET_NS = 100 * NS_PER_MS
_NEEDS_SAMPLES = frozenset(
    [*range(reg.INT_STATUS, reg.GYRO_ZOUT_L + 1), reg.FIFO_COUNTH, reg.FIFO_COUNTL, reg.FIFO_R_W]
)


class FakeMpu6050:
    """An MPU-6050 that behaves, in virtual or real time.

    A transaction is any number of `write(data)` and `read(n)`, then `stop()`. Samples are taken at the exact times of
    the chip's own oscillator but computed only when someone can see them. Time zero of the motion is the construction.

    registers      the register file, 128 bytes, sensor and count bytes as last read; a byte changed from outside takes
                   effect at the next transaction
    written        every (register, value) received, also those without effect
    samples_taken  since construction, as of the last transaction
    fifo           the bytes waiting
    motion         the truth; None where the samples come from elsewhere
    """

    def __init__(
        self,
        clock: Clock,
        *,
        motion: Motion | None = None,
        imperfections: Imperfections = TYPICAL,
        pll_error: float = 0.007,
        internal_error: float = -0.03,
        seed: int = 0,
        accel_trim: tuple[int, int, int] = reg.ACCEL_TRIM,
        self_test_codes: tuple[int, ...] | None = None,
        nack_in_reset: bool = False,
        source: SampleSource | None = None,
        personality: Personality = MPU6050,
    ) -> None:
        """A chip that is just powered up, lying `Still` where no motion is given.

        pll_error, internal_error  how much too fast the two oscillators are: 0.01 is 1 % more samples a second
        accel_trim                 the factory's accelerometer offsets, 2048 LSB per g; they stand for no offset
        self_test_codes            registers 0x0D to 0x10, or those of the personality
        nack_in_reset              for 100 ms after DEVICE_RESET it does not answer; otherwise it answers reset values,
                                   with DEVICE_RESET still set, and forgets what is written
        source                     where the samples come from, in place of motion and imperfections
        personality                which chip of the family it is
        """
        self.clock = clock
        self.birth_ns = clock.now_ns()
        self.motion = motion if motion is not None or source is not None else Still()
        self.imperfections = imperfections
        self.pll_error = pll_error
        self.internal_error = internal_error
        self.accel_trim = accel_trim
        self.personality = personality
        self.self_test_codes = personality.self_test_codes if self_test_codes is None else self_test_codes
        self.nack_in_reset = nack_in_reset
        if source is None:
            source = MotionSource(
                self.motion or Still(),
                imperfections,
                seed=seed,
                birth_ns=self.birth_ns,
                accel_trim=accel_trim,
                self_test_codes=self.self_test_codes,
                personality=personality,
            )
        self.source = source
        self.registers = bytearray(reg.COUNT)
        self.fifo = Fifo(size=personality.fifo_bytes[0])
        self.written: list[tuple[int, int]] = []
        self.samples_taken = 0
        self._plugged = True
        self._fifo_begun = False
        self._past_end = False
        self._reset_done_ns = 0
        self._runs = 0
        self._run: Run | None = None
        self._taken = 0  # of the samples of this run
        self._in_transaction = False
        self._pointer = 0
        self._setup = decode(reg.POWER_UP)
        self._power_up()
        self._pin = IntPin()
        self._prefetch = Prefetch(self.source)
        self._shadow: bytes | None = NO_DATA  # None: the newest sample, not looked at yet
        self._refresh()

    # Messages

    def write(self, data: bytes) -> None:
        """A write message: the register pointer, then bytes for it and the registers after it. Raises `Nack`."""
        self._begin()
        if data:
            self._pointer = data[0] & 0x7F
        for value in data[1:]:
            self._store(self._pointer, value)
            self._refresh()
            self._step()

    def read(self, n: int) -> bytes:
        """A read message of `n` bytes, from the register pointer on. Raises `Nack`.

        Raises EndOfData where a recording is exhausted, its last frame is read, and a sample is asked for.
        """
        self._begin()
        asked = range(self._pointer, self._pointer + n)
        if self._past_end and not self.fifo and not _NEEDS_SAMPLES.isdisjoint(asked):
            raise EndOfData("the recording behind the fake chip is at its end: stop, or open it anew to play it again")
        answer = bytearray()
        while len(answer) < n:
            if self._pointer == reg.FIFO_R_W:
                answer += self._pop(n - len(answer))
            else:
                answer.append(self._load(self._pointer))
                self._step()
        if self.registers[reg.INT_PIN_CFG] & reg.INT_RD_CLEAR:
            self._clear_status()
        return bytes(answer)

    def stop(self) -> None:
        """The end of a transaction: from here on the sensor registers show newer samples."""
        self._in_transaction = False

    # Around the chip

    def unplug(self) -> None:
        """The bus lines come off: nothing is acknowledged. The chip itself goes on; see `power_cut`."""
        self._plugged = False

    def plug(self) -> None:
        """The bus lines are back."""
        self._plugged = True

    def power_cut(self) -> None:
        """The supply fails and comes back: power-up values, asleep, FIFO empty."""
        self._power_up()
        self._refresh()
        self._pointer, self._shadow = 0, NO_DATA

    def int_level(self) -> bool:
        """Whether the INT pin is high now. Within a transaction: as it was when that began, or was cleared by it."""
        self._look()
        return self._pin.high(self.clock.now_ns())

    def int_edges(self, since_ns: int) -> list[Edge]:
        """The changes of the INT pin from `since_ns` to now, oldest first; very old ones are forgotten."""
        self._look()
        return self._pin.edges(since_ns, self.clock.now_ns())

    def true_rate_hz(self) -> float:
        """Samples a second of true time; 0 while the chip does not sample."""
        self._refresh()
        return NS_PER_S / self._run.period_ns if self._run else 0.0

    def world_time_s(self, t_ns: int) -> float:
        """Time of the motion at clock time `t_ns`."""
        return (t_ns - self.birth_ns) / NS_PER_S

    # Time

    def _begin(self) -> None:
        if not self._plugged:
            raise Nack
        if not self._in_transaction:
            self._look()
            self._in_transaction = True
        if self._resetting and self.nack_in_reset:
            raise Nack

    def _look(self) -> None:
        if not self._in_transaction:
            self._advance()
            self._refresh()

    @property
    def _resetting(self) -> bool:
        return bool(self.registers[reg.PWR_MGMT_1] & reg.DEVICE_RESET)

    def _advance(self) -> None:
        """Take the samples that fell since the last look."""
        now_ns = self.clock.now_ns()
        if self._resetting and now_ns >= self._reset_done_ns:
            self.registers[reg.PWR_MGMT_1] &= ~reg.DEVICE_RESET & 0xFF
            self._refresh(self._reset_done_ns)
        run = self._run
        if run is None:
            self._past_end = False
            return
        due, limit = run.samples_by(now_ns), self.source.limit(run)
        self._past_end = limit is not None and due > limit
        if limit is not None:
            due = min(due, limit)
        first = self._taken
        new = due - first
        if new <= 0:
            return
        self._taken = due
        self.samples_taken += new
        self._shadow = None
        # Both bits are set whether or not INT_ENABLE lets them out to the pin.
        self.registers[reg.INT_STATUS] |= reg.DATA_RDY_INT
        frame, overflow = 2 * len(self._setup.fifo_words), due
        if frame:
            overflow = first + (self.fifo.size - len(self.fifo)) // frame
            # Of more samples than the FIFO holds only the newest can be seen, but one more, so that it overflows.
            seen = min(new, self.fifo.size // frame + 1)
            self._push(self._prefetch.frames(run, self._setup, due - seen, due))
        self._pin.sampled(run, first, due, overflow)

    def _refresh(self, since_ns: int | None = None) -> None:
        """Follow the configuration registers, as they have been since a moment; None: since now."""
        self._pin.follow(self.registers, self.clock.now_ns())
        self.fifo.resize(self.personality.fifo_size(self.registers))
        setup = decode(self.registers, personality=self.personality)
        if setup == self._setup:
            return
        self._newest()
        before, self._setup = self._setup, setup
        self._prefetch.clear()
        if not setup.awake:
            self._run, self._shadow = None, NO_DATA
        elif self._run is None or _timing(before) != _timing(setup):
            self._run = self._new_run(setup, self.clock.now_ns() if since_ns is None else since_ns)
            self._taken = 0
        if setup.frozen != before.frozen:
            self._prefetch.held = self._newest()
        if setup.fifo_words and not self._fifo_begun and self._run:
            self._fifo_begun = True
            self.source.fifo_begins(self._run, self._taken)

    def _new_run(self, setup: Setup, now_ns: int) -> Run:
        nominal_hz = 8000 if setup.fast else 1000
        error = self.pll_error if setup.on_pll else self.internal_error
        self._runs += 1
        return Run(
            number=self._runs,
            start_ns=now_ns,
            awake_since_ns=self._run.awake_since_ns if self._run else now_ns,
            tick_ns=NS_PER_S / (nominal_hz * (1 + error)),
            nominal_hz=nominal_hz,
            divider=setup.divider,
        )

    # Registers

    def _power_up(self) -> None:
        self.registers[:] = self.personality.power_up_registers(self.accel_trim, self.self_test_codes)
        self.fifo.clear()

    def _step(self) -> None:
        # The pointer stays on FIFO_R_W: a burst that reaches it goes on popping.
        if self._pointer != reg.FIFO_R_W:
            self._pointer = (self._pointer + 1) % reg.COUNT

    def _load(self, register: int) -> int:
        if reg.ACCEL_XOUT_H <= register <= reg.GYRO_ZOUT_L:
            self.registers[reg.ACCEL_XOUT_H : reg.GYRO_ZOUT_L + 1] = self._newest()
        elif register == reg.FIFO_COUNTH:  # latches the low byte too (RM registers 114 and 115)
            self.registers[reg.FIFO_COUNTH : reg.FIFO_COUNTL + 1] = len(self.fifo).to_bytes(2, "big")
        value = self.registers[register]
        if register == reg.INT_STATUS:
            self._clear_status()
        return value

    def _clear_status(self) -> None:
        self.registers[reg.INT_STATUS] = 0
        self._pin.follow(self.registers, self.clock.now_ns())

    def _pop(self, n: int) -> bytes:
        # A FIFO that is switched off cannot be read (RM register 106).
        if self.registers[reg.USER_CTRL] & reg.USER_FIFO_EN:
            return self.fifo.pop(n)
        return bytes([self.fifo.last_read]) * n

    def _push(self, data: bytes) -> bool:
        overflow = self.fifo.push(data)
        if overflow:
            self.registers[reg.INT_STATUS] |= reg.FIFO_OFLOW_INT
        return overflow

    def _store(self, register: int, value: int) -> None:
        self.written.append((register, value))
        asleep = self.registers[reg.PWR_MGMT_1] & reg.SLEEP
        if self._resetting or reg.REGISTERS[register].access == "r" or (asleep and register not in reg.WRITABLE_ASLEEP):
            return
        if register == reg.PWR_MGMT_1 and value & reg.DEVICE_RESET:
            self._power_up()
            self.registers[reg.PWR_MGMT_1] |= reg.DEVICE_RESET
            self._reset_done_ns = self.clock.now_ns() + RESET_NS
            return
        if register == reg.FIFO_R_W:
            if self.registers[reg.USER_CTRL] & reg.USER_FIFO_EN and self._push(bytes([value])):
                self._pin.overflowed(self.clock.now_ns())
            return
        if register == reg.USER_CTRL:
            # FIFO_RESET acts only while FIFO_EN is 0, in the same byte too (RM register 106).
            if value & reg.USER_FIFO_RESET and not value & reg.USER_FIFO_EN:
                self.fifo.clear()
            if value & reg.USER_SIG_COND_RESET:
                self._shadow = NO_DATA
        self.registers[register] = value & reg.REGISTERS[register].sticks

    def _newest(self) -> bytes:
        """The 14 sensor bytes of the newest sample."""
        if self._shadow is None and self._run is not None:
            self._shadow = self._prefetch.sample(self._run, self._setup, self._taken - 1)
        return self._shadow or NO_DATA


def _timing(setup: Setup) -> tuple[bool, bool, int]:
    return setup.fast, setup.on_pll, setup.divider
