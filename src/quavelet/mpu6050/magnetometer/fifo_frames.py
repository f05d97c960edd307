"""Frames of the FIFO with the magnetometer's bytes in them: after the sensors' words, in the order of the slaves."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from quavelet.core.blocks import CountArray
from quavelet.mpu6050 import registers as r
from quavelet.mpu6050.magnetometer.plan import Plan

ByteArray = NDArray[np.uint8]


def fifo_en(plan: Plan) -> int:
    """FIFO_EN for frames of all sensors and the magnetometer (RM p. 16); the slaves that read are the first ones."""
    return r.fifo_en(len(plan.runs))


def fifo_frame_bytes(plan: Plan | None) -> int:
    """Bytes of one frame; without a magnetometer those of the sensors."""
    return r.FRAME_BYTES + (plan.block_bytes if plan else 0)


def split_frames(data: bytes, *, external_bytes: int) -> tuple[CountArray, ByteArray]:
    """The sensors' words (N, 7), as in `RawBlock`, and the external bytes (N, external_bytes) of N whole frames.

    Where the master fetches less often than the chip samples, the same external bytes stand in several frames.
    Raises ValueError where the data are not whole frames.
    """
    if external_bytes < 0:
        raise ValueError(f"external_bytes = {external_bytes}: give 0 or more")
    frame = r.FRAME_BYTES + external_bytes
    if len(data) % frame:
        raise ValueError(f"{len(data)} bytes are not whole frames of {frame}")
    rows = np.frombuffer(data, dtype=np.uint8).reshape(-1, frame)
    words = np.ascontiguousarray(rows[:, : r.FRAME_BYTES]).view(">i2").astype(np.int16)
    return words, rows[:, r.FRAME_BYTES :].copy()
