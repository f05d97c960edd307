"""What a session has measured: all of it, as data that can be put into a file and taken up again."""

from __future__ import annotations

from collections.abc import Sequence

import msgspec
import numpy as np

from quavelet.calibration.model import Vector
from quavelet.calibration.poses import StillPose, vector
from quavelet.calibration.record import ChipIdentity, OffsetsTable
from quavelet.core.blocks import CountArray, FlagArray, FloatArray, IntArray, RawBlock, Scale
from quavelet.core.units import DEG_PER_RAD


class Chip(msgspec.Struct, frozen=True, kw_only=True):
    """Which chip it is of, and how that was set: evidence of another cannot be gone on with.

    offsets   what was written to its own offset registers, None for the factory's words
    """

    identity: ChipIdentity
    gyro_range_dps: int
    accel_range_g: int
    scale: Scale
    offsets: OffsetsTable | None = None


class Move(msgspec.Struct, frozen=True, kw_only=True):
    """The samples between two still poses, as the chip gave them; the arrays' bytes.

    turned_deg   rate added up about each axis, the bias being what both poses show
    """

    before: StillPose
    after: StillPose
    turned_deg: Vector
    t_ns: bytes
    period_s: bytes
    flags: bytes
    counts: bytes

    @classmethod
    def of(cls, rows: RawBlock, before: StillPose, after: StillPose) -> Move:
        bias = 0.5 * (np.array(before.gyro_rad_s) + np.array(after.gyro_rad_s))
        rate = rows.counts[:, 4:7] * rows.scale.gyro_rad_s_per_lsb - bias
        return cls(
            before=before,
            after=after,
            turned_deg=vector(DEG_PER_RAD * (rate * rows.period_s[:, None]).sum(axis=0)),
            t_ns=rows.t_ns.tobytes(),
            period_s=rows.period_s.tobytes(),
            flags=rows.flags.tobytes(),
            counts=rows.counts.tobytes(),
        )

    def rows(self, scale: Scale) -> RawBlock:
        """The block it was made of; its magnetic field is left out."""
        t_ns: IntArray = np.frombuffer(self.t_ns, dtype=np.int64)
        period_s: FloatArray = np.frombuffer(self.period_s)
        flags: FlagArray = np.frombuffer(self.flags, dtype=np.uint32)
        counts: CountArray = np.frombuffer(self.counts, dtype=np.int16).reshape(-1, 7)
        return RawBlock(
            t_ns=t_ns, period_s=period_s, gap_ns=np.zeros_like(t_ns), flags=flags, counts=counts, scale=scale
        )


STILL_BYTES = 12
"""Of one sample of a still run: six words."""


class StillRun(msgspec.Struct, frozen=True, kw_only=True):
    """A long stretch of one still board: bytes of (N, 6) int16 counts, accelerometer and then gyroscope."""

    period_s: float
    counts: bytes

    @property
    def lasts_s(self) -> float:
        return len(self.counts) / STILL_BYTES * self.period_s

    def si(self, scale: Scale) -> tuple[FloatArray, FloatArray]:
        """Rates (N, 3) in rad/s and forces (N, 3) in m/s^2, as measured."""
        counts = np.frombuffer(self.counts, dtype=np.int16).reshape(-1, 6).astype(np.float64)
        return counts[:, 3:] * scale.gyro_rad_s_per_lsb, counts[:, :3] * scale.accel_m_s2_per_lsb


class Evidence(msgspec.Struct, kw_only=True):
    """Everything that was measured; only added to.

    done      names of the steps that are finished, in their order
    begun     by step in which the board lies, how many of `rest` there were before it
    rest      poses of the board lying: bias, and how it goes with temperature
    placed    one of each face it was put on
    poses     held in any attitude
    check     held out of every fit, for the verdict
    moves     what lies between poses of the steps in which it was turned; `told` counts those that were turns asked for
    still     stretches of the long still run
    field_ut  magnetic field, body frame, one row a measurement
    """

    chip: Chip
    done: list[str] = []
    begun: dict[str, int] = {}
    rest: list[StillPose] = []
    placed: list[StillPose] = []
    poses: list[StillPose] = []
    check: list[StillPose] = []
    moves: list[Move] = []
    told: list[Move] = []
    still: list[StillRun] = []
    field_ut: list[Vector] = []

    @property
    def measured_bias(self) -> bool:
        """Whether the gyroscope's bias was asked for, and not only met in passing."""
        return bool({"rest", "temperature"} & set(self.done))

    def count(self) -> int:
        """How much there is: grows with whatever is added."""
        lists: Sequence[Sequence[object]] = (
            self.done, self.rest, self.placed, self.poses, self.check, self.moves, self.told, self.field_ut
        )  # fmt: skip
        return sum(map(len, lists)) + sum(len(run.counts) for run in self.still)
