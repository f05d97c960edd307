"""The QMC5883L, which sits on most boards that are sold as carrying an HMC5883L.

Sections ("DS") are those of QST's data sheet 1.0.
"""

from __future__ import annotations

import numpy as np

from hw_fakes.magnetometers.base import (
    NO_ROTATION,
    PERFECT_MAGNETOMETER,
    UT_PER_GAUSS,
    Magnetometer,
    MagnetometerImperfections,
    Measurement,
    triple,
)
from hw_fakes.world.imperfections import Matrix
from hw_fakes.world.motion_base import Motion
from quavelet.core.clock import Clock
from quavelet.core.units import NS_PER_S

STATUS, TEMPERATURE, CONTROL_1, CONTROL_2, SET_RESET, CHIP_ID = 0x06, 0x07, 0x09, 0x0A, 0x0B, 0x0D
LAST_DATA = 0x05
DRDY, OVL, DOR = 0x01, 0x02, 0x04
CONTINUOUS = 0x01
SOFT_RST, ROL_PNT, INT_ENB = 0x80, 0x40, 0x01

RATES_HZ = (10.0, 50.0, 100.0, 200.0)  # DS 9.2.4, table 18
LSB_PER_GAUSS = (12000, 3000, 3000, 3000)  # DS 2.1; the last two are reserved
LSB_PER_DEGC, TEMP_ZERO_DEGC = 100, 50.0  # DS 9.2.3; the zero is not compensated, this is one part's


class Qmc5883l(Magnetometer):
    """A QMC5883L at 0x0D.

    The words come as x, y, z, low byte first. Reserved modes count as standby.
    Not certain: the chip id 0xFF, since DS 9.1 calls that register reserved but drivers read it so; that from the
    first data byte read to the last no new data are placed, which drivers tell of and DS 9.2 does not; the first
    measurement, here one period after the mode is set; where the pointer goes after 0x0D, here to 0.
    Not there: the INT pin, the set/reset period 0x0B, which is a byte of memory, and the filter behind OSR, which
    here scales the noise.
    """

    address = 0x0D

    def __init__(
        self,
        clock: Clock,
        motion: Motion,
        *,
        imperfections: MagnetometerImperfections = PERFECT_MAGNETOMETER,
        mounting: Matrix = NO_ROTATION,
        birth_ns: int | None = None,
        temp_degc: float = 25.0,
    ) -> None:
        self.temp_degc = temp_degc
        super().__init__(clock, motion, imperfections=imperfections, mounting=mounting, birth_ns=birth_ns)

    def _power_up(self) -> None:
        self._control_1 = self._control_2 = self._set_reset = 0
        self._ready = self._skipped = self._locked = False

    def _settings(self, _number: int, /) -> tuple[int, ...]:
        return (self._control_1,)

    def _placed(self, newest: Measurement, before: int, /) -> None:
        if self._locked:
            self._skipped = True
            return
        self._skipped = self._skipped or self._ready or before > 0
        self._ready = True
        self._show(newest)

    def _raw(self, measurement: Measurement) -> tuple[int, int, int]:
        (control,) = measurement.settings
        field_ut, noise_ut = self._field_and_noise_ut(measurement)
        # Noise is that of the highest oversampling, 512, and grows as the square root of what is left out.
        shown_ut = field_ut + noise_ut * np.sqrt(1 << (control >> 6))
        return triple(shown_ut * (LSB_PER_GAUSS[control >> 4 & 3] / UT_PER_GAUSS))

    def _counts(self, measurement: Measurement) -> tuple[int, int, int]:
        x, y, z = (max(-32768, min(32767, word)) for word in self._raw(measurement))
        return x, y, z

    def _load(self, register: int) -> int:
        if register <= LAST_DATA:
            word = self._data()[register // 2] & 0xFFFF
            self._ready = self._skipped = False
            self._locked = register != LAST_DATA
            return word >> 8 if register % 2 else word & 0xFF
        if register == STATUS:
            over = self._shown is not None and self._raw(self._shown) != self._data()
            return (DRDY if self._ready else 0) | (OVL if over else 0) | (DOR if self._skipped else 0)
        if register in (TEMPERATURE, TEMPERATURE + 1):
            word = round((self.temp_degc - TEMP_ZERO_DEGC) * LSB_PER_DEGC) & 0xFFFF
            return word & 0xFF if register == TEMPERATURE else word >> 8
        if register == CHIP_ID:
            return 0xFF
        return {CONTROL_1: self._control_1, CONTROL_2: self._control_2, SET_RESET: self._set_reset}.get(register, 0)

    def _store(self, register: int, value: int) -> None:
        if register == CONTROL_1:
            changed = (self._control_1 ^ value) & 0x0F
            self._control_1 = value
            if value & 0x03 != CONTINUOUS:
                self._rest()
            elif changed:
                rate_hz = RATES_HZ[value >> 2 & 3]
                self._measure(first_ns=round(NS_PER_S / rate_hz), rate_hz=rate_hz)
        elif register == CONTROL_2:
            self._control_2 = value & (ROL_PNT | INT_ENB)
            if value & SOFT_RST:
                self._reset()
        elif register == SET_RESET:
            self._set_reset = value

    def _after(self, register: int) -> int:
        if register == STATUS and self._control_2 & ROL_PNT:
            return 0
        return 0 if register >= CHIP_ID else register + 1
