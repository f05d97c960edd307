"""What every motion of the board is made of: attitude, angular rate and specific force as functions of time.

Time is seconds since the fake world began; the world is ENU (z up), the quaternion turns body to world (Hamilton,
scalar first), and the accelerometer of a level board at rest would read (0, 0, +g).
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from quavelet.core.units import RAD_PER_DEG, STANDARD_GRAVITY_M_S2

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True)
class EarthField:
    """The Earth's magnetic field where the board is; the defaults are those of Central Europe.

    strength_ut      whole field
    inclination_deg  downward from the horizontal
    declination_deg  of its horizontal part, eastward from north
    """

    strength_ut: float = 49.0
    inclination_deg: float = 66.0
    declination_deg: float = 4.0

    @property
    def world_ut(self) -> FloatArray:
        """The field (3,) in world axes: east, north, up."""
        dip, east = self.inclination_deg * RAD_PER_DEG, self.declination_deg * RAD_PER_DEG
        return self.strength_ut * np.array([np.cos(dip) * np.sin(east), np.cos(dip) * np.cos(east), -np.sin(dip)])


class Motion(Protocol):
    """The truth of a scenario; every function takes times (N,) in s."""

    def rate_rad_s(self, t_s: FloatArray) -> FloatArray:
        """Angular rate (N, 3) of the body against the world, in body axes."""
        ...

    def specific_force_m_s2(self, t_s: FloatArray) -> FloatArray:
        """Specific force (N, 3) in body axes."""
        ...

    def attitude(self, t_s: FloatArray) -> FloatArray:
        """Unit quaternions (N, 4), body to world."""
        ...

    def magnetic_field_ut(self, t_s: FloatArray) -> FloatArray:
        """Magnetic field (N, 3) in body axes."""
        ...


@dataclass(frozen=True, slots=True, kw_only=True)
class Body(ABC):
    """A motion whose specific force and magnetic field follow from its attitude and its place's acceleration."""

    earth_field: EarthField = EarthField()

    @abstractmethod
    def attitude(self, t_s: FloatArray) -> FloatArray:
        """Unit quaternions (N, 4), body to world, at times (N,) in s."""

    @abstractmethod
    def rate_rad_s(self, t_s: FloatArray) -> FloatArray:
        """Angular rate (N, 3) of the body against the world, in body axes, at times (N,) in s."""

    def position_m(self, t_s: FloatArray) -> FloatArray:
        """Where the sensor is (N, 3), in world axes, at times (N,) in s: here always at one place."""
        return np.zeros((len(t_s), 3))

    def acceleration_m_s2(self, t_s: FloatArray) -> FloatArray:
        """The second derivative (N, 3) of `position_m`, in world axes."""
        return np.zeros((len(t_s), 3))

    def specific_force_m_s2(self, t_s: FloatArray) -> FloatArray:
        up = np.array([0.0, 0.0, STANDARD_GRAVITY_M_S2])
        return to_body(self.attitude(t_s), self.acceleration_m_s2(t_s) + up)

    def magnetic_field_ut(self, t_s: FloatArray) -> FloatArray:
        return to_body(self.attitude(t_s), np.broadcast_to(self.earth_field.world_ut, (len(t_s), 3)))


class EulerMotion(Body):
    """A motion given by roll, pitch, yaw (about x, then y, then z of the world: C = Rz Ry Rx) and their rates."""

    @abstractmethod
    def euler_rad(self, t_s: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Roll, pitch, yaw (N, 3) in rad and their derivatives (N, 3) in rad/s."""

    def rate_rad_s(self, t_s: FloatArray) -> FloatArray:
        angles, rates = self.euler_rad(t_s)
        (sr, sp), (cr, cp) = np.sin(angles[:, :2]).T, np.cos(angles[:, :2]).T
        roll_rate, pitch_rate, yaw_rate = rates.T
        return np.stack(
            [roll_rate - yaw_rate * sp, pitch_rate * cr + yaw_rate * sr * cp, -pitch_rate * sr + yaw_rate * cr * cp], 1
        )

    def attitude(self, t_s: FloatArray) -> FloatArray:
        angles, _ = self.euler_rad(t_s)
        (sr, sp, sy), (cr, cp, cy) = np.sin(angles / 2).T, np.cos(angles / 2).T
        return np.stack(
            [
                cr * cp * cy + sr * sp * sy,
                sr * cp * cy - cr * sp * sy,
                cr * sp * cy + sr * cp * sy,
                cr * cp * sy - sr * sp * cy,
            ],
            1,
        )


def to_body(attitude: FloatArray, world: FloatArray) -> FloatArray:
    """World vectors (N, 3) in the axes of a body with attitude (N, 4): C^T v, in the unit of `world`."""
    w, (x, y, z), (a, b, c) = attitude[:, 0], attitude[:, 1:].T, world.T
    # v + w t + u x t, where u is minus the quaternion's vector part and t = 2 u x v.
    p, q, r = 2 * (z * b - y * c), 2 * (x * c - z * a), 2 * (y * a - x * b)
    return np.stack([a + w * p + z * q - y * r, b + w * q + x * r - z * p, c + w * r + y * p - x * q], 1)


def smooth_step(u: FloatArray) -> tuple[FloatArray, FloatArray]:
    """A step from 0 (u <= 0) to 1 (u >= 1) with continuous second derivative, and its derivative."""
    u = np.clip(u, 0.0, 1.0)
    return u**3 * (10 - 15 * u + 6 * u**2), 30 * u**2 * (1 - u) ** 2


def smooth_step_bend(u: FloatArray) -> FloatArray:
    """The second derivative of `smooth_step`."""
    u = np.clip(u, 0.0, 1.0)
    bend: FloatArray = 60 * u * (1 - u) * (1 - 2 * u)
    return bend


def smooth_step_area(u: FloatArray) -> FloatArray:
    """The integral of `smooth_step` from 0 on."""
    inside = np.clip(u, 0.0, 1.0)
    area: FloatArray = inside**4 * (2.5 - 3 * inside + inside**2) + np.maximum(u - 1.0, 0.0)
    return area
