"""One magnetometer in virtual time, and the field it must show."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from hw_fakes.world.motion import Still
from hw_fakes.world.motion_base import EarthField
from quavelet.core.clock import VirtualClock


def body_field_ut(strength_ut=49.0):
    """The field (3,) in the axes of the board `LYING`, from its three angles."""
    dip, east = np.radians([66.0, 4.0])
    world = strength_ut * np.array([np.cos(dip) * np.sin(east), np.cos(dip) * np.cos(east), -np.sin(dip)])
    return Rotation.from_euler("ZYX", [130, -35, 20], degrees=True).inv().apply(world)


class Bench:
    """One chip in virtual time, spoken to as its bus would."""

    def __init__(self, chip, *, strength_ut=49.0, motion=None, **options):
        self.clock = VirtualClock(5_000_000_000)
        if motion is None:
            motion = Still(roll_deg=20, pitch_deg=-35, yaw_deg=130, earth_field=EarthField(strength_ut=strength_ut))
        self.chip = chip(self.clock, motion, **options)

    def wr(self, register, *values):
        self.chip.write(bytes([register, *values]))
        self.chip.stop()

    def rd(self, register, n=1):
        self.chip.write(bytes([register]))
        data = self.chip.read(n)
        self.chip.stop()
        return data

    def byte(self, register):
        return self.rd(register)[0]

    def words(self, register, order):
        return np.frombuffer(self.rd(register, 6), dtype=order).astype(int)

    def wait_ms(self, ms):
        self.clock.advance_ns(round(ms * 1e6))
