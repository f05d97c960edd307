"""The magnetometer in a running stream: found once, set up with the chip, and set up again when it fails.

The first time it is looked for by the bypass. Ever after the bypass stays closed: the chip's master fetches whether it
answers or not, so that a frame keeps its length and the stream goes on, and it is written to by the master's slave 4,
which takes no sample away. A magnetometer that holds its wires down would, by the bypass, hold the chip's too.
"""

from __future__ import annotations

import logging

from quavelet.core.clock import Clock
from quavelet.core.errors import BusError, ImuError, SettingsError
from quavelet.core.health import Health
from quavelet.core.units import NS_PER_MS, NS_PER_S
from quavelet.mpu6050.access import RegisterAccess
from quavelet.mpu6050.magnetometer import aux_registers as aux
from quavelet.mpu6050.magnetometer.asked import MagnetometerParams
from quavelet.mpu6050.magnetometer.identify import FoundMagnetometer, find_magnetometer
from quavelet.mpu6050.magnetometer.master import MasterReader, switch_on
from quavelet.mpu6050.magnetometer.plan import Plan, Write
from quavelet.mpu6050.registers import RegisterBits
from quavelet.mpu6050.stream import MagnetometerStream

LOOKS = 3
"""Wires may be disturbed at the one moment when it is looked for."""
RETRY_NS = 2 * NS_PER_S
"""How often a magnetometer that gives nothing is set up anew; longer than it may be silent before it counts as lost."""
ANSWER_NS = 300 * NS_PER_MS
"""Longer than slave 4 takes for a byte at the chip's slowest rate."""

log = logging.getLogger(__name__)


class StreamedMagnetometer:
    """Every method raises BusError where the chip itself fails.

    stream  what it adds to a frame, None where there is none or before it was looked for
    table   what the chip's registers hold for it
    """

    def __init__(
        self, chip: RegisterAccess, params: MagnetometerParams, *, clock: Clock, health: Health, accept_id: int = 0
    ) -> None:
        self.stream: MagnetometerStream | None = None
        self.table: tuple[RegisterBits, ...] = ()
        self._chip = chip
        self._params = params
        self._clock = clock
        self._health = health
        self._accept_id = accept_id
        self._plan: Plan | None = None
        self._to_look = params.used
        self._writes: tuple[Write, ...] = ()
        self._due_ns = 0
        self._asked_ns: int | None = None

    def set_up(self) -> None:
        """After each reset of the chip, which must be awake and configured; takes up to 20 ms, and the first time up to
        three times that.

        Raises SettingsError where what is found cannot measure as asked, ChipUnstable where the chip does not hold what
        is written.
        """
        if self._to_look:
            self._look()
            self._to_look = False
        elif self._plan is not None:
            self.table = switch_on(self._chip, self._plan, sample_period_s=self._chip.stream_info().nominal_period_s)
            self._begin(self._plan)  # what cost the chip its settings may have cost the magnetometer its own

    def tend(self, *, lost: bool) -> None:
        """One step of setting up a magnetometer that is lost, by slave 4; to be called once a drain."""
        now_ns = self._clock.now_ns()
        if self._plan is None or now_ns < self._due_ns:
            return
        if self._asked_ns is not None:
            self._answered(now_ns, self._asked_ns)
        elif self._writes:
            self._write(self._plan, self._writes[0])
            self._asked_ns = now_ns
        elif lost:
            self._begin(self._plan)

    def _look(self) -> None:
        why = ""
        for _ in range(LOOKS):
            try:
                finding = find_magnetometer(self._chip, wanted=self._params.wanted, accept_id=self._accept_id)
                found = finding.magnetometer
                if found is None or found.outside:
                    why = "; ".join(finding.sentences)
                    continue
                self._take(found)
            except SettingsError:
                raise
            except ImuError as error:
                if isinstance(error, BusError) and error.address == self._chip.address:
                    raise
                why = str(error)
                continue
            for sentence in finding.sentences:
                log.warning("%s", sentence)
            return
        log.warning("no magnetometer is used: %s", why)

    def _take(self, found: FoundMagnetometer) -> None:
        config = self._params.config(found.kind)
        reader = MasterReader(self._chip, found, config, clock=self._clock, health=self._health)
        reader.set_up()
        plan = reader.plan
        self._plan, self.table = plan, reader.table
        self.stream = MagnetometerStream(
            kind=plan.name,
            rate_hz=config.rate_hz,
            range_ut=config.range_ut,
            external_bytes=plan.block_bytes,
            slaves=len(plan.runs),
            to_body=config.to_body or found.to_body,
            adjustment=plan.adjustment,
        )

    def _begin(self, plan: Plan) -> None:
        self._writes, self._asked_ns = plan.set_up, None
        self._due_ns = self._clock.now_ns()

    def _write(self, plan: Plan, write: Write) -> None:
        """Have slave 4 write one byte at the next sample (RM p. 22)."""
        chip = self._chip
        chip.write(aux.SLV4_ADDR, plan.address)
        chip.write(aux.SLV4_REG, write.register.address)
        chip.write(aux.SLV4_DO, write.byte)
        chip.apply(RegisterBits(aux.SLV4_CTRL, aux.SLV_EN, 0))

    def _answered(self, now_ns: int, asked_ns: int) -> None:
        status = self._chip.read(aux.I2C_MST_STATUS)
        done, refused = status & aux.STATUS_SLV4_DONE.mask, status & aux.STATUS_SLV4_NACK.mask
        if refused or (not done and now_ns - asked_ns > ANSWER_NS):
            self._writes, self._asked_ns, self._due_ns = (), None, now_ns + RETRY_NS
        elif done:
            self._due_ns = now_ns + self._writes[0].wait_ns
            self._writes, self._asked_ns = self._writes[1:], None
            if not self._writes:
                self._health.magnetometer_restarts += 1
                self._due_ns = now_ns + RETRY_NS
