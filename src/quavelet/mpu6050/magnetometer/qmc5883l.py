"""The QMC5883L, found on most boards sold with an HMC5883L; sections ("DS") are those of QST's data sheet 1.0."""

from __future__ import annotations

import struct

from quavelet.core.units import NS_PER_MS
from quavelet.mpu6050.magnetometer.plan import MagnetometerConfig, Plan, Run, Words, Write, range_index, rate_index
from quavelet.mpu6050.registers import Register

NAME, ADDRESS = "QMC5883L", 0x0D
STATUS = Register(0x06, "STATUS", 0, access="r", known_from="DS 9.2.2")
CONTROL_1 = Register(0x09, "CONTROL_1", 0, known_from="DS 9.2.4")
CONTROL_2 = Register(0x0A, "CONTROL_2", 0, known_from="DS 9.2.4")
SET_RESET = Register(0x0B, "SET_RESET_PERIOD", 0, known_from="DS 9.2.5")
CHIP_ID = Register(0x0D, "CHIP_ID", 0, 0xFF, access="r", known_from="drivers; DS 9.1 calls it reserved")
ID = 0xFF
STATUS_RESERVED = 0xF8
CONTROL_2_RESERVED = 0x3E
"""Bits that read 0 in this chip and 1 where nothing drives the line."""

RANGES_UT = (200.0, 800.0)
_LSB_PER_UT = (120.0, 30.0)  # DS 2.1
RATES_HZ = (10.0, 50.0, 100.0, 200.0)  # DS 9.2.4, table 18

_DRDY, _OVL = 0x01, 0x02
_CONTINUOUS = 0x01  # with an oversampling of 512, which is 0
_SOFT_RST, _ROL_PNT, _INT_OFF = 0x80, 0x40, 0x01
_ENDS = (-32768, 32767)


def plan(config: MagnetometerConfig, _adjustment: tuple[int, int, int] | None = None) -> Plan:
    """Continuous measurement. Raises SettingsError.

    Reading the data takes the ready bit away, so that the status has to come first: with ROL_PNT the pointer goes from
    it, register 6, to the data from 0 on (DS 9.2.4).
    """
    rate = rate_index(NAME, RATES_HZ, config.rate_hz)
    scale = range_index(NAME, RANGES_UT, config.range_ut)
    ut_per_lsb = 1.0 / _LSB_PER_UT[scale]
    return Plan(
        NAME,
        ADDRESS,
        config.rate_hz,
        (
            Write(CONTROL_2, _SOFT_RST, NS_PER_MS),
            Write(SET_RESET, 0x01),  # as DS 9.2.5 recommends
            Write(CONTROL_2, _ROL_PNT | _INT_OFF),
            Write(CONTROL_1, scale << 4 | rate << 2 | _CONTINUOUS),
        ),
        (Run(STATUS, 7),),
        _decode,
        (ut_per_lsb, ut_per_lsb, ut_per_lsb),
    )


def _decode(block: bytes) -> Words:
    status, x, y, z = struct.unpack("<Bhhh", block)
    at_end = any(word in _ENDS for word in (x, y, z))
    return Words((x, y, z), ready=bool(status & _DRDY), overflow=at_end or bool(status & _OVL))
