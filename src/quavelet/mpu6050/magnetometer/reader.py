"""What both ways to a magnetometer have: the chip it is behind, and what is set up there."""

from __future__ import annotations

from quavelet.core.clock import Clock
from quavelet.core.health import Health
from quavelet.mpu6050.access import RegisterAccess
from quavelet.mpu6050.magnetometer.identify import FoundMagnetometer
from quavelet.mpu6050.magnetometer.plan import MagnetometerConfig, Plan
from quavelet.mpu6050.magnetometer.samples import Sampler


class Reader:
    """A magnetometer that was found behind a chip, not yet set up."""

    def __init__(
        self,
        chip: RegisterAccess,
        found: FoundMagnetometer,
        config: MagnetometerConfig,
        *,
        clock: Clock,
        health: Health,
    ) -> None:
        self._chip = chip
        self._found = found
        self._config = config
        self._clock = clock
        self._target = RegisterAccess(chip.bus, address=found.address, clock=clock, health=health)
        self._plan: Plan | None = None
        self._sampler: Sampler | None = None

    def _new_sampler(self, plan: Plan) -> Sampler:
        return Sampler(
            plan,
            to_body=self._config.to_body or self._found.to_body,
            bus=self._chip.bus.name,
            since_ns=self._clock.now_ns(),
        )
