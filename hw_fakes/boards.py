"""Boards as they are bought: which chip of the family, and which magnetometer on its auxiliary bus."""

from __future__ import annotations

from dataclasses import dataclass

from hw_fakes.chip.aux_master import AuxMaster, SettableClock
from hw_fakes.chip.personalities import MPU6050, MPU9150, MPU9250, Personality
from hw_fakes.magnetometers.akm import IN_PACKAGE, Ak8963, Ak8975
from hw_fakes.magnetometers.base import NO_ROTATION, TYPICAL_MAGNETOMETER, Magnetometer, MagnetometerImperfections
from hw_fakes.magnetometers.hmc5883l import Hmc5883l
from hw_fakes.magnetometers.qmc5883l import Qmc5883l
from hw_fakes.world.imperfections import Matrix
from hw_fakes.world.motion_base import Motion
from quavelet.core.clock import Clock


@dataclass(frozen=True, slots=True)
class Board:
    """One product.

    magnetometer  on the auxiliary bus, not on the outer one: it takes the bypass, or the master, to reach it
    mounting      turns a vector in the axes of the accelerometer into one in those of the magnetometer
    """

    name: str
    personality: Personality
    magnetometer: type[Magnetometer] | None = None
    mounting: Matrix = NO_ROTATION

    def aux_targets(
        self,
        clock: Clock,
        motion: Motion,
        *,
        imperfections: MagnetometerImperfections = TYPICAL_MAGNETOMETER,
        birth_ns: int | None = None,
    ) -> dict[int, Magnetometer]:
        """The chips on the auxiliary bus by address, just powered up; see `Magnetometer`."""
        if self.magnetometer is None:
            return {}
        chip = self.magnetometer(clock, motion, imperfections=imperfections, mounting=self.mounting, birth_ns=birth_ns)
        return {chip.address: chip}

    def aux_master(
        self,
        clock: Clock,
        motion: Motion,
        *,
        imperfections: MagnetometerImperfections = TYPICAL_MAGNETOMETER,
        birth_ns: int | None = None,
    ) -> AuxMaster:
        """The master of the auxiliary bus, with the board's chips on it; `clock` is the outer one."""
        aux_clock = SettableClock(clock)
        targets = self.aux_targets(aux_clock, motion, imperfections=imperfections, birth_ns=birth_ns)
        return AuxMaster(targets, clock=aux_clock)


# How a GY-87's magnetometer lies is not known for every make: as the MPU-6050 is taken. Its barometer, a BMP180 at
# 0x77, is not there.
_ALL = (
    Board("gy-521", MPU6050),
    Board("gy-87", MPU6050, Qmc5883l),
    Board("gy-87-hmc5883l", MPU6050, Hmc5883l),
    Board("mpu-9150", MPU9150, Ak8975, IN_PACKAGE),
    Board("mpu-9250", MPU9250, Ak8963, IN_PACKAGE),
)
BOARDS = {board.name: board for board in _ALL}
"""By name. A board that is sold as a GY-87 carries, mostly, a QMC5883L and not the HMC5883L it is described with."""


def board(name: str) -> Board:
    """The board of that name. Raises ValueError for any other."""
    if name not in BOARDS:
        raise ValueError(f"there is no board {name!r}: take one of {', '.join(BOARDS)}")
    return BOARDS[name]
