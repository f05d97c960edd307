"""A board with its magnetometer on a bus in virtual time, and the readers of the driver on it."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from hw_fakes import NOISE_ONLY, Ak8963, Ak8975, FakeBus, FakeMpu6050, Hmc5883l, Qmc5883l, Still, board
from hw_fakes.magnetometers.base import PERFECT_MAGNETOMETER, Magnetometer, MagnetometerImperfections
from hw_fakes.world.motion_base import EarthField, Motion
from quavelet.core.clock import VirtualClock
from quavelet.core.health import Health
from quavelet.core.units import NS_PER_MS, NS_PER_S
from quavelet.mpu6050 import registers as r
from quavelet.mpu6050.access import RegisterAccess
from quavelet.mpu6050.magnetometer.bypass import BypassReader
from quavelet.mpu6050.magnetometer.identify import FoundMagnetometer, find_magnetometer
from quavelet.mpu6050.magnetometer.master import MasterReader
from quavelet.mpu6050.magnetometer.plan import MagnetometerConfig

ADDRESS = 0x68
NOISY = MagnetometerImperfections(noise_ut=2.0)
"""No other error, and so much noise that no two measurements give the same words."""

CHIPS: dict[str, type[Magnetometer]] = {
    "gy-87": Qmc5883l,
    "gy-87-hmc5883l": Hmc5883l,
    "mpu-9150": Ak8975,
    "mpu-9250": Ak8963,
}
BOARDS = list(CHIPS)
NAMES = {"gy-87": "QMC5883L", "gy-87-hmc5883l": "HMC5883L", "mpu-9150": "AK8975", "mpu-9250": "AK8963"}


def lying(strength_ut: float = 49.0) -> Still:
    return Still(roll_deg=20, pitch_deg=-35, yaw_deg=130, earth_field=EarthField(strength_ut=strength_ut))


class MagRig:
    """A board, awake, that samples at `rate_hz`."""

    def __init__(
        self,
        name: str,
        *,
        motion: Motion | None = None,
        imperfections: MagnetometerImperfections = PERFECT_MAGNETOMETER,
        rate_hz: float = 200.0,
        strength_ut: float = 49.0,
    ) -> None:
        self.clock = VirtualClock(5 * NS_PER_S)
        self.motion = motion or lying(strength_ut)
        self.board = board(name)
        self.birth_ns = self.clock.now_ns()
        self.aux = self.board.aux_master(self.clock, self.motion, imperfections=imperfections)
        self.chip = FakeMpu6050(
            self.clock,
            motion=self.motion,
            imperfections=NOISE_ONLY,
            personality=self.board.personality,
            aux=self.aux,
            pll_error=0.0,
        )
        self.bus = FakeBus({ADDRESS: self.chip, **self.aux.outside()}, clock=self.clock)
        self.health = Health()
        self.access = RegisterAccess(self.bus, address=ADDRESS, clock=self.clock, health=self.health)
        self.rate_hz = rate_hz
        self.wake()

    def wake(self) -> None:
        """As the driver's start-up leaves the chip, but for the FIFO."""
        self.access.write(r.PWR_MGMT_1, 1)
        self.access.write(r.CONFIG, 1)
        self.access.write(r.SMPLRT_DIV, round(1000 / self.rate_hz) - 1)
        self.wait_ms(60)

    @property
    def magnetometer(self) -> Any:
        """The fake magnetometer itself."""
        (target,) = self.aux.targets.values()
        return target

    def wait_ms(self, ms: float) -> None:
        self.clock.advance_ns(round(ms * NS_PER_MS))

    def found(self) -> FoundMagnetometer:
        finding = find_magnetometer(self.access)
        assert finding.magnetometer is not None, finding.sentences
        return finding.magnetometer

    def config(self, **changed: Any) -> MagnetometerConfig:
        sensible = self.found().kind.sensible_config()
        return MagnetometerConfig(**{"rate_hz": sensible.rate_hz, "range_ut": sensible.range_ut, **changed})

    def bypass(self, **changed: Any) -> BypassReader:
        reader = BypassReader(self.access, self.found(), self.config(**changed), clock=self.clock, health=self.health)
        reader.set_up()
        return reader

    def master(self, **changed: Any) -> MasterReader:
        reader = MasterReader(self.access, self.found(), self.config(**changed), clock=self.clock, health=self.health)
        reader.set_up()
        return reader

    def true_ut(self, t_ns: int | None = None) -> NDArray[np.float64]:
        """The field (3,) in the chip's axes, as the world has it."""
        t_s = np.array([((self.clock.now_ns() if t_ns is None else t_ns) - self.birth_ns) / NS_PER_S])
        field: NDArray[np.float64] = self.motion.magnetic_field_ut(t_s)[0]
        return field

    def unplug(self) -> None:
        """The magnetometer's wires come off: it answers neither the master nor through the bypass."""
        self.aux.targets.clear()
        for address in [address for address in self.bus.targets if address != ADDRESS]:
            del self.bus.targets[address]


def new_samples(rig: MagRig, reader: BypassReader | MasterReader, n: int, *, every_ms: float) -> NDArray[np.float64]:
    """The fields (n, 3) of the next `n` measurements."""
    fields = []
    for _ in range(100 * n):
        rig.wait_ms(every_ms)
        sample = reader.read()
        if sample.new:
            fields.append(sample.field_ut)
        if len(fields) == n:
            return np.array(fields)
    raise AssertionError(f"only {len(fields)} of {n} measurements came")
