"""Reading a magnetometer by the chip's own I2C master: it fetches the data, and they stand beside the sensors'."""

from __future__ import annotations

import math

import numpy as np

from quavelet.core.blocks import CountArray
from quavelet.core.clock import Clock
from quavelet.core.errors import ChipUnstable, DeviceMissing, SettingsError
from quavelet.core.health import Health
from quavelet.core.units import NS_PER_MS, NS_PER_S
from quavelet.mpu6050 import registers as r
from quavelet.mpu6050.access import RegisterAccess
from quavelet.mpu6050.magnetometer import aux_registers as aux
from quavelet.mpu6050.magnetometer.bypass import prepared
from quavelet.mpu6050.magnetometer.identify import FoundMagnetometer
from quavelet.mpu6050.magnetometer.plan import MagnetometerConfig, Plan
from quavelet.mpu6050.magnetometer.reader import Reader
from quavelet.mpu6050.magnetometer.samples import MagSample, Sampler
from quavelet.mpu6050.registers import RegisterBits

_LATE = 0.05
"""How much faster than its nominal rate the chip may sample, without its gyroscope's clock (PS 6.6)."""
_TRANSFER_NS = NS_PER_MS
"""Longer than all that the slaves transfer at one sample."""


class MasterReader(Reader):
    """A magnetometer whose data the chip fetches at its own samples.

    Every method raises BusError; `read` DeviceMissing where the magnetometer did not acknowledge since the last look,
    and DeviceLost and ChipUnstable where it does not measure as it was told, or the chip was reset. After each of them,
    and whenever the chip was reset, `set_up` brings all back.

    table  the chip's registers as set up, for one who looks at them now and then; empty before
    """

    def __init__(
        self,
        chip: RegisterAccess,
        found: FoundMagnetometer,
        config: MagnetometerConfig,
        *,
        clock: Clock,
        health: Health,
    ) -> None:
        if found.outside:
            raise SettingsError(
                f"the {found.name} is on the outer bus, where the chip's master cannot reach it: read it by itself"
            )
        super().__init__(chip, found, config, clock=clock, health=health)
        self.table: tuple[RegisterBits, ...] = ()

    @property
    def plan(self) -> Plan:
        """What was set up. Raises ValueError before."""
        if self._plan is None:
            raise ValueError("the magnetometer is not set up: call set_up first")
        return self._plan

    def set_up(self) -> None:
        """Set the magnetometer up by the bypass, close that, and let the master fetch its data; up to 20 ms.

        The chip must be awake and configured: how many samples apart the fetching is follows from its sample rate.
        Frames in a FIFO change their length where its slave bits are set: start it afterwards. Raises SettingsError
        where the rate does not go with the chip's, ChipUnstable where the chip sleeps or does not hold what is written.
        """
        chip = self._chip
        if chip.read(r.PWR_MGMT_1) & (r.SLEEP.mask | r.CYCLE.mask):
            raise ChipUnstable("the chip sleeps, and so does its I2C master: wake it, then set the magnetometer up")
        period_s = chip.stream_info().nominal_period_s
        for control in aux.SLV_CTRL:
            chip.write(control, 0)
        chip.apply(RegisterBits(aux.SLV4_CTRL, 0, aux.SLV_EN))
        # A master switched off in mid-transfer would leave the magnetometer holding the line.
        self._clock.sleep_until_ns(self._clock.now_ns() + _TRANSFER_NS)
        try:
            aux.open_bypass(chip)
            plan = prepared(self._target, self._found, self._config, clock=self._clock)
        finally:
            aux.close_bypass(chip)
        self.table, self._plan = switch_on(chip, plan, sample_period_s=period_s), plan
        self._sampler = self._new_sampler(plan)

    def sampler(self) -> Sampler:
        """The maker of samples from bytes that came by another way, as in frames of the FIFO. Raises ValueError before
        `set_up`."""
        if self._sampler is None:
            raise ValueError("the magnetometer is not set up: call set_up first")
        return self._sampler

    def read(self) -> MagSample:
        """What the master has fetched last; `new` is False where its words are those of the last look."""
        self._acknowledged()
        block = self._chip.read_run(r.EXT_SENS_DATA, self.plan.block_bytes)
        return self.sampler().take_copied(block, self._clock.now_ns())

    def read_with_sensors(self) -> tuple[CountArray, MagSample]:
        """The words (7,) of accelerometer, temperature and gyroscope, and the magnetometer's, in one burst: all of one
        sample of the chip."""
        self._acknowledged()
        before = r.EXT_SENS_DATA.address - r.ACCEL_OUT.address
        data = self._chip.read_run(r.ACCEL_OUT, before + self.plan.block_bytes)
        counts = np.frombuffer(data[:before], dtype=">i2").astype(np.int16)
        return counts, self.sampler().take_copied(data[before:], self._clock.now_ns())

    def _acknowledged(self) -> None:
        plan = self.plan
        slaves = len(plan.runs) + (plan.trigger is not None)
        status = self._chip.read(aux.I2C_MST_STATUS)
        if status & ((1 << slaves) - 1):
            raise DeviceMissing(
                f"the {plan.name} at 0x{plan.address:02x} did not acknowledge the chip's I2C master on "
                f"{self._chip.bus.name}: check the auxiliary wires, then set it up anew",
                address=plan.address,
                register=aux.I2C_MST_STATUS.address,
            )


