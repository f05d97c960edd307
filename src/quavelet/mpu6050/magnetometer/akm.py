"""AKM's AK8963, in the MPU-9250, and AK8975, in the MPU-9150.

Sections ("DS") are those of the data sheets MS1356-E-02 (AK8963) and MS1187-E-02 (AK8975).
"""

from __future__ import annotations

import struct

from quavelet.core.clock import Clock
from quavelet.core.errors import ChipUnstable
from quavelet.core.units import NS_PER_MS
from quavelet.mpu6050.access import RegisterAccess
from quavelet.mpu6050.magnetometer.plan import (
    MagnetometerConfig,
    Plan,
    Run,
    Triple,
    Words,
    Write,
    check_triggered_rate,
    range_index,
    rate_index,
)
from quavelet.mpu6050.registers import Register

AK8963, AK8975, ADDRESS = "AK8963", "AK8975", 0x0C
WIA = Register(0x00, "WIA", 0, 0x48, access="r", known_from="DS 8.3.1")
INFO = Register(0x01, "INFO", 0, None, access="r", known_from="DS 8.3.2")
ST1 = Register(0x02, "ST1", 0, access="r", known_from="DS 8.3.3")
CNTL = Register(0x0A, "CNTL1", 0, known_from="DS 8.3.7; CNTL in the AK8975")
ASA = Register(0x10, "ASAX", 0, None, access="r", length=3, known_from="DS 8.3.11")
ID = 0x48
LATER_AKM = {0x04: "AK09912", 0x05: "AK09911", 0x09: "AK09916", 0x0C: "AK09918"}
"""Chips that have the same id at the same address, by their register 1; their map is another."""
BIT = 0x10
"""Of CNTL1: 16 bits. Reserved, and 0, in the AK8975."""
MODE = 0x0F
POWER_DOWN, SINGLE, FUSE_ROM = 0x0, 0x1, 0xF
CONTINUOUS_8963 = {8.0: 0x2, 100.0: 0x6}

RANGES_8963_UT = (4912.0,)
RATES_8963_HZ = tuple(CONTINUOUS_8963)
RANGES_8975_UT = (1229.0,)
FASTEST_8975_HZ = 100.0
"""A measurement takes up to 9 ms (DS 5.3.2)."""

_DRDY = 0x01  # ST1
_DERR, _HOFL, _BITM = 0x04, 0x08, 0x10  # ST2
_WAIT_NS = NS_PER_MS // 5  # DS 6.3: 100 us of power-down between two modes
_MEASURING_NS = 9 * NS_PER_MS


def read_adjustment(target: RegisterAccess, *, clock: Clock) -> tuple[int, int, int]:
    """The factory's ASAX, ASAY, ASAZ; the chip is in power-down afterwards. Raises BusError, and ChipUnstable where the
    fuse ROM cannot be read."""
    for mode in (POWER_DOWN, FUSE_ROM):
        target.write(CNTL, mode)
        clock.sleep_until_ns(clock.now_ns() + _WAIT_NS)
    x, y, z = target.read_run(ASA, 3)
    target.write(CNTL, POWER_DOWN)
    clock.sleep_until_ns(clock.now_ns() + _WAIT_NS)
    if {x, y, z} <= {0x00, 0xFF}:
        raise ChipUnstable(
            f"the magnetometer at 0x{target.address:02x} gives 0x{x:02x} 0x{y:02x} 0x{z:02x} for its sensitivity, "
            f"which no part has: power the board off and on"
        )
    return x, y, z


def plan_ak8963(config: MagnetometerConfig, adjustment: tuple[int, int, int] | None = None) -> Plan:
    """Continuous measurement of 16 bits; the status before the data and the one after, which unlocks them, are read in
    one go (DS 6.4.3). Raises SettingsError."""
    rate_index(AK8963, RATES_8963_HZ, config.rate_hz)
    range_index(AK8963, RANGES_8963_UT, config.range_ut)
    control = BIT | CONTINUOUS_8963[config.rate_hz]
    return Plan(
        AK8963,
        ADDRESS,
        config.rate_hz,
        (Write(CNTL, POWER_DOWN, _WAIT_NS), Write(CNTL, control)),
        (Run(ST1, 8),),
        _decode_ak8963,
        _adjusted(0.15, adjustment),  # DS 8.3.4, table 8.3
        adjustment=adjustment,
    )


def plan_ak8975(config: MagnetometerConfig, adjustment: tuple[int, int, int] | None = None) -> Plan:
    """Single measurements, since it has no other (DS 6.4). Raises SettingsError."""
    check_triggered_rate(AK8975, config.rate_hz, fastest_hz=FASTEST_8975_HZ)
    range_index(AK8975, RANGES_8975_UT, config.range_ut)
    return Plan(
        AK8975,
        ADDRESS,
        config.rate_hz,
        (Write(CNTL, POWER_DOWN, _WAIT_NS),),
        (Run(ST1, 8),),
        _decode_ak8975,
        _adjusted(0.3, adjustment),
        Write(CNTL, SINGLE),
        _MEASURING_NS,
        adjustment,
    )


def _adjusted(ut_per_lsb: float, adjustment: tuple[int, int, int] | None) -> Triple:
    if adjustment is None:
        raise ValueError("an AKM chip needs its sensitivity adjustment: read it with read_adjustment")
    x, y, z = (ut_per_lsb * ((asa - 128) * 0.5 / 128 + 1) for asa in adjustment)  # DS 8.3.11
    return x, y, z


def _decode_ak8963(block: bytes) -> Words:
    st1, x, y, z, st2 = struct.unpack("<BhhhB", block)
    ready = bool(st1 & _DRDY)
    at_end = any(abs(word) >= 32760 for word in (x, y, z))
    # Of 14 bits the same field has a quarter of the counts.
    return Words((x, y, z), ready, at_end or bool(st2 & _HOFL), upset=ready and not st2 & _BITM)


def _decode_ak8975(block: bytes) -> Words:
    st1, x, y, z, st2 = struct.unpack("<BhhhB", block)
    # HOFL speaks of the sum of all axes (DS 6.4.2.3): one alone may stand at its end without it.
    at_end = any(word <= -4096 or word >= 4095 for word in (x, y, z))
    return Words((x, y, z), bool(st1 & _DRDY) and not st2 & _DERR, at_end or bool(st2 & _HOFL))
