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
    from hw_fakes.bus import FakeBus as FakeBus
    from hw_fakes.chip import FakeMpu6050 as FakeMpu6050
    from hw_fakes.chip_faults import BrownOut as BrownOut
    from hw_fakes.chip_faults import Changed as Changed
    from hw_fakes.chip_faults import FallenAsleep as FallenAsleep
    from hw_fakes.chip_faults import FifoOverflow as FifoOverflow
    from hw_fakes.chip_faults import FifoSlip as FifoSlip
    from hw_fakes.chip_faults import Frozen as Frozen
    from hw_fakes.chip_faults import NoInterrupts as NoInterrupts
    from hw_fakes.chip_faults import Swapped as Swapped
    from hw_fakes.chip_faults import Unplugged as Unplugged
    from hw_fakes.chip_faults import WrongTemperature as WrongTemperature
    from hw_fakes.counts import RecordedCounts as RecordedCounts
    from hw_fakes.fault_base import Fault as Fault
    from hw_fakes.fault_base import Happened as Happened
    from hw_fakes.fault_plan import FaultEntry as FaultEntry
    from hw_fakes.faults import Faults as Faults
    from hw_fakes.i2c_adapter import Adapter as Adapter
    from hw_fakes.imperfections import NOISE_ONLY as NOISE_ONLY
    from hw_fakes.imperfections import PERFECT as PERFECT
    from hw_fakes.imperfections import TYPICAL as TYPICAL
    from hw_fakes.imperfections import Imperfections as Imperfections
    from hw_fakes.imperfections import draw as draw
    from hw_fakes.in_process import PatchedKernel as PatchedKernel
    from hw_fakes.in_process import patched_smbus2 as patched_smbus2
    from hw_fakes.magnetometer_akm import Ak8963 as Ak8963
    from hw_fakes.magnetometer_akm import Ak8975 as Ak8975
    from hw_fakes.magnetometer_hmc5883l import Hmc5883l as Hmc5883l
    from hw_fakes.magnetometer_qmc5883l import Qmc5883l as Qmc5883l
    from hw_fakes.motion import Motion as Motion
    from hw_fakes.motion import Still as Still
    from hw_fakes.motion import Sway as Sway
    from hw_fakes.motion import Tilt as Tilt
    from hw_fakes.motion import Turntable as Turntable
    from hw_fakes.motion_base import EarthField as EarthField
    from hw_fakes.motion_bench import Coning as Coning
    from hw_fakes.motion_bench import SixFaces as SixFaces
    from hw_fakes.motion_carried import Drone as Drone
    from hw_fakes.motion_carried import Walk as Walk
    from hw_fakes.motion_recorded import RecordedMotion as RecordedMotion
    from hw_fakes.motion_recorded import load_motion as load_motion
    from hw_fakes.motion_switched import SwitchedMotion as SwitchedMotion
    from hw_fakes.personalities import ICM20689 as ICM20689
    from hw_fakes.personalities import MPU6000 as MPU6000
    from hw_fakes.personalities import MPU6050 as MPU6050
    from hw_fakes.personalities import MPU6500 as MPU6500
    from hw_fakes.personalities import MPU6515 as MPU6515
    from hw_fakes.personalities import MPU9150 as MPU9150
    from hw_fakes.personalities import MPU9250 as MPU9250
    from hw_fakes.personalities import MPU9255 as MPU9255
    from hw_fakes.personalities import PERSONALITIES as PERSONALITIES
    from hw_fakes.personalities import Personality as Personality
    from hw_fakes.preload import served_device as served_device
    from hw_fakes.scenarios import MOTIONS as MOTIONS
    from hw_fakes.scenarios import counts_chip as counts_chip
    from hw_fakes.scenarios import motion_named as motion_named
    from hw_fakes.scenarios import open_fake as open_fake
    from hw_fakes.script import ScriptedBus as ScriptedBus
    from hw_fakes.script import Write as Write
    from hw_fakes.script import WriteRead as WriteRead
    from hw_fakes.target import Nack as Nack
    from hw_fakes.target import Target as Target
    from hw_fakes.wire_faults import AllOnes as AllOnes
    from hw_fakes.wire_faults import AllZero as AllZero
    from hw_fakes.wire_faults import CutWrite as CutWrite
    from hw_fakes.wire_faults import FlippedRead as FlippedRead
    from hw_fakes.wire_faults import FlippedWrite as FlippedWrite
    from hw_fakes.wire_faults import Garbage as Garbage
    from hw_fakes.wire_faults import InputOutputError as InputOutputError
    from hw_fakes.wire_faults import LostArbitration as LostArbitration
    from hw_fakes.wire_faults import NotAcknowledged as NotAcknowledged
    from hw_fakes.wire_faults import SlowWires as SlowWires
    from hw_fakes.wire_faults import TimedOut as TimedOut
    from hw_fakes.wire_faults import Torn as Torn

# What stands above, once more for the running program.
_NAMES = {
    "boards": "BOARDS Board board",
    "bus": "FakeBus",
    "chip": "FakeMpu6050",
    "chip_faults": (
        "BrownOut Changed FallenAsleep FifoOverflow FifoSlip Frozen NoInterrupts Swapped Unplugged WrongTemperature"
    ),
    "counts": "RecordedCounts",
    "fault_base": "Fault Happened",
    "fault_plan": "FaultEntry",
    "faults": "Faults",
    "i2c_adapter": "Adapter",
    "imperfections": "NOISE_ONLY PERFECT TYPICAL Imperfections draw",
    "in_process": "PatchedKernel patched_smbus2",
    "magnetometer_akm": "Ak8963 Ak8975",
    "magnetometer_hmc5883l": "Hmc5883l",
    "magnetometer_qmc5883l": "Qmc5883l",
    "motion": "Motion Still Sway Tilt Turntable",
    "motion_base": "EarthField",
    "motion_bench": "Coning SixFaces",
    "motion_carried": "Drone Walk",
    "motion_recorded": "RecordedMotion load_motion",
    "motion_switched": "SwitchedMotion",
    "personalities": "ICM20689 MPU6000 MPU6050 MPU6500 MPU6515 MPU9150 MPU9250 MPU9255 PERSONALITIES Personality",
    "preload": "served_device",
    "scenarios": "MOTIONS counts_chip motion_named open_fake",
    "script": "ScriptedBus Write WriteRead",
    "target": "Nack Target",
    "wire_faults": (
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
