"""The AK8963 inside the MPU-9250 and the AK8975 inside the MPU-9150.

Sections ("DS") are those of AKM's data sheets MS1356-E-02 (AK8963) and MS1187-E-02 (AK8975).
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

import numpy as np

from hw_fakes.magnetometers.base import (
    PERFECT_MAGNETOMETER,
    Magnetometer,
    MagnetometerImperfections,
    Measurement,
    triple,
)
from hw_fakes.target import Nack
from hw_fakes.world.imperfections import FloatArray, Matrix
from hw_fakes.world.motion_base import Motion
from quavelet.core.clock import Clock

IN_PACKAGE: Matrix = ((0.0, 1.0, 0.0), (1.0, 0.0, 0.0), (0.0, 0.0, -1.0))
"""How it lies beside the gyroscope: x and y exchanged, z down (orientation of axes in the MPU-9150's and MPU-9250's
product specifications)."""

WIA, INFO, ST1, DATA, ST2, CNTL1, CNTL2, ASTC = 0x00, 0x01, 0x02, 0x03, 0x09, 0x0A, 0x0B, 0x0C
I2CDIS, ASA = 0x0F, 0x10
DRDY, DOR = 0x01, 0x02  # ST1
DERR, HOFL, BITM = 0x04, 0x08, 0x10  # ST2
BIT = 0x10  # CNTL1
POWER_DOWN, ONCE, SELF_TEST, FUSE_ROM = 0x0, 0x1, 0x8, 0xF
SELF = 0x40  # ASTC
SRST = 0x01  # CNTL2
I2C_DISABLE = 0x1B

SELF_TEST_UT = np.array([0.0, 0.0, -195.0])  # within the limits of DS 6.4.4 of both, at every resolution
WAIT_NS = 100_000  # DS 6.3: to be waited in power-down before another mode is set


class Akm(Magnetometer):
    """What the two have in common. The words come as x, y, z, low byte first.

    hasty_changes  how often a mode was set without 100 us of power-down before it, against DS 6.3; what the silicon
                   then does is not told, and here the mode is simply set
    """

    address = 0x0C
    info: ClassVar[int]
    measuring_ns: ClassVar[int]
    whole_ut: ClassVar[float]
    rates_hz: ClassVar[Mapping[int, float]] = {}

    def __init__(
        self,
        clock: Clock,
        motion: Motion,
        *,
        imperfections: MagnetometerImperfections = PERFECT_MAGNETOMETER,
        mounting: Matrix = IN_PACKAGE,
        birth_ns: int | None = None,
        sensitivity: tuple[int, int, int] = (176, 177, 165),
    ) -> None:
        """`sensitivity` is the factory's adjustment ASAX, ASAY, ASAZ; 128 stands for none."""
        self.sensitivity = sensitivity
        self.hasty_changes = 0
        super().__init__(clock, motion, imperfections=imperfections, mounting=mounting, birth_ns=birth_ns)

    def write(self, data: bytes) -> None:
        self._answer()
        super().write(data)

    def read(self, n: int) -> bytes:
        self._answer()
        return super().read(n)

    def _answer(self) -> None:
        if self._silent:
            raise Nack

    def _power_up(self) -> None:
        self._silent = False
        self._control = self._self_test = 0
        self._down_since_ns = self._now_ns - WAIT_NS
        self._ready = self._overrun = self._error = self._locked = False

    @property
    def _mode(self) -> int:
        return self._control & 0x0F

    def _settings(self, _number: int, /) -> tuple[int, ...]:
        return self._control, self._self_test

    def _placed(self, newest: Measurement, before: int, /) -> None:
        if self._mode not in self.rates_hz:
            self._control &= ~0x0F  # DS 6.4.2: back to power-down by itself
            self._down_since_ns = newest.t_ns
        if self._locked:
            self._overrun = True
            return
        self._overrun = self._mode in self.rates_hz and (self._overrun or self._ready or before > 0)
        self._ready = True
        self._show(newest)

    def _adjusted_ut(self, measurement: Measurement) -> FloatArray:
        """The field (3,) that its words stand for once they are adjusted."""
        control, self_test = measurement.settings
        if control & 0x0F == SELF_TEST and self_test & SELF:
            return SELF_TEST_UT
        field_ut, noise_ut = self._field_and_noise_ut(measurement)
        adjusted: FloatArray = field_ut + noise_ut
        return adjusted

    def _counts(self, measurement: Measurement) -> tuple[int, int, int]:
        ut_per_lsb, lowest, highest = self._resolution(measurement.settings[0])
        # DS 8.3.11: the adjusted word is the raw one times this.
        adjustment = (np.array(self.sensitivity) - 128) * 0.5 / 128 + 1
        return triple(np.clip(self._adjusted_ut(measurement) / ut_per_lsb / adjustment, lowest, highest))

    def _resolution(self, control: int, /) -> tuple[float, int, int]:
        """uT per LSB, and the lowest and the highest word."""
        raise NotImplementedError

    @property
    def _overflow(self) -> bool:
        return self._shown is not None and bool(np.abs(self._adjusted_ut(self._shown)).sum() >= self.whole_ut)

    def _load(self, register: int) -> int:
        if DATA <= register < ST2:
            word = self._data()[(register - DATA) // 2] & 0xFFFF
            self._read_data()
            return word & 0xFF if (register - DATA) % 2 == 0 else word >> 8
        if register == ST1:
            return (DRDY if self._ready else 0) | (DOR if self._overrun else 0)
        if register == ST2:
            return self._read_st2()
        if ASA <= register < ASA + 3:
            # DS 8.1: "read data is not correct" in other modes; what it is instead is not told.
            return self.sensitivity[register - ASA] if self._mode == FUSE_ROM else 0
        return {WIA: 0x48, INFO: self.info, CNTL1: self._control, ASTC: self._self_test}.get(register, 0)

    def _read_data(self) -> None:
        self._ready = self._overrun = False

    def _read_st2(self) -> int:
        self._ready = self._overrun = self._locked = False
        return HOFL if self._overflow else 0

    def _store(self, register: int, value: int) -> None:
        if register == CNTL1:
            self._set_control(value)
        elif register == ASTC:
            self._self_test = value & SELF
        elif register == I2CDIS and value == I2C_DISABLE:
            self._silent = True

    def _set_control(self, value: int) -> None:
        before, self._control = self._mode, value & (BIT | 0x0F)
        if self._mode and (
            before not in (POWER_DOWN, self._mode) or (not before and self._now_ns - self._down_since_ns < WAIT_NS)
        ):
            self.hasty_changes += 1
        if before and not self._mode:
            self._down_since_ns = self._now_ns
        self._locked = False
        if self._mode in self.rates_hz:
            self._measure(first_ns=self.measuring_ns, rate_hz=self.rates_hz[self._mode])
        elif self._mode in (ONCE, SELF_TEST):
            self._measure(first_ns=self.measuring_ns)
        else:
            self._rest()

    def _after(self, register: int) -> int:
        if register == ASTC:  # DS 7.2.2: addresses go round within 0x00 to 0x0C and within 0x10 to 0x12
            return WIA
        if register == ASA + 2:
            return ASA
        return register if ASTC < register < ASA or register > ASA + 2 else register + 1


class Ak8963(Akm):
    """An AK8963 at 0x0C: 14 or 16 bits, +-4912 uT, single measurements or 8 or 100 a second.

    In the continuous modes the data are frozen from the first byte read until ST2 is read (DS 6.4.3).
    Not certain: INFO. Not there: external trigger, the DRDY pin, and SPI; other modes count as power-down.
    """

    info = 0x9A
    measuring_ns = 7_200_000  # DS 5.3.2, typical; 9 ms at most
    whole_ut = 4912.0  # DS 6.4.3.6: HOFL where |x| + |y| + |z| reaches it
    rates_hz: ClassVar[Mapping[int, float]] = {0x2: 8.0, 0x6: 100.0}

    def _resolution(self, control: int, /) -> tuple[float, int, int]:
        return (0.15, -32760, 32760) if control & BIT else (0.6, -8190, 8190)  # DS 8.3.4, table 8.3

    def _read_data(self) -> None:
        super()._read_data()
        self._locked = self._mode in self.rates_hz

    def _read_st2(self) -> int:
        settings = self._shown.settings[0] if self._shown else 0
        return super()._read_st2() | (BITM if settings & BIT else 0)

    def _store(self, register: int, value: int) -> None:
        if register == CNTL2 and value & SRST:
            self._reset()
        super()._store(register, value)


class Ak8975(Akm):
    """An AK8975 at 0x0C: 13 bits, 0.3 uT per LSB, single measurements only; DERR where data are read during one.

    Not certain: INFO; that DRDY falls when a measurement begins, since the data are readable only until then. Its
    register 0x0B is reserved: no soft reset.
    """

    info = 0x9A
    measuring_ns = 7_300_000  # DS 5.3.2, typical; 9 ms at most
    whole_ut = 2400.0  # DS 6.4.2.3

    def _resolution(self, _control: int, /) -> tuple[float, int, int]:
        return 0.3, -4096, 4095  # DS 8.3.4, table 8.3

    def _read_data(self) -> None:
        self._error = self._error or self._series is not None
        super()._read_data()

    def _read_st2(self) -> int:
        error, self._error = self._error, False
        return super()._read_st2() | (DERR if error else 0)

    def _set_control(self, value: int) -> None:
        super()._set_control(value & 0x0F)
        if self._series is not None:
            self._ready = False
