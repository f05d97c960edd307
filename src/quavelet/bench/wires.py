"""The wires: who answers, how fast they are, and whether bytes arrive as they were sent."""

from __future__ import annotations

import errno
from collections.abc import Callable
from dataclasses import dataclass, field

from quavelet.bench.finding import Finding
from quavelet.bus.protocol import I2CBus
from quavelet.core.clock import Clock
from quavelet.core.errors import BusError, DeviceLost
from quavelet.core.units import NS_PER_MS, NS_PER_S
from quavelet.mpu6050 import registers as r
from quavelet.settings import Settings

MPU_ADDRESSES = (0x68, 0x69)
NEIGHBOURS: dict[int, tuple[int, str]] = {
    0x0C: (0x00, "an AK8963 or AK8975 magnetometer"),
    0x0D: (0x0D, "a QMC5883L magnetometer"),
    0x1E: (0x0A, "an HMC5883L magnetometer"),
    0x53: (0x00, "an ADXL345 accelerometer"),
    0x57: (0x00, "the EEPROM of a clock board"),
    0x76: (0xD0, "a barometer"),
    0x77: (0xD0, "a barometer"),
}
"""What usually sits beside an MPU-6050: address to a register that may be read without any effect, and the name.
An address where one byte written does something (a port expander, a display) is not among them."""

TRIES = 3
LONG, SHORT, REPEATS = 1024, 64, 5
BITS_PER_BYTE = 9
FASTEST_HZ = 3_400_000
"""No I2C is faster, but in its ultra-fast mode, which cannot be read."""
CHIP_HZ = 400_000
"""PS 6.4: the chip's fastest."""
FAST_ENOUGH_HZ = 300_000
"""Less is no 400 kHz bus, whatever a clock that is not exact and a chip that stretches it take off."""
LOOK_BITS = 140
"""Of one drain beside its frames: status, count, register to read from, and what the register watch takes."""
LOAD = 0.8
PATTERNS = (0x00, 0xFF, 0x55, 0xAA, 0x01, 0x02, 0x04, 0x08, 0x10, 0x20, 0x40, 0x80, 0x0F, 0xF0, 0x33, 0xCC)
ROUNDS = 8
LONGEST_NS = NS_PER_S
"""A slow adapter is asked fewer times."""
DEAD_AFTER = 10
_NOBODY = (errno.EREMOTEIO, errno.ENXIO)


@dataclass(slots=True)
class Scan:
    """Who answered, by address the byte it gave; and who could not be asked, with the reason."""

    answers: dict[int, int] = field(default_factory=dict)
    refused: dict[int, BusError] = field(default_factory=dict)

    def __str__(self) -> str:
        return ", ".join(f"0x{address:02x}{_usual(address)}" for address in sorted(self.answers)) or "nobody"


def _usual(address: int) -> str:
    return f" ({NEIGHBOURS[address][1]}?)" if address in NEIGHBOURS else ""


def scan(bus: I2CBus, *, address: int) -> Scan:
    """Read one byte at `address`, at the chip's two addresses and those of its usual neighbours; write none.

    Raises BusError where the bus does not work at all, with a line held low.
    """
    found = Scan()
    for asked in sorted({address, *MPU_ADDRESSES, *NEIGHBOURS}):
        register = r.WHO_AM_I.address if asked in (address, *MPU_ADDRESSES) else NEIGHBOURS[asked][0]
        for left in reversed(range(TRIES)):
            try:
                found.answers[asked] = bus.write_read(asked, bytes([register]), 1)[0]
                break
            except BusError as error:
                if error.errno == errno.ETIMEDOUT:
                    raise
                if not left and error.errno not in _NOBODY:
                    found.refused[asked] = error
    return found


def looks_like_clock(first: bytes) -> bool:
    """Whether seven registers from 0 on are the time of a DS1307 or DS3231: seconds to year in decimal digits."""
    digits = [(byte >> 4) * 10 + (byte & 0x0F) for byte in (first[0] & 0x7F, first[1], first[4], first[5] & 0x1F)]
    decimal = all(byte & 0x0F < 10 for byte in (first[0], first[1], first[2], first[4], first[5], first[6]))
    seconds, minutes, date, month = digits
    return decimal and seconds < 60 and minutes < 60 and 1 <= first[3] <= 7 and 1 <= date <= 31 and 1 <= month <= 12