def switch_on(chip: RegisterAccess, plan: Plan, *, sample_period_s: float) -> tuple[RegisterBits, ...]:
    """Let the chip's master fetch what the plan says; the rows that were written for it.

    Raises BusError, SettingsError, and ChipUnstable where the chip does not hold what is written.
    """
    table = master_table(plan, sample_period_s=sample_period_s)
    # The places in EXT_SENS_DATA are given anew by this, and only while the master is off (RM p. 32, 38).
    off = chip.read(r.USER_CTRL) & aux.USER_KEPT & ~r.USER_I2C_MST_EN.mask
    chip.write(r.USER_CTRL, off | aux.USER_I2C_MST_RESET.mask)
    for row in table:
        chip.apply(row)
    wrong = [row.register.name for row in table if not row.holds(chip.read(row.register))]
    if wrong:
        raise ChipUnstable(f"{', '.join(wrong)} did not read back as written: set the magnetometer up anew")
    chip.read(aux.I2C_MST_STATUS)  # clears what was not acknowledged before
    return table


def fetch_every(plan: Plan, *, sample_period_s: float) -> int:
    """How many samples of the chip the master lets go by from one fetching to the next, that one counted.

    A triggered measurement is fetched and the next one begun: they must be as far apart as one takes, or as the rate
    has it. One that goes on by itself is fetched twice as often as it measures, where the chip samples so fast.
    Raises SettingsError where the counter cannot hold it.
    """
    if plan.trigger:
        apart_s = max(1.0 / plan.rate_hz, plan.measuring_ns / NS_PER_S * (1.0 + _LATE))
        every = math.ceil(apart_s / sample_period_s * (1.0 - 1e-9))
        if every > aux.LONGEST_DELAY + 1:
            slowest_hz = 1.0 / (sample_period_s * (aux.LONGEST_DELAY + 1))
            raise SettingsError(
                f"rate_hz = {plan.rate_hz:g} is too slow for the chip's I2C master beside {1 / sample_period_s:g} "
                f"samples a second: take {slowest_hz:g} or more"
            )
        return every
    return min(max(1, int(0.5 / plan.rate_hz / sample_period_s)), aux.LONGEST_DELAY + 1)


def master_table(plan: Plan, *, sample_period_s: float) -> tuple[RegisterBits, ...]:
    """The rows that make the chip's master fetch the magnetometer's data, in order; the last one switches it on.

    Slaves from 0 on read, the one after them writes the trigger: in this order they are served, so that a measurement
    is fetched before the next begins. WAIT_FOR_ES keeps data ready back until the fetched bytes are there (RM p. 17).
    Raises SettingsError.
    """
    control = aux.WAIT_FOR_ES.mask | aux.I2C_MST_CLK.encode(aux.CLOCK_400_KHZ)
    rows = [_row(r.INT_PIN_CFG, 0, aux.I2C_BYPASS_EN.mask), _row(r.I2C_MST_CTRL, control)]
    for n, run in enumerate(plan.runs):
        rows += [
            _row(aux.SLV_ADDR[n], aux.SLV_READ | plan.address),
            _row(aux.SLV_REG[n], run.register.address),
        ]
    slaves = len(plan.runs)
    if plan.trigger:
        rows += [
            _row(aux.SLV_ADDR[slaves], plan.address),
            _row(aux.SLV_REG[slaves], plan.trigger.register.address),
            _row(aux.SLV_DO[slaves], plan.trigger.byte),
        ]
        slaves += 1
    every = fetch_every(plan, sample_period_s=sample_period_s)
    rows += [
        # Its switch is left out: a single write by slave 4 sets it, and it falls back by itself.
        _row(aux.SLV4_CTRL, aux.I2C_MST_DLY.encode(every - 1), aux.I2C_MST_DLY.mask),
        _row(aux.I2C_MST_DELAY_CTRL, aux.DELAY_ES_SHADOW.mask | ((1 << slaves) - 1)),
    ]
    lengths = [run.n for run in plan.runs] + [1] * (plan.trigger is not None)
    rows += [_row(aux.SLV_CTRL[n], aux.SLV_EN | length) for n, length in enumerate(lengths)]
    return (*rows, _row(r.USER_CTRL, r.USER_I2C_MST_EN.mask, r.USER_I2C_MST_EN.mask))


def _row(register: r.Register, byte: int, bits: int = 0xFF) -> RegisterBits:
    return RegisterBits(register, byte, bits & ~byte)
