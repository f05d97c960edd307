"""One look at the FIFO: exactly what was read, and what follows from it."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum, IntEnum

from quavelet.bus.protocol import Edge
from quavelet.mpu6050.registers import FIFO_OFLOW_INT, FRAME_BYTES

GUARD_FRAMES = 3
"""Frames of room below which the FIFO is reset before it can overflow (as Linux's inv_mpu6050 does)."""


class Loss(IntEnum):
    """Why what was in the FIFO is gone; the numbers stand in recordings."""

    NONE = 0
    TRANSFER = 1
    """A transfer failed, and how many bytes it took with it is unknown."""
    CHIP_RESET = 2
    """The chip was reset."""
    UPSET = 3
    """A configuration register had changed: frames may have been taken with another range or rate."""
    STARVED = 4
    """No sample had come for long; the FIFO was started anew."""


@dataclass(frozen=True, slots=True)
class Drain:
    """What one drain read from the chip, byte for byte, with the host's times around the count.

    seq            0, 1, 2, ... within one stream; a missing number is a drain that got lost
    before_ns      host time before FIFO_COUNT was read
    after_ns       host time after it
    int_status     INT_STATUS
    fifo_count     FIFO_COUNT
    data           the bytes taken from FIFO_R_W; whole frames, none where the verdict was to reset
    loss           other than NONE: nothing in this drain is to be believed, and the FIFO was emptied
    edges          pulses of the data-ready line since the drain before, oldest first; none where there is no line
    """

    seq: int
    before_ns: int
    after_ns: int
    int_status: int
    fifo_count: int
    data: bytes
    loss: Loss = Loss.NONE
    edges: tuple[Edge, ...] = ()


class Verdict(Enum):
    """What a drain says about the FIFO."""

    FRAMES = "whole frames to read"
    EMPTY = "nothing to read"
    OVERFLOW = "overflowed: the head is in mid-frame, reset it"
    NEAR_FULL = "about to overflow, reset it"
    MISALIGNED = "not whole frames, reset it"
    LOST = "what was in it is gone, reset it"

    @property
    def must_reset(self) -> bool:
        """Whether the FIFO has to be emptied before anything in it can be used."""
        return self not in (Verdict.FRAMES, Verdict.EMPTY)


def judge(int_status: int, fifo_count: int, *, fifo_bytes: int, frame_bytes: int = FRAME_BYTES) -> Verdict:
    """The verdict on a FIFO that holds `fifo_count` bytes of frames of `frame_bytes`."""
    if int_status & FIFO_OFLOW_INT.mask or fifo_count >= fifo_bytes:
        return Verdict.OVERFLOW
    if fifo_count % frame_bytes:
        return Verdict.MISALIGNED
    if fifo_count >= fifo_bytes - GUARD_FRAMES * frame_bytes:
        return Verdict.NEAR_FULL
    return Verdict.FRAMES if fifo_count else Verdict.EMPTY
