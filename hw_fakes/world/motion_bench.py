"""Motions of the laboratory: the six faces of a board on a bench, and coning."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray

from hw_fakes.world.motion_base import Body, FloatArray, smooth_step
from quavelet.core.units import RAD_PER_DEG

# Body axes about which the board is turned by a quarter, so that those pointing up are z x y -z -x -y, and z again.
_QUARTER_TURNS = ((0, -1, 0), (0, 0, -1), (1, 0, 0)) * 2
# The six turns together are a turn about the vertical; after 8 times six even the quaternion's sign is the first.
_ATTITUDES = 8 * len(_QUARTER_TURNS)


@dataclass(frozen=True, slots=True)
class SixFaces(Body):
    """For ever from face to face: `rest_s` still on each, `turn_s` of smooth turn by 90 deg to the next.

    The axes z x y -z -x -y point up in turn. Raises ValueError for times that are not positive.
    """

    rest_s: float = 4.0
    turn_s: float = 2.0

    def __post_init__(self) -> None:
        if not (self.rest_s > 0 and self.turn_s > 0):
            raise ValueError(f"rest_s {self.rest_s} and turn_s {self.turn_s} must be above 0: a turn takes time")

    def rate_rad_s(self, t_s: FloatArray) -> FloatArray:
        step, done = self._progress(t_s)
        speed = np.pi / 2 / self.turn_s * smooth_step(done)[1]
        return np.array(_QUARTER_TURNS)[step % len(_QUARTER_TURNS)] * speed[:, None]

    def attitude(self, t_s: FloatArray) -> FloatArray:
        step, done = self._progress(t_s)
        half = np.pi / 4 * smooth_step(done)[0]
        turn = np.array(_QUARTER_TURNS)[step % len(_QUARTER_TURNS)] * np.sin(half)[:, None]
        return _product(_rest_attitudes()[step % _ATTITUDES], np.column_stack([np.cos(half), turn]))

    def _progress(self, t_s: FloatArray) -> tuple[NDArray[np.int64], FloatArray]:
        """Number (N,) of the face the board lies on or leaves, and what part (N,) of the turn is done."""
        step, within = np.divmod(np.maximum(t_s, 0.0), self.rest_s + self.turn_s)
        return step.astype(np.int64), (within - self.rest_s) / self.turn_s


@dataclass(frozen=True, slots=True)
class Coning(Body):
    """Classical coning: the z axis goes round the vertical at `half_angle_deg` from it, `turns_hz` times a second.

    The body's own rate has a constant part about z though the attitude comes back after each round: whoever takes the
    turns of a sample for a vector to be added up sees a drift of yaw.
    """

    half_angle_deg: float = 10.0
    turns_hz: float = 1.0

    def rate_rad_s(self, t_s: FloatArray) -> FloatArray:
        angle, omega = self.half_angle_deg * RAD_PER_DEG, 2 * np.pi * self.turns_hz
        phase, across = omega * t_s, omega * np.sin(angle)
        along = np.full(len(t_s), omega * (np.cos(angle) - 1.0))
        return np.stack([-across * np.sin(phase), across * np.cos(phase), along], 1)

    def attitude(self, t_s: FloatArray) -> FloatArray:
        half, phase = self.half_angle_deg * RAD_PER_DEG / 2, 2 * np.pi * self.turns_hz * t_s
        cos = np.full(len(t_s), np.cos(half))
        return np.stack([cos, np.sin(half) * np.cos(phase), np.sin(half) * np.sin(phase), np.zeros(len(t_s))], 1)


@cache
def _rest_attitudes() -> FloatArray:
    """The attitudes (48, 4) of the board at rest, in turn."""
    attitudes = np.zeros((_ATTITUDES, 4))
    attitudes[0, 0] = 1.0
    for step in range(1, _ATTITUDES):
        quarter = np.append(1.0, _QUARTER_TURNS[(step - 1) % len(_QUARTER_TURNS)]) / np.sqrt(2.0)
        attitudes[step] = _product(attitudes[step - 1 : step], quarter[None])[0]
    # All are of halves and square roots of halves: without the error of rounding the faces are exact.
    exact: FloatArray = np.sign(attitudes) * np.sqrt(np.rint(4 * attitudes**2) / 4)
    return exact


def _product(p: FloatArray, q: FloatArray) -> FloatArray:
    """Hamilton products (N, 4)."""
    (a, b, c, d), (w, x, y, z) = p.T, q.T
    return np.stack(
        [
            a * w - b * x - c * y - d * z,
            a * x + b * w + c * z - d * y,
            a * y - b * z + c * w + d * x,
            a * z + b * y - c * x + d * w,
        ],
        1,
    )
