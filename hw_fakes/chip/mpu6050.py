"""The MPU-6050 at the level of I2C messages: registers, power, FIFO and status, in the time of a clock."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from hw_fakes.chip import registers as reg
from hw_fakes.chip.aux_master import AuxMaster
from hw_fakes.chip.dmp_memory import DmpMemory
from hw_fakes.chip.fifo import Fifo
from hw_fakes.chip.interrupt import Edge, IntPin
from hw_fakes.chip.motion_detection import MotionRules, WakeOnMotion
from hw_fakes.chip.personalities import MPU6050, Personality
from hw_fakes.chip.samples import CountArray, Run, SampleSource
from hw_fakes.chip.sampling import Sampling
from hw_fakes.chip.signal_path import MotionSource
from hw_fakes.target import Nack, Target
from hw_fakes.world.imperfections import TYPICAL, Imperfections
from hw_fakes.world.motion import Motion, Still
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

    registers  the register file, 128 bytes, sensor and count bytes as last read; a byte changed from outside takes
               effect at the next transaction
    written    every (register, value) received, also those without effect
    fifo       the bytes waiting
    motion     the truth; None where the samples come from elsewhere
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
        motion_threshold_mg_lsb: float = 2.0,
        aux: AuxMaster | None = None,
    ) -> None:
        """A chip that is just powered up, lying `Still` where no motion is given.

        pll_error, internal_error  how much too fast the two oscillators are: 0.01 is 1 % more samples a second
        accel_trim                 the factory's accelerometer offsets, 2048 LSB per g; they stand for no offset
        self_test_codes            registers 0x0D to 0x10, or those of the personality
        nack_in_reset              for 100 ms after DEVICE_RESET it does not answer; otherwise it answers reset values,
                                   with DEVICE_RESET still set, and forgets what is written
        source                     where the samples come from, in place of motion and imperfections
        personality                which chip of the family it is
        motion_threshold_mg_lsb    what 1 in FF_THR, MOT_THR and ZRMOT_THR stands for. The register map before rev 4.2
                                   says 2 mg, PS 6.2 says 32 mg: to be measured on the hardware
        aux                        the auxiliary bus with the chips on it, whose outer clock is `clock`; None: none is
                                   wired, and its registers only keep what is written
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
        self.aux = aux
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
        if aux:
            aux.behind(self.registers)
        self.fifo = Fifo(size=personality.fifo_bytes[0])
        self.written: list[tuple[int, int]] = []
        self._memory = DmpMemory()
        self._pin = IntPin()
        self._sampling = Sampling(
            self.registers,
            source,
            fifo=self.fifo,
            pin=self._pin,
            personality=personality,
            pll_error=pll_error,
            internal_error=internal_error,
            aux=aux,
            rules=WakeOnMotion() if personality.class_6500 else MotionRules(g_lsb=motion_threshold_mg_lsb / 1000),
        )
        self._plugged = True
        self._reset_done_ns = 0
        self._in_transaction = False
        self._pointer = 0
        self._power_up()
        self._sampling.follow(self.birth_ns)

    # Messages

    def write(self, data: bytes) -> None:
        """A write message: the register pointer, then bytes for it and the registers after it. Raises `Nack`."""
        self._begin()
        if data:
            self._pointer = data[0] & 0x7F
        for value in data[1:]:
            self._store(self._pointer, value)
            self._sampling.follow(self.clock.now_ns())
            self._step()

    def read(self, n: int) -> bytes:
        """A read message of `n` bytes, from the register pointer on. Raises `Nack`.

        Raises EndOfData where a recording is exhausted, its last frame is read, and a sample is asked for.
        """
        self._begin()
        asked = range(self._pointer, self._pointer + n)
        if self._sampling.past_end and not self.fifo and not _NEEDS_SAMPLES.isdisjoint(asked):
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
        self._sampling.switch_off()
        self._power_up()
        self._sampling.follow(self.clock.now_ns())
        self._pointer = 0

    def recompute(self) -> None:
        """What comes from now on is computed anew: for a motion that was changed while the chip runs."""
        self._look()
        self._sampling.recompute()

    @property
    def int_connected(self) -> bool:
        """Whether the INT pin reaches its pad; without, it stays inactive whatever happens."""
        return self._pin.connected

    @int_connected.setter
    def int_connected(self, connected: bool) -> None:
        self._look()
        self._pin.connected = connected
        self._pin.follow(self.registers, self.clock.now_ns())

    @property
    def spoil_words(self) -> Callable[[CountArray], CountArray] | None:
        """What makes of the words (n, 7) of samples those that show, in the FIFO and in the registers; None: they show
        as they are. Words are accelerometer x y z, temperature, gyroscope x y z; samples come in order, and the newest
        may come again."""
        return self._sampling.spoil

    @spoil_words.setter
    def spoil_words(self, spoil: Callable[[CountArray], CountArray] | None) -> None:
        self._look()
        self._sampling.spoil = spoil

    def bypassed(self) -> Mapping[int, Target]:
        """The chips of the auxiliary bus that can be spoken to on the outer one, awake or asleep: all or none.

        For one that cannot ask before each transaction there is `aux.outside`.
        """
        self._look()
        return self.aux.targets if self.aux and self.aux.bypass(self.registers) else {}

    def int_level(self) -> bool:
        """Whether the INT pin is high now. Within a transaction: as it was when that began, or was cleared by it."""
        self._look()
        return self._pin.high(self.clock.now_ns())

    def int_edges(self, since_ns: int) -> list[Edge]:
        """The changes of the INT pin from `since_ns` to now, oldest first; very old ones are forgotten."""
        self._look()
        return self._pin.edges(since_ns, self.clock.now_ns())

    @property
    def samples_taken(self) -> int:
        """Since construction, as of the last transaction."""
        return self._sampling.samples_taken

    @property
    def run(self) -> Run | None:
        """The present stretch of even sampling, which has the times of samples; None while the chip takes none."""
        self._sampling.follow(self.clock.now_ns())
        return self._sampling.run

    def true_rate_hz(self) -> float:
        """Samples a second of true time; 0 while the chip does not sample."""
        run = self.run
        return NS_PER_S / run.period_ns if run else 0.0

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
        """Let happen what fell since the last look."""
        if self._in_transaction:
            return
        now_ns = self.clock.now_ns()
        if self._resetting and now_ns >= self._reset_done_ns:
            self.registers[reg.PWR_MGMT_1] &= ~reg.DEVICE_RESET & 0xFF
            self._sampling.follow(self._reset_done_ns)
        self._sampling.advance(now_ns)
        self._sampling.follow(now_ns)

    @property
    def _resetting(self) -> bool:
        return bool(self.registers[reg.PWR_MGMT_1] & reg.DEVICE_RESET)

    # Registers

    def _power_up(self) -> None:
        self.registers[:] = self.personality.power_up_registers(self.accel_trim, self.self_test_codes)
        self.fifo.clear()
        self._memory.clear()

    def _step(self) -> None:
        # The pointer stays on the two ports: a burst that reaches FIFO_R_W goes on popping.
        if self._pointer not in (reg.FIFO_R_W, reg.MEM_R_W):
            self._pointer = (self._pointer + 1) % reg.COUNT

    def _load(self, register: int) -> int:
        if reg.ACCEL_XOUT_H <= register <= reg.GYRO_ZOUT_L:
            self.registers[reg.ACCEL_XOUT_H : reg.GYRO_ZOUT_L + 1] = self._sampling.newest()
        elif register == reg.FIFO_COUNTH:  # latches the low byte too (RM registers 114 and 115)
            self.registers[reg.FIFO_COUNTH : reg.FIFO_COUNTL + 1] = len(self.fifo).to_bytes(2, "big")
        elif register == reg.MEM_R_W:
            return self._memory.read(self.registers)
        value = self.registers[register]
        if register == reg.INT_STATUS:
            self._clear_status()
        elif register == reg.MOT_DETECT_STATUS:
            self.registers[register] &= reg.AT_REST
        elif register == reg.I2C_MST_STATUS:
            self.registers[register] = 0
        return value

    def _clear_status(self) -> None:
        self.registers[reg.INT_STATUS] = 0
        self._pin.follow(self.registers, self.clock.now_ns())

    def _pop(self, n: int) -> bytes:
        # A FIFO that is switched off cannot be read (RM register 106).
        if self.registers[reg.USER_CTRL] & reg.USER_FIFO_EN:
            return self.fifo.pop(n)
        return bytes([self.fifo.last_read]) * n

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
            if self.registers[reg.USER_CTRL] & reg.USER_FIFO_EN and self.fifo.push(bytes([value])):
                self.registers[reg.INT_STATUS] |= reg.FIFO_OFLOW_INT
                self._pin.happened(reg.FIFO_OFLOW_INT, self.clock.now_ns())
            return
        if register == reg.MEM_R_W:
            self._memory.write(self.registers, value)
        if register == reg.USER_CTRL:
            # FIFO_RESET acts only while FIFO_EN is 0, in the same byte too (RM register 106).
            if value & reg.USER_FIFO_RESET and not value & reg.USER_FIFO_EN:
                self.fifo.clear()
            if value & reg.USER_SIG_COND_RESET:
                self._sampling.blank()
            # As with the FIFO: I2C_MST_RESET acts only while I2C_MST_EN is 0.
            if self.aux and value & reg.USER_I2C_MST_RESET and not value & reg.USER_I2C_MST_EN:
                self.aux.reset()
        if register == reg.SIGNAL_PATH_RESET and value & reg.ACCEL_RESET:
            self._sampling.restart_detection()
        self.registers[register] = value & self.personality.sticks(register)
