"""The HMC5883L, the magnetometer of early GY-86, GY-87 and GY-271 boards.

Pages ("DS") are those of Honeywell's data sheet form 900405; where it is silent, of the HMC5883's.
"""

from __future__ import annotations

import numpy as np

from hw_fakes.magnetometers.base import UT_PER_GAUSS, Magnetometer, Measurement, triple
from quavelet.core.units import NS_PER_MS

CONFIG_A, CONFIG_B, MODE = 0x00, 0x01, 0x02
DATA, STATUS, IDENTIFICATION = 0x03, 0x09, 0x0A
SINGLE, IDLE = 0x01, 0x03
RDY, LOCK = 0x01, 0x02

# DS 13, table 9, LSB per gauss; DS 12, table 5: the rate 7 is reserved, and taken as the fastest.
GAINS = (1370, 1090, 820, 660, 440, 390, 330, 230)
RATES_HZ = (0.75, 1.5, 3.0, 7.5, 15.0, 30.0, 75.0, 75.0)
SELF_TEST_UT = np.array([1.16, 1.16, 1.08]) * UT_PER_GAUSS  # DS 19
SATURATED = -4096  # DS 15
MEASURING_NS = 6 * NS_PER_MS  # DS 18
POWER_UP_NS = 56 * NS_PER_MS  # DS 18: from no voltage to the first measurement
NOT_READY_NS = 250_000  # DS 16


class Hmc5883l(Magnetometer):
    """An HMC5883L at 0x1E.

    The words come as x, z, y, high byte first. After register 8 the pointer goes to 3 (DS 18), after 12 to 0 (as in
    the HMC5883), else to the next.
    Not certain: what the mode register reads after a single measurement (here 3), and RDY, of which DS 16 says that
    only a new measurement clears it, for 250 us, and DS 14 that in single mode reading the data clears it; here both.
    Not there: DRDY pin, high-speed I2C, the longer time of an averaged measurement.
    """

    address = 0x1E

    def _power_up(self) -> None:
        self._config_a, self._config_b, self._mode = 0x10, 0x20, SINGLE  # DS 12 to 14
        self._ready = self._mode_read = False
        self._unread: set[int] = set()  # of the data registers, once one has been read
        self._gain = self._gain_before = self._config_b >> 5
        self._gain_since = 0  # the first measurement with the new gain
        self._measure(first_ns=POWER_UP_NS)

    @property
    def _locked(self) -> bool:
        return self._mode_read or bool(self._unread)

    def _unlock(self) -> None:
        self._mode_read = False
        self._unread.clear()

    def _settings(self, number: int, /) -> tuple[int, ...]:
        return self._config_a, self._gain if number >= self._gain_since else self._gain_before

    def _placed(self, newest: Measurement, _before: int, /) -> None:
        if self._mode == SINGLE:
            self._mode = IDLE
        if not self._locked:
            self._show(newest)
            self._ready = True

    def _counts(self, measurement: Measurement) -> tuple[int, int, int]:
        config_a, gain = measurement.settings
        lsb_per_ut = GAINS[gain] / UT_PER_GAUSS
        field_ut, noise_ut = self._field_and_noise_ut(measurement)
        noise_ut = noise_ut / np.sqrt(1 << (config_a >> 5 & 3))
        shown_ut = field_ut
        if config_a & 3 in (1, 2):
            # DS 19: a measurement with the strap's field less one without, so that the world's cancels; but the
            # first of the two can saturate.
            shown_ut = SELF_TEST_UT if config_a & 3 == 1 else -SELF_TEST_UT
            field_ut = field_ut + shown_ut
        seen = np.rint((field_ut + noise_ut) * lsb_per_ut)
        shown = np.rint((shown_ut + noise_ut) * lsb_per_ut)
        return triple(np.where((seen < -2048) | (seen > 2047), SATURATED, shown))

    def _load(self, register: int) -> int:
        if DATA <= register < STATUS:
            x, y, z = self._data()
            self._read_data(register)
            word = (x, z, y)[(register - DATA) // 2] & 0xFFFF
            return word & 0xFF if (register - DATA) % 2 else word >> 8
        if register == STATUS:
            return (LOCK if self._locked else 0) | (RDY if self._ready and not self._placing else 0)
        if IDENTIFICATION <= register < IDENTIFICATION + 3:
            return b"H43"[register - IDENTIFICATION]
        if register == MODE:
            self._mode_read = True  # DS 16: this too locks the data
            return self._mode
        return {CONFIG_A: self._config_a, CONFIG_B: self._config_b}.get(register, 0)

    def _read_data(self, register: int) -> None:
        unread = self._unread or set(range(DATA, STATUS))
        self._unread = unread - {register}
        if not self._unread:
            self._mode_read = False
        if self._series is None:
            self._ready = False

    @property
    def _placing(self) -> bool:
        """RDY is 0 for 250 us while continuous data are placed."""
        series = self._series
        if series is None or not series.period_ns or self._locked:
            return False
        return series.end_ns(self._ended) - self._now_ns <= NOT_READY_NS

    def _store(self, register: int, value: int) -> None:
        if register == CONFIG_A:
            self._config_a = value & 0x7F
            self._unlock()
            if self._mode == 0:
                self._continue()
        elif register == CONFIG_B:
            # DS 13: the first measurement after a change still has the gain before.
            self._config_b = value & 0xE0
            if value >> 5 != self._gain:
                if self.measurements >= self._gain_since:
                    self._gain_before = self._gain
                self._gain, self._gain_since = value >> 5, self.measurements + 1
        elif register == MODE:
            self._mode = value & 0x03
            self._unlock()
            if self._mode == 0:
                self._continue()
            elif self._mode == SINGLE:
                self._ready = False
                self._measure(first_ns=MEASURING_NS)
            else:
                self._rest()

    def _continue(self) -> None:
        self._measure(first_ns=MEASURING_NS, rate_hz=RATES_HZ[self._config_a >> 2 & 7])

    def _after(self, register: int) -> int:
        if register == STATUS - 1:
            return DATA
        return 0 if register >= IDENTIFICATION + 2 else register + 1
