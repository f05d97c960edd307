"""Frames that no sensor gives: I2C has no checksum, so what is read must be looked at."""

from __future__ import annotations

import numpy as np

from quavelet.core.blocks import CountArray

TEMP_JUMP = 680
"""Counts, 2 degC: no die warms by that from one frame to the next, but a frame read from the wrong byte shows it."""
AXES = [0, 1, 2, 4, 5, 6]
"""The words of a frame that are axes: all but the temperature."""
SAME_FRAMES = 10
SAME_NS = 80_000_000
"""So many frames, and so long, may be alike. At the narrowest filter and the widest ranges the accelerometer's noise is
still 2 counts rms (PS 6.2: 400 ug/rtHz), so that alike frames are rarely two in a row on all six axes."""


def first_implausible(counts: CountArray, *, temp_before: int | None) -> int:
    """Which of the frames (N, 7) is the first that cannot be; N where all can.

    temp_before  the temperature word of the last good frame; None where there is none to compare with
    """
    temps = counts[:, 3].astype(np.int64)
    before = temps[0] if temp_before is None else temp_before
    jumps = np.abs(np.diff(temps, prepend=before)) > TEMP_JUMP
    # An empty FIFO repeats its last byte, a line held low reads 0x00, one that floats 0xFF: fourteen bytes alike.
    high, low = counts >> 8 & 0xFF, counts & 0xFF
    alike = (high == low).all(axis=1) & (counts == counts[:, :1]).all(axis=1)
    bad = np.flatnonzero(jumps | alike)
    return int(bad[0]) if len(bad) else len(counts)


def same_as_before(counts: CountArray, before: tuple[int, ...]) -> list[bool]:
    """For each frame (N, 7), whether all six axes stand as in the one before it; `before` is the first one's, or ()."""
    axes = counts[:, AXES]
    first = bool(before) and axes[0].tolist() == [before[word] for word in AXES]
    return [first, *(axes[1:] == axes[:-1]).all(axis=1).tolist()]
