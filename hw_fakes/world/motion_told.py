"""A board on a bench, in the hands of somebody who does what he is told."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from hw_fakes.world.motion_base import Body, EarthField, FloatArray, smooth_step, to_body
from quavelet.core.quaternion import multiply, normalise

UP = np.array([0.0, 0.0, 1.0])


class ToldMotion(Body):
    """At rest but for the turns it was told of, each about an axis of the world, smooth and at one place.

    A chip in motion has to `recompute` after each of them.
    """

    def __init__(self, *, earth_field: EarthField | None = None) -> None:
        object.__setattr__(self, "earth_field", earth_field or EarthField())
        object.__setattr__(self, "_turns", [_Turn(-np.inf, 1.0, np.array([1.0, 0.0, 0.0, 0.0]), UP, 0.0)])

    _turns: list[_Turn]

    @property
    def free_s(self) -> float:
        """When the last turn ends; -inf before the first."""
        last = self._turns[-1]
        return last.from_s + last.takes_s

    def turn(self, axis: FloatArray, angle_rad: float, *, at_s: float, takes_s: float) -> None:
        """Turn about this world axis (3,) from `at_s` on, or when the turns before have ended."""
        from_s = max(at_s, self.free_s)
        self._turns.append(_Turn(from_s, takes_s, self._attitude_after(), axis / np.linalg.norm(axis), angle_rad))

    def bring_up(self, direction: FloatArray, *, at_s: float, takes_s: float, to: FloatArray = UP) -> None:
        """Turn, the shortest way, until this body direction (3,) points along `to` (3,) in the world."""
        now, there = _to_world(self._attitude_after(), direction), to / np.linalg.norm(to)
        axis = np.cross(now, there)
        sine = float(np.linalg.norm(axis))
        axis = axis / sine if sine > 1e-9 else np.array([1.0, 0.0, 0.0])
        self.turn(axis, float(np.arctan2(sine, now @ there)), at_s=at_s, takes_s=takes_s)

    def attitude(self, t_s: FloatArray) -> FloatArray:
        joined: FloatArray = np.empty((len(t_s), 4))
        for k, here in self._spans(t_s):
            turn = self._turns[k]
            half = turn.angle_rad / 2 * smooth_step((t_s[here] - turn.from_s) / turn.takes_s)[0]
            joined[here] = multiply(_about(turn.axis, half), turn.start)
        return joined

    def rate_rad_s(self, t_s: FloatArray) -> FloatArray:
        world: FloatArray = np.empty((len(t_s), 3))
        for k, here in self._spans(t_s):
            turn = self._turns[k]
            speed = turn.angle_rad / turn.takes_s * smooth_step((t_s[here] - turn.from_s) / turn.takes_s)[1]
            world[here] = speed[:, None] * turn.axis
        return to_body(self.attitude(t_s), world)

    def _spans(self, t_s: FloatArray) -> list[tuple[int, FloatArray]]:
        number = np.searchsorted([turn.from_s for turn in self._turns], t_s, side="right") - 1
        return [(int(k), number == k) for k in np.unique(number)]

    def _attitude_after(self) -> FloatArray:
        last = self._turns[-1]
        after: FloatArray = normalise(multiply(_about(last.axis, np.array([last.angle_rad / 2])), last.start))[0]
        return after


class _Turn(NamedTuple):
    """From attitude `start` (4,) by `angle_rad` about a world axis (3,), within `takes_s` of `from_s`."""

    from_s: float
    takes_s: float
    start: FloatArray
    axis: FloatArray
    angle_rad: float


def _to_world(attitude: FloatArray, body: FloatArray) -> FloatArray:
    """A body direction (3,) as a unit vector of the world."""
    world = to_body(attitude[None] * [1.0, -1.0, -1.0, -1.0], body[None])[0]
    unit: FloatArray = world / np.linalg.norm(world)
    return unit


def _about(axis: FloatArray, half_rad: FloatArray) -> FloatArray:
    return np.column_stack([np.cos(half_rad), np.outer(np.sin(half_rad), axis)])
