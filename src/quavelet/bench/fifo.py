"""The FIFO's size and its overflow, which are what a clone differs in and a program must know."""

from __future__ import annotations

from quavelet.bench.finding import Finding
from quavelet.bus.protocol import I2CBus
from quavelet.core.clock import Clock
from quavelet.core.health import Health
from quavelet.core.units import NS_PER_MS
from quavelet.mpu6050 import registers as r
from quavelet.mpu6050.access import RegisterAccess
from quavelet.mpu6050.measuring import stop_fifo
from quavelet.mpu6050.variants import Variant

FILL_NS = 450 * NS_PER_MS
"""The family's largest, 4096 bytes (RM9250 register 29), is 293 frames: so many ms at 1 kHz, and more for a host and an
oscillator that are slow. With the widest filter the divider takes 8 kHz, and it is sooner."""


def overflow(bus: I2CBus, *, address: int, variant: Variant, clock: Clock) -> Finding:
    """Let the FIFO of a running chip overflow. The chip's rate is another afterwards. Raises BusError."""
    chip = RegisterAccess(bus, address=address, clock=clock, health=Health())
    chip.write(r.SMPLRT_DIV, 0)
    chip.restart_fifo()
    clock.sleep_until_ns(clock.now_ns() + FILL_NS)
    count = chip.fifo_count()
    told = bool(chip.read(r.INT_STATUS) & r.FIFO_OFLOW_INT.mask)
    stop_fifo(chip)  # not restarted: a slow host would find it full again
    left = chip.fifo_count()
    figures = {"fifo_bytes": float(count)}
    found = f"holds {count} bytes, and says when it overflows"
    if not count:
        return Finding(
            name="FIFO",
            ok=False,
            found="stays empty",
            advice="power the board off and on; if that does not help, the chip is broken",
            figures=figures,
        )
    if count != variant.fifo_bytes:
        return Finding(
            name="FIFO",
            ok=False,
            found=f"holds {count} bytes where the {variant.name} has {variant.fifo_bytes}",
            advice="it is a clone, and samples will be lost or torn; replace it, or raise loop.rate_hz",
            figures=figures,
        )
    if not told:
        return Finding(
            name="FIFO",
            ok=False,
            found=f"holds {count} bytes, but says nothing when it overflows",
            advice="it is a clone; keep loop.rate_hz high, so that the FIFO never fills",
            figures=figures,
        )
    if left:
        return Finding(
            name="FIFO",
            ok=False,
            found=f"{found}, but cannot be emptied: {left} bytes were left",
            advice="power the board off and on; if that does not help, the chip is broken",
            figures=figures,
        )
    return Finding(name="FIFO", ok=True, found=found, figures=figures)
