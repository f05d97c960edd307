"""The field out of a frame's external bytes: which rows hold a new measurement, and whether the magnetometer lives."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from quavelet.core.blocks import Flag, FlagArray, FloatArray
from quavelet.core.errors import SettingsError
from quavelet.core.health import Health
from quavelet.mpu6050.magnetometer.fifo_frames import ByteArray
from quavelet.mpu6050.magnetometer.kinds import KINDS
from quavelet.mpu6050.magnetometer.plan import MagnetometerConfig, Plan
from quavelet.mpu6050.stream import MagnetometerStream, StreamInfo

LOST_S = 1.0
LOST_MEASUREMENTS = 50
"""A magnetometer whose bytes do not change for so long, or for so many measurements where that is longer, is lost: its
noise is of the order of its resolution."""
GAIN_BEFORE = 2
"""Measurements that still have the gain before when that is changed: the one under way, and the next (HMC5883L, DS
13)."""


@dataclass(frozen=True, slots=True)
class FieldState:
    """All memory.

    last       the external bytes of the last frame
    counts     the words in them
    quiet      frames since they changed
    upset      the magnetometer does not have the settings it was given
    saturated  an axis is beyond its range
    to_skip    measurements that may still be of the settings before
    """

    last: bytes = b""
    counts: tuple[int, int, int] = (0, 0, 0)
    quiet: int = 0
    upset: bool = False
    saturated: bool = False
    to_skip: int = 0


class FieldDecoder:
    """External bytes to the field, for one stream with a magnetometer."""

    def __init__(self, info: StreamInfo, *, health: Health) -> None:
        if info.magnetometer is None:
            raise ValueError("this stream has no magnetometer")
        stream = info.magnetometer
        self._plan = plan_of(stream)
        self._to_body_ut = np.array(stream.to_body) @ np.diag(self._plan.ut_per_lsb)
        self._lost_after = round(max(LOST_S, LOST_MEASUREMENTS / stream.rate_hz) / info.nominal_period_s)
        self._health = health
        self._s = FieldState()

    def state(self) -> FieldState:
        return self._s

    def restore(self, state: FieldState) -> None:
        self._s = state

    @property
    def lost(self) -> bool:
        """Whether it gives nothing, or not what it was told."""
        return self._s.upset or self._s.quiet >= self._lost_after

    def decode(self, external: ByteArray) -> tuple[FloatArray, FlagArray]:
        """The field (N, 3) in the body frame, uT, NaN in rows without a new measurement, and flags (N,), of external
        bytes (N, n).

        The master fetches more often than the magnetometer measures, and a frame shows what was fetched last: a
        measurement is new where the magnetometer says so and its words are. One with the very words of the one before
        it does not count.
        """
        n = len(external)
        field_ut, flags = np.full((n, 3), np.nan), np.zeros(n, dtype=np.uint32)
        s, lost = self._s, self.lost
        last, counts, quiet, upset, saturated, to_skip = s.last, s.counts, s.quiet, s.upset, s.saturated, s.to_skip
        for k, row in enumerate(external):
            block, quiet = row.tobytes(), quiet + 1
            if block != last:
                last = block
                if any(block):  # else the master has fetched nothing yet
                    words, quiet = self._plan.decode(block), 0
                    upset, saturated = words.upset, words.overflow
                    new = words.ready and words.counts != counts
                    if upset:
                        to_skip = GAIN_BEFORE
                    elif new and to_skip:
                        to_skip -= 1
                    elif new and not saturated:
                        field_ut[k] = self._to_body_ut @ words.counts
                    if new:
                        counts = words.counts
            if upset or quiet >= self._lost_after:
                flags[k] = Flag.FIELD_LOST
                self._health.magnetometer_lost += not lost
                lost = True
            else:
                lost = False
                flags[k] = Flag.FIELD_DISTURBED if saturated else 0
        self._s = FieldState(last, counts, quiet, upset, saturated, to_skip)
        return field_ut, flags


def plan_of(stream: MagnetometerStream) -> Plan:
    """The plan by which this stream's magnetometer was set up. Raises SettingsError where this version does not know
    it."""
    if stream.kind not in KINDS or (KINDS[stream.kind].has_adjustment and stream.adjustment is None):
        raise SettingsError(f"a magnetometer {stream.kind!r} is not known here, or not all of it")
    config = MagnetometerConfig(rate_hz=stream.rate_hz, range_ut=stream.range_ut)
    return KINDS[stream.kind].make_plan(config, stream.adjustment)
