"""Motions about one place: the sensor turns and does not travel."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hw_fakes.world.motion_base import Body, EulerMotion, FloatArray, Motion, smooth_step, smooth_step_area
from quavelet.core.units import RAD_PER_DEG

__all__ = ["Motion", "Still", "Sway", "Tilt", "Turntable"]


@dataclass(frozen=True, slots=True)
class Still(EulerMotion):
    """The board lies for ever as it is put down."""

    roll_deg: float = 0.0
    pitch_deg: float = 0.0
    yaw_deg: float = 0.0

    def euler_rad(self, t_s: FloatArray) -> tuple[FloatArray, FloatArray]:
        angles = np.array([self.roll_deg, self.pitch_deg, self.yaw_deg]) * RAD_PER_DEG
        return np.broadcast_to(angles, (len(t_s), 3)), np.zeros((len(t_s), 3))


@dataclass(frozen=True, slots=True)
class Tilt(EulerMotion):
    """Still until `start_s`, then for ever from plateau to plateau: `move_s` of smooth motion, `hold_s` of rest."""

    start_s: float = 3.0
    move_s: float = 1.5
    hold_s: float = 1.5
    plateaus_deg: tuple[tuple[float, float], ...] = (
        (0.0, 0.0),
        (30.0, 0.0),
        (-30.0, 0.0),
        (0.0, 0.0),
        (0.0, 25.0),
        (0.0, -25.0),
        (20.0, 15.0),
    )
    """Roll and pitch of each; the first is where it starts."""

    def euler_rad(self, t_s: FloatArray) -> tuple[FloatArray, FloatArray]:
        plateaus = np.array(self.plateaus_deg) * RAD_PER_DEG
        since = np.maximum(t_s - self.start_s, 0.0)
        step, within = np.divmod(since, self.move_s + self.hold_s)
        here = step.astype(np.int64) % len(plateaus)
        way = plateaus[(here + 1) % len(plateaus)] - plateaus[here]
        done, done_rate = smooth_step(within / self.move_s)
        angles, rates = np.zeros((len(t_s), 3)), np.zeros((len(t_s), 3))
        angles[:, :2] = plateaus[here] + way * done[:, None]
        rates[:, :2] = way * done_rate[:, None] / self.move_s
        return angles, rates


@dataclass(frozen=True, slots=True)
class Sway(EulerMotion):
    """A boat: in motion from the first moment, rolling and pitching while it slowly turns."""

    roll_deg: float = 20.0
    roll_hz: float = 0.5
    pitch_deg: float = 20.0
    pitch_hz: float = 0.3
    yaw_deg_s: float = 2.0

    def euler_rad(self, t_s: FloatArray) -> tuple[FloatArray, FloatArray]:
        size = np.array([self.roll_deg, self.pitch_deg]) * RAD_PER_DEG
        omega = 2 * np.pi * np.array([self.roll_hz, self.pitch_hz])
        phase = omega * t_s[:, None]
        yaw_rate = self.yaw_deg_s * RAD_PER_DEG
        angles = np.column_stack([size * np.sin(phase), yaw_rate * t_s])
        rates = np.column_stack([size * omega * np.cos(phase), np.full(len(t_s), yaw_rate)])
        return angles, rates


@dataclass(frozen=True, slots=True)
class Turntable(Body):
    """A turntable that stands still until `start_s`, then turns by `turn_deg` and stands still again.

    The board lies flat on it; its axis leans by `axis_tilt_deg` from the vertical, about world x. The rate goes up
    to `rate_deg_s` and down again within `ramp_s` each; a negative `turn_deg` turns the other way.
    """

    start_s: float = 5.0
    turn_deg: float = 360.0
    rate_deg_s: float = 30.0
    ramp_s: float = 1.0
    axis_tilt_deg: float = 0.0

    def __post_init__(self) -> None:
        if self.rate_deg_s <= 0 or abs(self.turn_deg) < self.rate_deg_s * self.ramp_s:
            raise ValueError(
                "the turn ends before the table is up to speed: give a larger turn_deg or a smaller ramp_s"
            )

    @property
    def stop_s(self) -> float:
        """When the table stands still again."""
        return self.start_s + abs(self.turn_deg) / self.rate_deg_s + self.ramp_s

    def angle_rad(self, t_s: FloatArray) -> tuple[FloatArray, FloatArray]:
        """The table's angle (N,) in rad and its rate (N,) in rad/s."""
        # The rate is a smooth step up less the same step down later; the angle is the difference of their integrals.
        rate = np.copysign(self.rate_deg_s, self.turn_deg) * RAD_PER_DEG
        up = (t_s - self.start_s) / self.ramp_s
        down = (t_s - self.stop_s) / self.ramp_s + 1.0
        angle = rate * self.ramp_s * (smooth_step_area(up) - smooth_step_area(down))
        return angle, rate * (smooth_step(up)[0] - smooth_step(down)[0])

    def rate_rad_s(self, t_s: FloatArray) -> FloatArray:
        rates = np.zeros((len(t_s), 3))
        rates[:, 2] = self.angle_rad(t_s)[1]
        return rates

    def attitude(self, t_s: FloatArray) -> FloatArray:
        half, lean = self.angle_rad(t_s)[0] / 2, self.axis_tilt_deg * RAD_PER_DEG / 2
        cos, sin = np.cos(half), np.sin(half)
        return np.stack([np.cos(lean) * cos, np.sin(lean) * cos, -np.sin(lean) * sin, np.cos(lean) * sin], 1)
