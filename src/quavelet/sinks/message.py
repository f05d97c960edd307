"""The one message that every output speaks, version 1. New fields may be added; unknown ones are to be ignored."""

from __future__ import annotations

from typing import Literal

import msgspec
import numpy as np

from quavelet.core.blocks import AttitudeBlock, Flag, YawFrom
from quavelet.core.euler import to_euler
from quavelet.core.units import DEG_PER_RAD

Three = tuple[float, float, float]
Four = tuple[float, float, float, float]
Yaw = Literal["relative", "magnetic", "true"]
_YAW: dict[YawFrom, Yaw] = {YawFrom.RELATIVE: "relative", YawFrom.MAGNETIC: "magnetic", YawFrom.TRUE: "true"}


class Message(msgspec.Struct, frozen=True, kw_only=True):
    """The attitude at one instant; the fields keep this order in JSON.

    t_ns             when the sample was taken, ns of CLOCK_MONOTONIC
    q                body to world quaternion w x y z, world z up
    roll_deg         about x; pitch_deg about y; yaw_deg about z, counter-clockwise from above
    yaw              "relative": counts from the start and drifts; "magnetic" or "true": from where world y points to
                     north. It may change from the one to the other, and yaw jumps then
    sigma_deg        one sigma about world x, y, z
    gyro_rad_s       rate, bias removed; accel_m_s2 specific force, +g up at rest
    temp_degc        of the chip
    gyro_bias_rad_s  the bias that was removed
    still            the board stands still
    flags            names of what is doubtful since the message before, none when all is well
    gap_ns           time without samples since the message before
    delay_ns         how much older than the newest sample the attitude is
    src              the bus; "fake:..." is not a real chip
    """

    v: Literal[1] = 1
    t_ns: int
    q: Four
    roll_deg: float
    pitch_deg: float
    yaw_deg: float
    yaw: Yaw = "relative"
    sigma_deg: Three
    gyro_rad_s: Three
    accel_m_s2: Three
    temp_degc: float
    gyro_bias_rad_s: Three
    still: bool
    flags: list[str]
    gap_ns: int
    delay_ns: int
    src: str


def message_of(block: AttitudeBlock, *, src: str) -> Message:
    """The message for a block of at least one row: its last sample, and the flags and gaps of all of them."""
    angles = np.round(DEG_PER_RAD * to_euler(block.q[-1]), 4).tolist()
    return Message(
        t_ns=int(block.t_ns[-1]),
        q=tuple(np.round(block.q[-1], 8).tolist()),
        roll_deg=angles[0],
        pitch_deg=angles[1],
        yaw_deg=angles[2],
        yaw=_YAW[YawFrom(int(block.yaw_from[-1]))],
        sigma_deg=_three(DEG_PER_RAD * block.sigma_rad[-1], 4),
        gyro_rad_s=_three(block.gyro_rad_s[-1], 6),
        accel_m_s2=_three(block.accel_m_s2[-1], 5),
        temp_degc=round(float(block.temp_degc[-1]), 3),
        gyro_bias_rad_s=_three(block.gyro_bias_rad_s[-1], 7),
        still=bool(block.still[-1]),
        flags=Flag.names(int(np.bitwise_or.reduce(block.flags))),
        gap_ns=int(block.gap_ns.sum()),
        delay_ns=block.delay_ns,
        src=src,
    )


def together(earlier: Message, later: Message) -> Message:
    """The later one, with the flags and the gap of both: what it says where the earlier one does not go."""
    if not earlier.flags and not earlier.gap_ns:
        return later
    flags = list(dict.fromkeys((*earlier.flags, *later.flags)))
    return msgspec.structs.replace(later, flags=flags, gap_ns=earlier.gap_ns + later.gap_ns)


def _three(values: np.ndarray[tuple[int, ...], np.dtype[np.float64]], digits: int) -> Three:
    x, y, z = np.round(values, digits).tolist()
    return x, y, z