def speed(bus: I2CBus, *, settings: Settings, clock: Clock, set_hz: int | None) -> Finding:
    """How fast bytes come: a long read against a short one, so that what a call costs falls out.

    Raises BusError where the chip does not answer at all.
    """
    name = "wire speed"
    try:
        long_ns = _fastest(bus, settings.bus.address, LONG, clock)
        short_ns = _fastest(bus, settings.bus.address, SHORT, clock)
    except BusError as error:
        _again(lambda: bus.write_read(settings.bus.address, bytes([r.WHO_AM_I.address]), 1))
        return Finding(
            name=name,
            ok=False,
            found=f"a read of {LONG} bytes, as the FIFO needs them, failed where one byte comes: {error}",
            advice="shorten the wires and check the pull-ups; an adapter that refuses long reads cannot be used",
        )
    bits = BITS_PER_BYTE * (LONG - SHORT)
    hz = bits * NS_PER_S / max(long_ns - short_ns, 1)
    if hz > FASTEST_HZ:
        found = "could not be measured: bytes come faster than over any wires"
        if bus.name.startswith("fake:"):
            found += ", as a fake's do that is not on virtual time"
        return Finding(name=name, ok=True, found=found)
    needed_hz = settings.chip.sample_rate_hz * BITS_PER_BYTE * settings.frame_bytes + settings.loop.rate_hz * LOOK_BITS
    most = max(0.0, (LOAD * hz - settings.loop.rate_hz * LOOK_BITS) / (BITS_PER_BYTE * settings.frame_bytes))
    found = f"{hz / 1000:.0f} kHz, {hz / BITS_PER_BYTE / 1000:.1f} kB/s"
    if set_hz:
        found += f", set to {set_hz / 1000:.0f} kHz"
    found += f"; {100 * needed_hz / hz:.0f} % of it is needed for {settings.chip.sample_rate_hz:g} samples/s"
    faster = "set dtparam=i2c_arm_baudrate=400000 in /boot/firmware/config.txt and reboot"
    if needed_hz > LOAD * hz:
        # With the FIFO nothing is lost by a slower chip but its rate.
        slower = f", or ask for chip.sample_rate_hz of {most:.0f} at most" if most >= 10 else ""
        return Finding(name=name, ok=False, found=found, advice=faster + slower, figures={"bus_hz": round(hz)})
    advice = ""
    if hz < FAST_ENOUGH_HZ:
        advice = f"enough, but samples come sooner, and up to 1000/s, over 400 kHz: {faster}"
    elif hz > 1.1 * CHIP_HZ:
        advice = f"the chip is made for {CHIP_HZ // 1000} kHz: set dtparam=i2c_arm_baudrate=400000"
    return Finding(name=name, ok=True, found=found, advice=advice, figures={"bus_hz": round(hz)})


def _fastest(bus: I2CBus, address: int, n: int, clock: Clock) -> int:
    """The shortest of some reads of `n` bytes, ns: whatever else the machine did only made them longer."""
    # From the FIFO's port: it is the one register that a long read stays on, and nothing is in it that is needed.
    times: list[int] = []
    for _ in range(REPEATS):
        before_ns = clock.now_ns()
        _again(lambda: bus.write_read(address, bytes([r.FIFO_R_W.address]), n))
        times.append(clock.now_ns() - before_ns)
    return min(times)


def registers_hold(bus: I2CBus, *, address: int, clock: Clock) -> Finding:
    """Write every kind of byte to the sample rate divider and read it back; the chip is reset afterwards.

    Raises DeviceLost where nothing is acknowledged any more.
    """
    _again(lambda: bus.write(address, bytes([r.PWR_MGMT_1.address, r.CLKSEL.encode(r.CLOCK_PLL_GYRO_X)])))
    clock.sleep_until_ns(clock.now_ns() + 10 * NS_PER_MS)
    port, written, reads = r.SMPLRT_DIV.address, 0, set[int]()
    wrong_bits, wrong, failed, in_a_row = 0, 0, 0, 0
    end_ns = clock.now_ns() + LONGEST_NS
    for byte in PATTERNS * ROUNDS:
        if written >= len(PATTERNS) and clock.now_ns() > end_ns:
            break
        written += 1
        try:
            bus.write(address, bytes([port, byte]))
            read = bus.write_read(address, bytes([port]), 1)[0]
        except BusError as error:
            failed, in_a_row = failed + 1, in_a_row + 1
            if in_a_row >= DEAD_AFTER:
                raise DeviceLost(f"the chip answered and then no longer did: {error}") from error
            continue
        in_a_row = 0
        reads.add(read)
        wrong += read != byte
        wrong_bits |= read ^ byte
    figures = {"writes": float(written), "wrong": float(wrong), "failed": float(failed)}
    if not wrong and not failed:
        return Finding(
            name="registers", ok=True, found=f"hold what is written, {written} bytes of all kinds", figures=figures
        )
    found = f"of {written} bytes {wrong} read back otherwise and {failed} were not transferred"
    if len(reads) == 1:
        return Finding(
            name="registers",
            ok=False,
            found=f"{found}: the chip takes no writes",
            advice="power the board off and on; if that does not help, the chip is broken or no MPU-6050",
            figures=figures,
        )
    bits = f" (bits {wrong_bits:#04x})" if wrong else ""
    return Finding(
        name="registers",
        ok=False,
        found=found + bits,
        advice="the wires are disturbed: shorten them, keep them off motors, add pull-ups of 2.2 to 4.7 kOhm to 3.3 V",
        figures=figures,
    )


def _again(transfer: Callable[[], object]) -> None:
    for left in reversed(range(TRIES)):
        try:
            transfer()
            return
        except BusError:
            if not left:
                raise
