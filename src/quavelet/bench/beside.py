"""What is beside the chip on its auxiliary bus."""

from __future__ import annotations

from quavelet.bench.finding import Finding
from quavelet.bus.protocol import I2CBus
from quavelet.core.clock import Clock
from quavelet.core.errors import ImuError
from quavelet.core.health import Health
from quavelet.mpu6050.access import RegisterAccess
from quavelet.mpu6050.magnetometer.identify import find_magnetometer
from quavelet.settings import Settings


def magnetometer(bus: I2CBus, *, settings: Settings, clock: Clock) -> Finding:
    """Which magnetometer answers behind the chip, asked for or not; a board without one is a good one."""
    name, asked = "magnetometer", settings.magnetometer
    chip = RegisterAccess(bus, address=settings.bus.address, clock=clock, health=Health())
    try:
        finding = find_magnetometer(chip, wanted=asked.wanted, accept_id=settings.bus.accept_id)
    except ImuError as error:
        return Finding(name=name, ok=False, found="could not be looked for", advice=str(error))
    found, remarks = finding.magnetometer, "; ".join(finding.sentences)
    if found is None:
        missing = asked.wanted is not None
        return Finding(
            name=name,
            ok=not missing,
            found=remarks,
            advice=f'magnetometer.use = "{asked.use}" asks for it: check its wires, or give "auto"' if missing else "",
        )
    told = f"{found.name} at 0x{found.address:02x}" + (f"; {remarks}" if remarks else "")
    if found.outside:
        return Finding(name=name, ok=True, found=told)
    advice = "" if asked.used else 'its field comes with the samples where magnetometer.use = "auto"'
    return Finding(name=name, ok=True, found=told, advice=advice)
