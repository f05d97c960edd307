"""The check-up of one board, from the machine up to the sensors: each finding, and what to do next."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import nullcontext

import numpy as np

from quavelet.bench import beside, fifo, int_line, wires
from quavelet.bench.finding import Finding
from quavelet.bench.host import Host
from quavelet.bench.reach import Reach
from quavelet.bench.sensors import ALIVE, STILL, sensors
from quavelet.bus.open import BusOpener, open_bus, open_line
from quavelet.bus.protocol import DataReady, Edge, I2CBus
from quavelet.calibration.calibrate import Calibrate
from quavelet.calibration.model import UNCALIBRATED
from quavelet.core.blocks import RawBlock, concat
from quavelet.core.clock import Clock
from quavelet.core.errors import BusError, ChipUnstable, DeviceLost, ImuError, SettingsError, WrongChip
from quavelet.core.health import Health
from quavelet.core.units import NS_PER_S
from quavelet.mpu6050 import registers as r
from quavelet.mpu6050.access import RegisterAccess
from quavelet.mpu6050.self_test import run_self_test
from quavelet.mpu6050.source import ChipSource
from quavelet.mpu6050.stream import StreamInfo
from quavelet.mpu6050.variants import Variant, identify
from quavelet.settings import Settings

LISTEN_S = 5.0
DRAIN_S = 0.02
SETTLED_S = 1.0
"""What the gyroscope shows at waking (PS 6.1) goes through the narrowest filter in less."""
LOST_S = 2.0
"""A chip that has gone for this long does not come back while somebody waits for the verdict."""
RATE_LIMIT = 0.02
"""PS 6.6: 1 % on the PLL; twice that is a chip running on something else."""


class CheckUp:
    """One check-up. The chip is reset by it, and is asleep afterwards.

    error   what ended it before its end, None where all was looked at
    """

    def __init__(
        self,
        settings: Settings,
        *,
        clock: Clock,
        host: Host | None = None,
        opener: BusOpener = open_bus,
        waiting: Callable[[str], None] = lambda _text: None,
    ) -> None:
        """`waiting` is told what takes long, before it does."""
        self.error: ImuError | None = None
        self._settings = settings
        self._address = settings.bus.address
        self._clock = clock
        self._opener = opener
        self._waiting = waiting
        self._health = Health()
        self._reach = Reach(settings.bus, host=host or Host())

    def findings(self) -> Iterator[Finding]:
        """The findings, as they come; where nothing more can be looked at, the last one says why.

        Raises SettingsError where the bus has no name of one.
        """
        try:
            bus = self._opener(self._settings.bus.name, clock=self._clock)
        except BusError as error:
            self.error = error
            yield self._reach.not_opened(error)
            return
        with bus:
            yield self._reach.opened(bus)
            yield from self._stages(bus)

    def _stages(self, bus: I2CBus) -> Iterator[Finding]:
        yield self._reach.who_answers(bus)
        self.error = self._reach.error
        if self.error:
            return
        try:
            variant = self._identify(bus)
        except (WrongChip, BusError) as error:
            self.error = error
            yield self._reach.wrong_chip(bus, error)
            return
        yield Finding(name="WHO_AM_I", ok=True, found=f"0x{variant.who_am_i:02x}, {variant.name}")
        try:
            yield wires.speed(bus, settings=self._settings, clock=self._clock, set_hz=self._reach.set_hz)
            yield wires.registers_hold(bus, address=self._address, clock=self._clock)
            yield beside.magnetometer(bus, settings=self._settings, clock=self._clock)
            yield from self._with_line(bus)
        except ImuError as error:
            # It answered a moment ago: to the person before it, it is lost.
            self.error = DeviceLost(str(error)) if isinstance(error, BusError) else error
            yield Finding(name="stopped", ok=False, found="nothing more can be looked at", advice=str(error))

    def _identify(self, bus: I2CBus) -> Variant:
        who_am_i = bus.write_read(self._address, bytes([r.WHO_AM_I.address]), 1)[0]
        return identify(who_am_i, bus=bus.name, address=self._address, accept_id=self._settings.bus.accept_id)

    def _with_line(self, bus: I2CBus) -> Iterator[Finding]:
        name, line = self._settings.bus.int_line, None
        try:
            line = open_line(name, bus=bus, address=self._address)
        except (BusError, SettingsError) as error:
            yield int_line.not_opened(name, error)
        with line or nullcontext():
            yield from self._running(bus, line)

    def _running(self, bus: I2CBus, line: DataReady | None) -> Iterator[Finding]:
        config = self._settings.chip
        edges: list[Edge] = []
        source = ChipSource(
            bus,
            address=self._address,
            config=config,
            accept_id=self._settings.bus.accept_id,
            clock=self._clock,
            health=self._health,
            lost_s=LOST_S,
            line=line,
            on_drain=lambda drain: edges.extend(drain.edges),
        )
        info = source.wait_until_streaming()
        yield self._started(info)
        self._waiting(f"listening for {LISTEN_S:g} s, leave the board lying still")
        block = self._listen(source)
        if not len(block):
            yield Finding(
                name="samples",
                ok=False,
                found=f"none in {LISTEN_S:g} s",
                advice="power the board off and on; if that does not help, the chip is broken",
            )
            return
        measured_hz = source.decoder.measured_rate_hz if source.decoder else None
        yield _rate(measured_hz, 1.0 / info.nominal_period_s)
        yield _losses(self._health)
        if line is not None:
            rate_hz = measured_hz or 1.0 / info.nominal_period_s
            yield int_line.pulses(line.name, edges, rate_hz=rate_hz, listened_s=LISTEN_S)
        settled = block[int(np.searchsorted(block.t_ns, block.t_ns[0] + SETTLED_S * NS_PER_S)) :]
        well = True
        for finding in sensors(Calibrate(UNCALIBRATED).process(settled), config) if len(settled) else ():
            yield finding
            well &= finding.ok or finding.name not in (STILL, ALIVE)
        if well:
            yield self._self_test(bus, info.variant)
        yield fifo.overflow(bus, address=self._address, variant=info.variant, clock=self._clock)
        bus.write(self._address, bytes([r.PWR_MGMT_1.address, r.DEVICE_RESET.mask]))

    def _started(self, info: StreamInfo) -> Finding:
        bad = self._health.config_mismatches
        return Finding(
            name="chip",
            ok=bad == 0,
            found=f"the {info.variant.name} at 0x{info.address:02x} was reset, woke, and is configured"
            + ("" if bad == 0 else f", but {_times(bad, 'register')} did not hold at first"),
            advice="check the supply voltage, shorten the wires" if bad else "; ".join(info.remarks),
        )

    def _self_test(self, bus: I2CBus, variant: Variant) -> Finding:
        self._waiting("testing each axis by its own push")
        chip = RegisterAccess(bus, address=self._address, clock=self._clock, health=self._health)
        try:
            report = run_self_test(
                chip,
                variant=variant,
                clock=self._clock,
                on_repeat=lambda reason: self._waiting(f"testing once more: {reason}"),
            )
        except ChipUnstable as error:
            # A host that is too slow for it says nothing about the board; the FIFO is looked at next.
            return Finding(name="self-test", ok=True, found="could not be done", advice=str(error))
        if not report.still:
            return Finding(name="self-test", ok=True, found="could not be done", advice=report.advice)
        responses = ", ".join(
            f"{axis.axis} {axis.measured:.2f} {axis.unit}"
            if axis.ratio is None
            else f"{axis.axis} {100 * axis.ratio:.0f} %"
            for axis in report.axes
        )
        return Finding(
            name="self-test",
            ok=report.passed,
            found=f"of the factory's response: {responses}"
            + (f"; measured {_times(report.repeats + 1, 'time')}, since it was disturbed" if report.repeats else ""),
            advice=report.advice,
            figures={
                f"{axis.axis.replace(' ', '_')}_ratio": round(axis.ratio, 4) for axis in report.axes if axis.ratio
            },
        )

    def _listen(self, source: ChipSource) -> RawBlock:
        blocks = [source.read()]
        start_ns = self._clock.now_ns()
        for k in range(1, round(LISTEN_S / DRAIN_S) + 1):
            self._clock.sleep_until_ns(start_ns + round(k * DRAIN_S * NS_PER_S))
            blocks.append(source.read())
        return concat(blocks)


def _rate(measured_hz: float | None, nominal_hz: float) -> Finding:
    if measured_hz is None:
        return Finding(
            name="sample rate",
            ok=False,
            found="could not be measured",
            advice="the host is too busy to read the chip in time: stop other programs and try again",
        )
    error = measured_hz / nominal_hz - 1.0
    ok = abs(error) <= RATE_LIMIT
    return Finding(
        name="sample rate",
        ok=ok,
        found=f"{measured_hz:.2f} Hz, {100 * error:+.2f} % of {nominal_hz:g} Hz (measured, and corrected for)",
        advice="" if ok else "the chip does not run on its PLL: power it off and on, or replace it",
        figures={"rate_hz": round(measured_hz, 4), "error_percent": round(100 * error, 4)},
    )


def _losses(health: Health) -> Finding:
    lost, transfers = health.gaps > 0 or health.fifo_resets > 0, health.bus_errors
    found = f"{health.samples} samples, {health.samples_lost} lost in {_times(health.gaps, 'gap')}"
    if transfers:
        found += f"; {_times(transfers, 'transfer')} failed, {health.bus_retries} repeated at once"
    advice = ""
    if health.fifo_overflows or health.fifo_near_full:
        advice = "the host came too late for the FIFO: stop other programs, or raise loop.rate_hz"
    elif health.stuck:
        found += "; no axis changed, so that the chip was reset for it"
        advice = "see 'axes alive'"
    elif health.outages:
        advice = "the chip could not be reached for a while: look for a loose plug, wire or solder joint"
    elif health.registers_upset or health.chip_restarts:
        found += f"; {_times(health.registers_upset, 'register')} had changed, {_times(health.chip_restarts, 'reset')}"
        advice = "the supply dips: give the board 3.3 V of its own with a capacitor of 10 uF close to it"
    elif lost or transfers:
        advice = "the wires are disturbed: shorten them, keep them off motors, add pull-ups of 2.2 to 4.7 kOhm to 3.3 V"
    troubles = ("samples", "samples_lost", "gaps", "fifo_resets", "bus_errors", "bus_retries", "chip_restarts")
    return Finding(
        name="no sample lost",
        ok=not lost,
        found=found,
        advice=advice,
        figures={name: float(count) for name, count in health.as_dict().items() if count or name in troubles},
    )


def _times(n: int, what: str) -> str:
    return f"{n} {what}{'' if n == 1 else 's'}"
