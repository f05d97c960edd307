"""A fake MPU-6050: the chip as behaviour in virtual or real time, and buses around it."""

from hw_fakes.bus import FakeBus
from hw_fakes.chip import FakeMpu6050
from hw_fakes.counts import RecordedCounts
from hw_fakes.imperfections import PERFECT, TYPICAL, Imperfections, draw
from hw_fakes.motion import Motion, Still, Sway, Tilt, Turntable
from hw_fakes.scenarios import counts_chip, open_fake
from hw_fakes.script import ScriptedBus, Write, WriteRead
from hw_fakes.target import Nack, Target

__all__ = [
    "PERFECT",
    "TYPICAL",
    "FakeBus",
    "FakeMpu6050",
    "Imperfections",
    "Motion",
    "Nack",
    "RecordedCounts",
    "ScriptedBus",
    "Still",
    "Sway",
    "Target",
    "Tilt",
    "Turntable",
    "Write",
    "WriteRead",
    "counts_chip",
    "draw",
    "open_fake",
]
