"""A fake MPU-6050: the chip as behaviour in virtual or real time, and buses around it."""

from hw_fakes.bus import FakeBus
from hw_fakes.chip import FakeMpu6050, Nack
from hw_fakes.scenarios import open_fake

__all__ = ["FakeBus", "FakeMpu6050", "Nack", "open_fake"]
