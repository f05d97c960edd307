"""From whatever state to a running FIFO: a state machine that never sleeps in the middle of its work.

    PROBE -> RESET -> WAIT_RESET -> WAKE -> CONFIGURE -> MAGNETOMETER -> START -> STREAM
               ^___________|___________________|______________|  (after 1 s without success)

MAGNETOMETER is there only where one is to be used, and it alone sleeps, for 20 ms.

The waits are those of the data sheet and of the drivers people trust; each stands beside its reason.
"""

from __future__ import annotations

import logging
from collections.abc import Callable
from dataclasses import replace
from enum import Enum

from quavelet.core.clock import Clock
from quavelet.core.errors import BusError, ChipUnstable, DeviceLost
from quavelet.core.health import Health
from quavelet.core.units import NS_PER_MS, NS_PER_S
from quavelet.mpu6050 import registers as r
from quavelet.mpu6050.access import RegisterAccess
from quavelet.mpu6050.config import ChipConfig, configuration_table
from quavelet.mpu6050.half_scale import is_half_scale
from quavelet.mpu6050.magnetometer.asked import MagnetometerParams
from quavelet.mpu6050.magnetometer.streamed import StreamedMagnetometer
from quavelet.mpu6050.offset_plan import OffsetPlan
from quavelet.mpu6050.offsets import check_factory
from quavelet.mpu6050.registers import joined
from quavelet.mpu6050.stream import StreamInfo
from quavelet.mpu6050.variants import LINE_STUCK, MPU6050, VARIANTS, Variant, identify

RESET_WAIT_NS = 100 * NS_PER_MS
"""RM p. 41: 100 ms after DEVICE_RESET."""
POLL_NS = 10 * NS_PER_MS
"""How often the chip is asked whether it is out of reset."""
PLL_WAIT_NS = 10 * NS_PER_MS
"""PS 6.6: the PLL settles within 10 ms."""
SETTLE_WAIT_NS = 60 * NS_PER_MS
"""PS 6.1: 30 ms for the gyroscope's zero to settle; the kernel's driver allows 60. Samples until then are not read."""
RETRY_NS = 100 * NS_PER_MS
"""How often a configuration that does not hold is written again."""
GIVE_UP_NS = NS_PER_S
"""After this long in one try the chip is reset again."""
MAX_TRIES = 5
"""Resets before a chip that never streamed is called unstable."""
MAX_DIFFERING = 100
"""Readings of WHO_AM_I that differ from the one just before, 10 ms apart, until nobody can tell who is there."""

log = logging.getLogger(__name__)


class Step(Enum):
    """What is done next."""

    PROBE = "asking who answers"
    RESET = "resetting the chip"
    WAIT_RESET = "waiting for the reset to end"
    WAKE = "waking the chip"
    CONFIGURE = "writing the configuration and reading it back"
    MAGNETOMETER = "setting the magnetometer up"
    START = "reading the configuration back once more and starting the FIFO"
    STREAM = "streaming"


