"""A board that is shown to somebody: at rest and in lively motion by turns."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from hw_fakes.world.motion_base import EulerMotion, FloatArray, smooth_step
from quavelet.core.units import RAD_PER_DEG


class Move(NamedTuple):
    """A smooth turn to roll, pitch and yaw within `move_s`, and `hold_s` of rest there."""

    roll_deg: float
    pitch_deg: float
    yaw_deg: float
    move_s: float
    hold_s: float


_MOVES = (
    Move(35, 0, 0, 1.2, 1.5),
    Move(-35, 0, 0, 1.8, 1.0),
    Move(0, 0, 0, 1.2, 4.0),
    Move(0, 30, 0, 1.2, 4.0),
    Move(0, -30, 0, 1.8, 1.0),
    Move(0, 0, 0, 1.2, 4.0),
    Move(0, 0, 120, 2.5, 4.0),
    Move(0, 0, -120, 4.0, 4.0),
    Move(25, -20, -60, 1.5, 1.5),
    Move(-20, 25, 30, 2.0, 1.5),
    Move(0, 0, 0, 1.5, 4.0),
)


@dataclass(frozen=True, slots=True)
class Show(EulerMotion):
    """Still until `start_s`, then for ever: the `moves`, a sway, `rest_s` of rest."""

    start_s: float = 6.0
    moves: tuple[Move, ...] = _MOVES
    sway_s: float = 8.0
    sway_deg: tuple[float, float, float] = (22.0, 18.0, 30.0)
    """Amplitudes of roll, pitch, yaw in the middle of the sway."""
    sway_hz: tuple[float, float, float] = (0.75, 0.55, 0.3)
    rest_s: float = 4.0

    def __post_init__(self) -> None:
        last = self.moves[-1] if self.moves else None
        if last is None or last[:3] != (0, 0, 0) or any(move.move_s <= 0 or move.hold_s < 0 for move in self.moves):
            raise ValueError("the moves of a show take time and come back: end with roll, pitch and yaw 0")
        if not self.sway_s > 0:
            raise ValueError(f"sway_s {self.sway_s} must be above 0: leave out the sway by sway_deg 0")

    @property
    def lap_s(self) -> float:
        """After so long all comes again."""
        return sum(move.move_s + move.hold_s for move in self.moves) + self.sway_s + self.rest_s

    def euler_rad(self, t_s: FloatArray) -> tuple[FloatArray, FloatArray]:
        since = np.maximum(t_s - self.start_s, 0.0) % self.lap_s
        angles, rates = np.zeros((len(t_s), 3)), np.zeros((len(t_s), 3))
        begin, here = 0.0, np.zeros(3)
        for move in self.moves:
            way = np.array(move[:3]) * RAD_PER_DEG - here
            done, done_rate = smooth_step((since - begin) / move.move_s)
            angles += np.outer(done, way)
            rates += np.outer(done_rate / move.move_s, way)
            begin, here = begin + move.move_s + move.hold_s, here + way
        sway, sway_rate = self._sway(since - begin)
        return angles + sway, rates + sway_rate

    def _sway(self, since_s: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Tones that grow and fade, to the second derivative continuous."""
        u = np.clip(since_s / self.sway_s, 0.0, 1.0)
        size, size_rate = 64 * (u * (1 - u)) ** 3, 192 * (u * (1 - u)) ** 2 * (1 - 2 * u) / self.sway_s
        omega = 2 * np.pi * np.array(self.sway_hz)
        phase, most = omega * since_s[:, None], np.array(self.sway_deg) * RAD_PER_DEG
        tone = most * np.sin(phase)
        return size[:, None] * tone, size_rate[:, None] * tone + size[:, None] * most * omega * np.cos(phase)
