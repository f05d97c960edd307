"""Motions that travel and shake: a person who walks, a drone that hovers."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from hw_fakes.world.motion_base import EulerMotion, FloatArray, smooth_step, smooth_step_area, smooth_step_bend
from quavelet.core.units import RAD_PER_DEG

Triple = tuple[float, float, float]


class Course(NamedTuple):
    """A quantity with its first and second derivative by time."""

    value: FloatArray
    first: FloatArray
    second: FloatArray


@dataclass(frozen=True, slots=True)
class Walk(EulerMotion):
    """A person who stands until `start_s`, gets going within `ramp_s` and walks for ever in a wide circle.

    Body axes are x forward, y left, z up. The body rises and falls by `rise_m` and runs ahead and behind by `surge_m`
    with each step; it pitches with each step and rolls with each pair of them. `turn_deg_s` is the slow turn, left
    positive, not 0; the circle's radius is speed over turn, and its centre is (0, 0, 0).
    """

    start_s: float = 5.0
    ramp_s: float = 2.0
    step_hz: float = 1.9
    speed_m_s: float = 1.4
    turn_deg_s: float = 6.0
    rise_m: float = 0.025
    surge_m: float = 0.012
    roll_deg: float = 4.0
    pitch_deg: float = 3.0

    def __post_init__(self) -> None:
        if self.turn_deg_s == 0 or not self.ramp_s > 0:
            raise ValueError("turn_deg_s must not be 0 and ramp_s must be above 0: take small ones")

    def euler_rad(self, t_s: FloatArray) -> tuple[FloatArray, FloatArray]:
        roll = self._step(t_s, size=self.roll_deg * RAD_PER_DEG, hz=self.step_hz / 2)
        pitch = self._step(t_s, size=self.pitch_deg * RAD_PER_DEG, hz=self.step_hz)
        heading = self._heading(t_s)
        angles = np.stack([roll.value, pitch.value, heading.value], 1)
        return angles, np.stack([roll.first, pitch.first, heading.first], 1)

    def position_m(self, t_s: FloatArray) -> FloatArray:
        ahead, rise = self._step(t_s, size=self.surge_m), self._step(t_s, size=self.rise_m, phase_rad=np.pi / 2)
        flat = np.exp(1j * self._heading(t_s).value) * (ahead.value - 1j * self._radius_m)
        return np.stack([flat.real, flat.imag, rise.value], 1)

    def acceleration_m_s2(self, t_s: FloatArray) -> FloatArray:
        ahead, rise = self._step(t_s, size=self.surge_m), self._step(t_s, size=self.rise_m, phase_rad=np.pi / 2)
        heading = self._heading(t_s)
        # The second derivative of exp(i heading) times what stands after it, east as real and north as imaginary part.
        place = ahead.value - 1j * self._radius_m
        turned = ahead.second + 2j * heading.first * ahead.first + (1j * heading.second - heading.first**2) * place
        flat = np.exp(1j * heading.value) * turned
        return np.stack([flat.real, flat.imag, rise.second], 1)

    @property
    def _radius_m(self) -> float:
        return self.speed_m_s / (self.turn_deg_s * RAD_PER_DEG)

    def _heading(self, t_s: FloatArray) -> Course:
        rate, done = self.turn_deg_s * RAD_PER_DEG, (t_s - self.start_s) / self.ramp_s
        speed, speeding = smooth_step(done)
        return Course(rate * self.ramp_s * smooth_step_area(done), rate * speed, rate / self.ramp_s * speeding)

    def _step(self, t_s: FloatArray, *, size: float, hz: float | None = None, phase_rad: float = 0.0) -> Course:
        hz = self.step_hz if hz is None else hz
        return grown_tone(t_s - self.start_s, ramp_s=self.ramp_s, size=size, hz=hz, phase_rad=phase_rad)


@dataclass(frozen=True, slots=True, kw_only=True)
class Vibration:
    """One tone of a vibration: amplitudes of acceleration along the world's axes and of the roll, pitch, yaw rates."""

    hz: float
    accel_m_s2: Triple = (0.0, 0.0, 0.0)
    rate_deg_s: Triple = (0.0, 0.0, 0.0)


@dataclass(frozen=True, slots=True)
class Drone(EulerMotion):
    """A drone that stands until `start_s`, spins up within `ramp_s` and then hovers for ever.

    It leans and turns slowly, as one held by the wind against its place, so no acceleration goes with the lean; its
    rotors shake it with `vibrations`: an imbalance once a turn, and the passing of two blades.
    """

    start_s: float = 5.0
    ramp_s: float = 2.0
    lean_deg: Triple = (2.0, 1.5, 5.0)
    """Amplitudes of roll, pitch, yaw."""
    lean_hz: Triple = (0.31, 0.23, 0.07)
    vibrations: tuple[Vibration, ...] = (
        Vibration(hz=92.0, accel_m_s2=(1.0, 1.2, 0.8), rate_deg_s=(4.0, 5.0, 1.0)),
        Vibration(hz=184.0, accel_m_s2=(0.5, 0.5, 3.0), rate_deg_s=(2.0, 2.0, 0.5)),
    )

    def __post_init__(self) -> None:
        if not self.ramp_s > 0:
            raise ValueError(f"ramp_s {self.ramp_s} must be above 0: rotors spin up in time")

    def euler_rad(self, t_s: FloatArray) -> tuple[FloatArray, FloatArray]:
        leans = [self._tone(t_s, a * RAD_PER_DEG, hz) for a, hz in zip(self.lean_deg, self.lean_hz, strict=True)]
        angles = np.stack([lean.value for lean in leans], 1)
        rates = np.stack([lean.first for lean in leans], 1)
        for shake in self.vibrations:
            tone = self._tone(t_s, 1 / (2 * np.pi * shake.hz), shake.hz)
            size = np.array(shake.rate_deg_s) * RAD_PER_DEG
            angles += np.outer(tone.value, size)
            rates += np.outer(tone.first, size)
        return angles, rates

    def position_m(self, t_s: FloatArray) -> FloatArray:
        return sum((np.outer(tone.value, size) for tone, size in self._shakes(t_s)), start=np.zeros((len(t_s), 3)))

    def acceleration_m_s2(self, t_s: FloatArray) -> FloatArray:
        return sum((np.outer(tone.second, size) for tone, size in self._shakes(t_s)), start=np.zeros((len(t_s), 3)))

    def _shakes(self, t_s: FloatArray) -> list[tuple[Course, Triple]]:
        return [
            (self._tone(t_s, 1 / (2 * np.pi * shake.hz) ** 2, shake.hz), shake.accel_m_s2) for shake in self.vibrations
        ]

    def _tone(self, t_s: FloatArray, size: float, hz: float) -> Course:
        return grown_tone(t_s - self.start_s, ramp_s=self.ramp_s, size=size, hz=hz)


def grown_tone(since_s: FloatArray, *, ramp_s: float, size: float, hz: float, phase_rad: float = 0.0) -> Course:
    """A tone (N,) of amplitude `size` that grows from nothing within the first `ramp_s`, in the unit of `size`."""
    done, omega = since_s / ramp_s, 2 * np.pi * hz
    (grown, growing), bend = smooth_step(done), smooth_step_bend(done)
    sin, cos = np.sin(omega * since_s + phase_rad), np.cos(omega * since_s + phase_rad)
    growing, bend = growing / ramp_s, bend / ramp_s**2
    return Course(
        size * grown * sin,
        size * (growing * sin + omega * grown * cos),
        size * (bend * sin + 2 * omega * growing * cos - omega**2 * grown * sin),
    )