class StartUp:
    """Brings the chip to streaming, the first time and after every trouble.

    step      what is done next; STREAM where all is done
    due_ns    when
    variant   which chip it is, once it is known
    table     what is written to its registers
    magnetometer   what is there beside the chip itself
    info      the chip as configured, None until it streams
    reason    what the last step found wrong
    """

    def __init__(
        self,
        chip: RegisterAccess,
        config: ChipConfig,
        *,
        clock: Clock,
        health: Health,
        accept_id: int = 0,
        offsets: OffsetPlan | None = None,
        find_offsets: Callable[[Variant], OffsetPlan | None] | None = None,
        data_ready: bool = False,
        magnetometer: MagnetometerParams | None = None,
    ) -> None:
        """accept_id is that of `identify`; offsets are written after every reset; data_ready: the INT pin is used.

        find_offsets is asked for them while the chip is not yet known: awake, and with the factory's words in it.
        """
        self.step = Step.PROBE
        self.due_ns = clock.now_ns()
        self.variant: Variant = MPU6050
        self.table = configuration_table(config, variant=MPU6050)
        self.info: StreamInfo | None = None
        self.reason: BusError | str = ""
        self.magnetometer = StreamedMagnetometer(
            chip, magnetometer or MagnetometerParams(), clock=clock, health=health, accept_id=accept_id
        )
        self._uses_magnetometer = magnetometer is not None and magnetometer.used
        self._configuration = self.table
        self._chip = chip
        self._config = config
        self._accept_id = accept_id
        self._offsets = offsets
        self._find_offsets = find_offsets
        self._data_ready = data_ready
        self._clock = clock
        self._health = health
        self._steps: dict[Step, Callable[[], None]] = {
            Step.PROBE: self._probe,
            Step.RESET: self._reset,
            Step.WAIT_RESET: self._wait_reset,
            Step.WAKE: self._wake,
            Step.CONFIGURE: self._configure,
            Step.MAGNETOMETER: self._set_up_magnetometer,
            Step.START: self._start,
        }
        self._differing = 0
        self._try_since_ns = 0
        self._tries = 0

    @property
    def streaming(self) -> bool:
        return self.step is Step.STREAM

    def begin_again(self) -> None:
        """The chip has streamed and must be brought back: it is reset and configured anew."""
        self._health.chip_restarts += 1
        self.reason = ""
        self._go(Step.PROBE, 0)

    def advance(self) -> None:
        """Do the step that is due.

        Raises BusError while the chip is not yet known, WrongChip, ChipUnstable after five resets in vain, and
        DeviceLost where another chip answers than the one that streamed.
        """
        step = self.step
        try:
            self._steps[step]()
        except BusError as error:
            # Before the chip is known the user must hear at once; later it may be in its reset.
            if self.info is None and step is Step.PROBE:
                raise
            log.debug("%s: %s", step.value, error)
            self._again(POLL_NS, error)

    def _go(self, step: Step, wait_ns: int) -> None:
        self.step = step
        self.due_ns = self._clock.now_ns() + wait_ns

    def _again(self, wait_ns: int, reason: BusError | str) -> None:
        """The same step later, or a new reset when this try has lasted too long."""
        self.reason = reason
        if self.step is Step.PROBE or self._clock.now_ns() - self._try_since_ns < GIVE_UP_NS:
            self._go(self.step, wait_ns)
        elif self.info is not None or self._tries < MAX_TRIES:
            self._health.chip_restarts += 1
            # By way of the question who is there, once that is known: a chip put in its place must not be written to.
            self._new_try() if self.info is None else self._go(Step.PROBE, 0)
        else:
            raise ChipUnstable(
                f"the chip at 0x{self._chip.address:02x} did not start in {MAX_TRIES} tries, stuck while "
                f"{self.step.value} ({reason}): check its supply voltage, then power it off and on"
            )

    def _probe(self) -> None:
        # Reading comes before any write: a clock chip at this address must not be written to.
        who_am_i = self._chip.read(r.WHO_AM_I)
        if self.info is None:
            # One flipped bit makes another chip of the family, or a stranger, out of an MPU-6050.
            if who_am_i != MPU6050.who_am_i and self._chip.read(r.WHO_AM_I) != who_am_i:
                self._differing += 1
                if self._differing > MAX_DIFFERING:
                    raise ChipUnstable(
                        f"WHO_AM_I of address 0x{self._chip.address:02x} on {self._chip.bus.name} reads otherwise each "
                        f"time: check the wires and their pull-ups, then try a slower bus"
                    )
                self._again(POLL_NS, f"WHO_AM_I reads 0x{who_am_i:02x}, and then otherwise")
                return
            self.variant = identify(
                who_am_i, bus=self._chip.bus.name, address=self._chip.address, accept_id=self._accept_id
            )
            self._configuration = self._configured()
            if self.variant.remark:
                log.warning("%s", self.variant.remark)
        elif who_am_i in LINE_STUCK:
            self._again(POLL_NS, f"WHO_AM_I reads 0x{who_am_i:02x}")
            return
        elif who_am_i != self.variant.who_am_i:
            self._asked_again(who_am_i)
            return
        self._new_try()

    def _configured(self) -> tuple[r.RegisterBits, ...]:
        return configuration_table(
            self._config, variant=self.variant, offsets=self._offsets, data_ready=self._data_ready
        )

    def _asked_again(self, who_am_i: int) -> None:
        if self._chip.read(r.WHO_AM_I) != who_am_i:
            self._again(POLL_NS, f"WHO_AM_I reads 0x{who_am_i:02x}")
            return
        raise DeviceLost(
            f"WHO_AM_I of address 0x{self._chip.address:02x} on {self._chip.bus.name} reads 0x{who_am_i:02x} where the "
            f"{self.variant.name} read 0x{self.variant.who_am_i:02x}: the chip was exchanged, start again"
        )

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
        if who_am_i != self.variant.who_am_i:
            self._again(POLL_NS, f"WHO_AM_I reads 0x{who_am_i:02x} after reset")
            return
        power = self._chip.read(r.PWR_MGMT_1)
        if (power ^ self.variant.pwr_mgmt_1_reset) & self.variant.pwr_mgmt_1_sure:
            self._again(POLL_NS, f"PWR_MGMT_1 reads 0x{power:02x} after reset")
            return
        self._go(Step.WAKE, 0)

    def _wake(self) -> None:
        # Writes to other registers are ignored while the chip sleeps: wake first, on the PLL's clock.
        self._chip.write(r.PWR_MGMT_1, r.CLKSEL.encode(r.CLOCK_PLL_GYRO_X))
        if self.info is None and self._find_offsets is not None:
            self._offsets = self._find_offsets(self.variant)
            self._configuration = self._configured()
        if self._offsets is not None:
            check_factory(self._chip, self._offsets, variant=self.variant)
        self._go(Step.CONFIGURE, PLL_WAIT_NS)

    def _configure(self) -> None:
        self.table = self._configuration
        for row in self.table:
            self._chip.apply(row)
        if not self._holds():
            return
        if self._uses_magnetometer:
            self._go(Step.MAGNETOMETER, 0)
        else:
            self._go(Step.START, SETTLE_WAIT_NS)

    def _set_up_magnetometer(self) -> None:
        try:
            self.magnetometer.set_up()
        except ChipUnstable as error:
            self.step = Step.CONFIGURE
            self._again(RETRY_NS, str(error))
            return
        self.table = joined((*self._configuration, *self.magnetometer.table))
        self._go(Step.START, SETTLE_WAIT_NS)

    def _holds(self) -> bool:
        """Whether the configuration reads back as written; where it does not, it is written anew later."""
        wrong = [row.register.name for row in self.table if not row.holds(self._chip.read(row.register))]
        if wrong:
            self._health.config_mismatches += len(wrong)
            self.step = Step.CONFIGURE
            self._again(RETRY_NS, f"{', '.join(wrong)} did not read back as written")
        return not wrong

    def _is_as_written(self, info: StreamInfo) -> bool:
        """Whether ranges and rates were read as they were written: one bit that flips there spoils all samples."""
        read = {
            r.CONFIG: info.config,
            r.GYRO_CONFIG: info.gyro_config,
            r.ACCEL_CONFIG: info.accel_config,
            r.SMPLRT_DIV: info.smplrt_div,
        }
        rows = [row for row in self.table if row.register in read]
        return info.who_am_i == self.variant.who_am_i and all(row.holds(read[row.register]) for row in rows)

    def _start(self) -> None:
        # Much may happen while the gyroscope settles, and the scale of all samples hangs on these registers.
        if not self._holds():
            return
        read = self._chip.stream_info()
        if not self._is_as_written(read):
            self._again(POLL_NS, f"WHO_AM_I reads 0x{read.who_am_i:02x}, or the ranges other than a moment before")
            return
        # What is seldom so is looked at twice: one bit that flips on its way would halve the scale.
        half_scale = all(is_half_scale(self._chip, variant=self.variant) for _ in range(2))
        info = replace(
            read,
            accepted=self.variant.who_am_i not in VARIANTS,
            accel_half_scale=half_scale,
            data_ready=self._data_ready,
            magnetometer=self.magnetometer.stream,
        )
        self._chip.restart_fifo(slaves=info.slaves)
        self.info = info
        self._tries = 0
        self._go(Step.STREAM, 0)
