"""From the registers' bytes to the field in the chip's axes, new or not, and the errors of one that fails."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from quavelet.core.errors import ChipUnstable, DeviceLost
from quavelet.core.units import NS_PER_S
from quavelet.mpu6050.magnetometer.plan import Matrix, Plan, Triple, Words

SILENT_NS = NS_PER_S
"""A magnetometer that measures nothing for so long, or for 50 measurements where that is longer, has failed."""
STUCK_NS = 10 * NS_PER_S
"""One that measures the same words for so long, or for 500 measurements, has failed too: its noise is of the order of
its resolution, though at the widest ranges it may hide in one count for a while."""
_SILENT_MEASUREMENTS = 50
_FEWEST_LOOKS = 10


@dataclass(frozen=True, slots=True)
class MagSample:
    """One look at a magnetometer.

    t_ns      when it measured, CLOCK_MONOTONIC, as far as the host can tell: up to one of its periods too late
    field_ut  x y z in the body frame, the chip's axes, uT, not calibrated; NaN before the first measurement
    overflow  an axis was beyond the range: the field means nothing
    new       no look before this one has shown this measurement
    """

    t_ns: int
    field_ut: Triple
    overflow: bool
    new: bool


NO_FIELD: Triple = (math.nan, math.nan, math.nan)


class Sampler:
    """Makes a `MagSample` of each block of bytes, read by whatever way."""

    def __init__(self, plan: Plan, *, to_body: Matrix, bus: str, since_ns: int) -> None:
        self._plan = plan
        self._to_body_ut = np.array(to_body) @ np.diag(plan.ut_per_lsb)
        self._where = f"the {plan.name} at 0x{plan.address:02x} on {bus}"
        self._silent_ns = max(SILENT_NS, round(_SILENT_MEASUREMENTS * NS_PER_S / plan.rate_hz))
        self._last: MagSample | None = None
        self._counts = (0, 0, 0)
        self._changed_ns = self._alive_ns = since_ns
        self._looks = 0

    def take_read(self, block: bytes, t_ns: int, *, now_ns: int) -> MagSample:
        """A block that was read from the magnetometer itself: its ready bit says whether it is new."""
        words = self._plan.decode(block)
        return self._taken(words, t_ns, now_ns, new=words.ready)

    def take_copied(self, block: bytes, t_ns: int) -> MagSample:
        """A block that the chip's master has read, and that may be looked at twice, or missed.

        It is new where its words are: a measurement with the very words of the one before it does not count.
        """
        words = self._plan.decode(block) if any(block) else Words(self._counts, ready=False, overflow=False)
        return self._taken(words, t_ns, t_ns, new=words.counts != self._counts)

    def _taken(self, words: Words, t_ns: int, now_ns: int, *, new: bool) -> MagSample:
        if words.upset:
            raise ChipUnstable(
                f"{self._where} has lost its settings: set it up anew, and check its supply if that happens again"
            )
        self._check(words, now_ns)
        if new:
            x, y, z = (self._to_body_ut @ words.counts).tolist()
            self._last = MagSample(t_ns, (x, y, z), words.overflow, new=True)
            return self._last
        if self._last is None:
            return MagSample(t_ns, NO_FIELD, overflow=False, new=False)
        return MagSample(self._last.t_ns, self._last.field_ut, self._last.overflow, new=False)

    def _check(self, words: Words, now_ns: int) -> None:
        # At the end of its range a magnetometer gives the same words for good reason, as long as it gives any.
        saturated = words.overflow and words.ready
        self._looks += 1
        if words.counts != self._counts or saturated:
            self._counts, self._changed_ns, self._alive_ns, self._looks = words.counts, now_ns, now_ns, 0
        elif words.ready:
            self._alive_ns = now_ns
        if self._looks < _FEWEST_LOOKS:
            return
        silent_ns, stuck_ns = now_ns - self._alive_ns, now_ns - self._changed_ns
        if silent_ns > self._silent_ns:
            failed = f"has measured nothing for {silent_ns / NS_PER_S:.1f} s"
        elif stuck_ns > self._silent_ns * (STUCK_NS // SILENT_NS):
            failed = f"has given the same words for {stuck_ns / NS_PER_S:.1f} s"
        else:
            return
        raise DeviceLost(
            f"{self._where} {failed}: set it up anew, and check its wires and supply if that does not help"
        )
