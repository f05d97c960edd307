"""A motion that changes while it runs."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from hw_fakes.world.motion_base import Body, EarthField, FloatArray, Motion, smooth_step
from quavelet.core.quaternion import conjugate, multiply


class SwitchedMotion:
    """A `Motion` that is another from each `switch` on.

    Attitude never jumps: the board stops where it is, turns smoothly within `turn_s` about a constant axis to where the
    next motion begins, and follows that from its own time zero. It turns at one place. Rate and specific force belong
    to that, so they may jump where the turn begins and where it ends: motions are left, and some begin, at full speed.
    """

    def __init__(self, first: Motion, *, turn_s: float = 1.5) -> None:
        """`first` is the motion until the first switch. Raises ValueError for a `turn_s` that is not above 0."""
        if not turn_s > 0:
            raise ValueError(f"turn_s {turn_s} must be above 0: a turn takes time")
        self.turn_s = turn_s
        self._pieces = [_Piece(-np.inf, 0.0, first)]
        self._last_s = -np.inf

    @property
    def present(self) -> Motion:
        """The motion since the last switch, or that the board is being turned to."""
        return self._pieces[-1].motion

    def switch(self, motion: Motion, at_s: float) -> None:
        """Begin to turn to `motion` at `at_s`, in s of the whole. A chip in motion has to `recompute` after it.

        Raises ValueError where that is before the last switch.
        """
        if at_s < self._last_s:
            raise ValueError(f"at_s {at_s:g} is before the last switch at {self._last_s:g} s: give a later one")
        here, there = self.attitude(np.array([at_s])), motion.attitude(np.zeros(1))
        field = motion.earth_field if isinstance(motion, Body) else EarthField()
        turn = _Turn.between(here, there, turn_s=self.turn_s, earth_field=field)
        begun = [piece for piece in self._pieces if piece.from_s < at_s]
        end_s = at_s + self.turn_s
        self._pieces = [*begun, _Piece(at_s, at_s, turn), _Piece(end_s, end_s, motion)]
        self._last_s = at_s

    def attitude(self, t_s: FloatArray) -> FloatArray:
        return self._joined(t_s, lambda motion, t: motion.attitude(t))

    def rate_rad_s(self, t_s: FloatArray) -> FloatArray:
        return self._joined(t_s, lambda motion, t: motion.rate_rad_s(t))

    def specific_force_m_s2(self, t_s: FloatArray) -> FloatArray:
        return self._joined(t_s, lambda motion, t: motion.specific_force_m_s2(t))

    def magnetic_field_ut(self, t_s: FloatArray) -> FloatArray:
        return self._joined(t_s, lambda motion, t: motion.magnetic_field_ut(t))

    def _joined(self, t_s: FloatArray, ask: Callable[[Motion, FloatArray], FloatArray]) -> FloatArray:
        pieces = self._pieces
        number = np.searchsorted([piece.from_s for piece in pieces], t_s, side="right") - 1
        if len(t_s) == 0 or (number == number[0]).all():
            piece = pieces[int(number[0]) if len(t_s) else 0]
            return ask(piece.motion, t_s - piece.zero_s)
        joined: FloatArray | None = None
        for one in np.unique(number):
            here, piece = number == one, pieces[int(one)]
            part = ask(piece.motion, t_s[here] - piece.zero_s)
            joined = np.empty((len(t_s), part.shape[1])) if joined is None else joined
            joined[here] = part
        assert joined is not None
        return joined


class _Piece(NamedTuple):
    """A motion from `from_s` on, whose own time is 0 at `zero_s`."""

    from_s: float
    zero_s: float
    motion: Motion


@dataclass(frozen=True, slots=True)
class _Turn(Body):
    """From 0 to `turn_s` a smooth turn by `angle_rad` about a body axis (3,); `start` (1, 4) is the attitude before."""

    start: FloatArray
    axis: FloatArray
    angle_rad: float
    turn_s: float

    @classmethod
    def between(cls, here: FloatArray, there: FloatArray, *, turn_s: float, earth_field: EarthField) -> _Turn:
        """The shortest turn between two attitudes (1, 4)."""
        way = multiply(conjugate(here), there)[0]
        way = -way if way[0] < 0 else way
        sine = float(np.linalg.norm(way[1:]))
        axis = way[1:] / sine if sine > 0 else np.array([0.0, 0.0, 1.0])
        return cls(here, axis, 2 * float(np.arctan2(sine, way[0])), turn_s, earth_field=earth_field)

    def attitude(self, t_s: FloatArray) -> FloatArray:
        half = self.angle_rad / 2 * smooth_step(t_s / self.turn_s)[0]
        return multiply(self.start, np.column_stack([np.cos(half), np.outer(np.sin(half), self.axis)]))

    def rate_rad_s(self, t_s: FloatArray) -> FloatArray:
        return np.outer(self.angle_rad / self.turn_s * smooth_step(t_s / self.turn_s)[1], self.axis)
