"""A fake MPU-6050: the chip as behaviour in virtual or real time, and the ways into it.

Every name below is had from here. A module is loaded with the first of its names, so that importing hw_fakes costs
nothing, not even numpy, and smbus2 is loaded only by `PatchedKernel` and `patched_smbus2`.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from hw_fakes.boards import BOARDS as BOARDS
    from hw_fakes.boards import Board as Board
    from hw_fakes.boards import board as board
    from hw_fakes.chip.counts import RecordedCounts as RecordedCounts
    from hw_fakes.chip.mpu6050 import FakeMpu6050 as FakeMpu6050
    from hw_fakes.chip.personalities import CLONE_69 as CLONE_69
    from hw_fakes.chip.personalities import CLONE_72 as CLONE_72
    from hw_fakes.chip.personalities import CLONE_75 as CLONE_75
    from hw_fakes.chip.personalities import ICM20689 as ICM20689
    from hw_fakes.chip.personalities import MPU6000 as MPU6000
    from hw_fakes.chip.personalities import MPU6050 as MPU6050
    from hw_fakes.chip.personalities import MPU6050_EARLY as MPU6050_EARLY
    from hw_fakes.chip.personalities import MPU6500 as MPU6500
    from hw_fakes.chip.personalities import MPU6515 as MPU6515
    from hw_fakes.chip.personalities import MPU9150 as MPU9150
    from hw_fakes.chip.personalities import MPU9250 as MPU9250
    from hw_fakes.chip.personalities import MPU9255 as MPU9255
    from hw_fakes.chip.personalities import PERSONALITIES as PERSONALITIES
    from hw_fakes.chip.personalities import Personality as Personality
    from hw_fakes.faults.base import Fault as Fault
    from hw_fakes.faults.base import Happened as Happened
    from hw_fakes.faults.engine import Faults as Faults
    from hw_fakes.faults.of_chip import BrownOut as BrownOut
    from hw_fakes.faults.of_chip import Changed as Changed
    from hw_fakes.faults.of_chip import FallenAsleep as FallenAsleep
    from hw_fakes.faults.of_chip import FifoOverflow as FifoOverflow
    from hw_fakes.faults.of_chip import FifoSlip as FifoSlip
    from hw_fakes.faults.of_chip import Frozen as Frozen
    from hw_fakes.faults.of_chip import NoInterrupts as NoInterrupts
    from hw_fakes.faults.of_chip import Swapped as Swapped
    from hw_fakes.faults.of_chip import Unplugged as Unplugged
    from hw_fakes.faults.of_chip import WrongTemperature as WrongTemperature
    from hw_fakes.faults.of_wires import AllOnes as AllOnes
    from hw_fakes.faults.of_wires import AllZero as AllZero
    from hw_fakes.faults.of_wires import CutWrite as CutWrite
    from hw_fakes.faults.of_wires import FlippedRead as FlippedRead
    from hw_fakes.faults.of_wires import FlippedWrite as FlippedWrite
    from hw_fakes.faults.of_wires import Garbage as Garbage
    from hw_fakes.faults.of_wires import InputOutputError as InputOutputError
    from hw_fakes.faults.of_wires import LostArbitration as LostArbitration
    from hw_fakes.faults.of_wires import NotAcknowledged as NotAcknowledged
    from hw_fakes.faults.of_wires import SlowWires as SlowWires
    from hw_fakes.faults.of_wires import TimedOut as TimedOut
    from hw_fakes.faults.of_wires import Torn as Torn
    from hw_fakes.faults.plan import FaultEntry as FaultEntry
    from hw_fakes.magnetometers.akm import Ak8963 as Ak8963
    from hw_fakes.magnetometers.akm import Ak8975 as Ak8975
    from hw_fakes.magnetometers.hmc5883l import Hmc5883l as Hmc5883l
    from hw_fakes.magnetometers.qmc5883l import Qmc5883l as Qmc5883l
    from hw_fakes.scenarios import MOTIONS as MOTIONS
    from hw_fakes.scenarios import counts_chip as counts_chip
    from hw_fakes.scenarios import motion_named as motion_named
    from hw_fakes.scenarios import open_fake as open_fake
    from hw_fakes.target import Nack as Nack
    from hw_fakes.target import Target as Target
    from hw_fakes.ways.in_process import PatchedKernel as PatchedKernel
    from hw_fakes.ways.in_process import patched_smbus2 as patched_smbus2
    from hw_fakes.ways.preload import served_device as served_device
    from hw_fakes.wire.adapter import Adapter as Adapter
    from hw_fakes.wire.bus import FakeBus as FakeBus
    from hw_fakes.wire.int_line import FakeDataReady as FakeDataReady
    from hw_fakes.wire.script import ScriptedBus as ScriptedBus
    from hw_fakes.wire.script import Write as Write
    from hw_fakes.wire.script import WriteRead as WriteRead
    from hw_fakes.world.imperfections import NOISE_ONLY as NOISE_ONLY
    from hw_fakes.world.imperfections import PERFECT as PERFECT
    from hw_fakes.world.imperfections import TYPICAL as TYPICAL
    from hw_fakes.world.imperfections import Imperfections as Imperfections
    from hw_fakes.world.imperfections import draw as draw
    from hw_fakes.world.motion import Motion as Motion
    from hw_fakes.world.motion import Still as Still
    from hw_fakes.world.motion import Sway as Sway
    from hw_fakes.world.motion import Tilt as Tilt
    from hw_fakes.world.motion import Turntable as Turntable
    from hw_fakes.world.motion_base import EarthField as EarthField
    from hw_fakes.world.motion_bench import Coning as Coning
    from hw_fakes.world.motion_bench import SixFaces as SixFaces
    from hw_fakes.world.motion_carried import Drone as Drone
    from hw_fakes.world.motion_carried import Walk as Walk
    from hw_fakes.world.motion_recorded import RecordedMotion as RecordedMotion
    from hw_fakes.world.motion_recorded import load_motion as load_motion
    from hw_fakes.world.motion_show import Show as Show
    from hw_fakes.world.motion_switched import SwitchedMotion as SwitchedMotion

# What stands above, once more for the running program.
_NAMES = {
    "boards": "BOARDS Board board",
    "wire.bus": "FakeBus",
    "wire.int_line": "FakeDataReady",
    "chip.mpu6050": "FakeMpu6050",
    "faults.of_chip": (
        "BrownOut Changed FallenAsleep FifoOverflow FifoSlip Frozen NoInterrupts Swapped Unplugged WrongTemperature"
    ),
    "chip.counts": "RecordedCounts",
    "faults.base": "Fault Happened",
    "faults.plan": "FaultEntry",
    "faults.engine": "Faults",
    "wire.adapter": "Adapter",
    "world.imperfections": "NOISE_ONLY PERFECT TYPICAL Imperfections draw",
    "ways.in_process": "PatchedKernel patched_smbus2",
    "magnetometers.akm": "Ak8963 Ak8975",
    "magnetometers.hmc5883l": "Hmc5883l",
    "magnetometers.qmc5883l": "Qmc5883l",
    "world.motion": "Motion Still Sway Tilt Turntable",
    "world.motion_base": "EarthField",
    "world.motion_bench": "Coning SixFaces",
    "world.motion_carried": "Drone Walk",
    "world.motion_recorded": "RecordedMotion load_motion",
    "world.motion_show": "Show",
    "world.motion_switched": "SwitchedMotion",
    "chip.personalities": "CLONE_69 CLONE_72 CLONE_75 ICM20689 MPU6000 MPU6050 MPU6050_EARLY MPU6500 MPU6515 MPU9150 "
    "MPU9250 MPU9255 PERSONALITIES Personality",
    "ways.preload": "served_device",
    "scenarios": "MOTIONS counts_chip motion_named open_fake",
    "wire.script": "ScriptedBus Write WriteRead",
    "target": "Nack Target",
    "faults.of_wires": (
        "AllOnes AllZero CutWrite FlippedRead FlippedWrite Garbage InputOutputError LostArbitration "
        "NotAcknowledged SlowWires TimedOut Torn"
    ),
}
_HOME = {name: module for module, names in _NAMES.items() for name in names.split()}

__all__ = list(_HOME)


if not TYPE_CHECKING:  # for a type checker a name that is not above is none

    def __getattr__(name: str) -> object:
        if name not in _HOME:
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
        value = getattr(import_module(f"{__name__}.{_HOME[name]}"), name)
        globals()[name] = value
        return value


def __dir__() -> list[str]:
    return sorted({*globals(), *_HOME})
