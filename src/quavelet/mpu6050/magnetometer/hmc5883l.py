"""The HMC5883L; pages ("DS") are those of Honeywell's data sheet form 900405."""

from __future__ import annotations

import struct

from quavelet.core.units import NS_PER_MS
from quavelet.mpu6050.magnetometer.plan import (
    MagnetometerConfig,
    Plan,
    Run,
    Words,
    Write,
    check_triggered_rate,
    range_index,
)
from quavelet.mpu6050.registers import Register

NAME, ADDRESS = "HMC5883L", 0x1E
CONFIG_A = Register(0x00, "CONFIG_A", 12, 0x10)
CONFIG_B = Register(0x01, "CONFIG_B", 13, 0x20)
MODE = Register(0x02, "MODE", 14, 0x01)
STATUS = Register(0x09, "STATUS", 16, access="r")
IDENTIFICATION = Register(0x0A, "IDENTIFICATION_A", 17, access="r", length=3)
ID = b"H43"

RANGES_UT = (88.0, 130.0, 190.0, 250.0, 400.0, 470.0, 560.0, 810.0)
_LSB_PER_GAUSS = (1370, 1090, 820, 660, 440, 390, 330, 230)  # DS 13, table 9
_UT_PER_GAUSS = 100.0
FASTEST_HZ = 100.0
"""DS 14 allows 160; this leaves room between two measurements, of which one takes 6 ms (DS 18)."""

_SATURATED = -4096  # DS 15
_RDY = 0x01
_SINGLE = 0x01
_NOT_AVERAGED = 0x10  # one measurement a sample, no bias field, as after power-up
_MEASURING_NS = 8 * NS_PER_MS


def plan(config: MagnetometerConfig, _adjustment: tuple[int, int, int] | None = None) -> Plan:
    """Single measurements, one after the other: in continuous mode RDY stays set after reading, and an old measurement
    looks like a new one (DS 16). Raises SettingsError.

    Both configuration registers are read with the data: a chip whose supply failed for a moment goes on measuring when
    it is triggered, but at the gain of power-up.
    """
    check_triggered_rate(NAME, config.rate_hz, fastest_hz=FASTEST_HZ)
    gain = range_index(NAME, RANGES_UT, config.range_ut)
    gain_byte = gain << 5
    ut_per_lsb = _UT_PER_GAUSS / _LSB_PER_GAUSS[gain]

    def decode(block: bytes) -> Words:
        # x, z, y, high byte first (DS 15).
        status, config_a, config_b, x, z, y = struct.unpack(">BBBxhhh", block)
        return Words(
            (x, y, z),
            ready=bool(status & _RDY),
            overflow=_SATURATED in (x, y, z),
            upset=(config_a, config_b) != (_NOT_AVERAGED, gain_byte),
        )

    trigger = Write(MODE, _SINGLE)
    return Plan(
        NAME,
        ADDRESS,
        config.rate_hz,
        # The first measurement after a change still has the gain before (DS 13): it is made and replaced, since the
        # chip's master would fetch it.
        (
            Write(CONFIG_A, _NOT_AVERAGED),
            Write(CONFIG_B, gain_byte),
            Write(MODE, _SINGLE, _MEASURING_NS),
            Write(MODE, _SINGLE, _MEASURING_NS),
        ),
        (Run(STATUS, 1), Run(CONFIG_A, 9)),
        decode,
        (ut_per_lsb, ut_per_lsb, ut_per_lsb),
        trigger,
        _MEASURING_NS,
    )
