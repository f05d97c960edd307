"""The car of paper 004: at rest with its engine on, people get in, rock it, get out, and push it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from quavelet.alignment.result import EARTH_RATE_RAD_S
from quavelet.core.blocks import FloatArray
from quavelet.core.euler import from_euler
from quavelet.core.quaternion import to_matrix
from quavelet.core.units import RAD_PER_DEG, STANDARD_GRAVITY_M_S2

G = STANDARD_GRAVITY_M_S2
DEG_H = RAD_PER_DEG / 3600.0
LATITUDE_RAD = 30.58 * RAD_PER_DEG
AZIMUTH_DEG = 9.668
"""Counter-clockwise; with the latitude it is where the paper's segments have their mean."""
TILT_DEG = (-0.134, -0.50)
"""About x and y."""
ROCKING_DEG_H = 700.0
"""So that at 100 samples a second the azimuth of a segment scatters by some 10 deg without a filter."""
DURATION_S = 600.0
FIRST_S, SEGMENT_S, SEGMENTS = 170.0, 20.0, 20


@dataclass(frozen=True, slots=True)
class Burst:
    """People at the car: when, for how long, and how hard."""

    start_s: float
    length_s: float
    strength: float


BURSTS = (
    Burst(228.0, 30.0, 1.0),
    Burst(330.0, 15.0, 0.8),
    Burst(350.0, 60.0, 0.25),
    Burst(518.0, 20.0, 1.5),
    Burst(560.0, 15.0, 2.0),
)


def board() -> FloatArray:
    """The true rotation matrix, body to ENU."""
    angles = np.radians(np.array([TILT_DEG[1], TILT_DEG[0], -AZIMUTH_DEG]))
    return to_matrix(from_euler(angles, order="zxy"))


def truth() -> tuple[FloatArray, FloatArray]:
    """Rate in deg/h and specific force in m/s^2, (3,)."""
    rate = EARTH_RATE_RAD_S / DEG_H * np.array([0.0, np.cos(LATITUDE_RAD), np.sin(LATITUDE_RAD)])
    return board().T @ rate, G * board()[2]


def impulsive(rng: np.random.Generator) -> tuple[FloatArray, FloatArray]:
    """Rates (600, 3) in deg/h and forces (600, 3), once a second: impulses of one or two samples in white noise.

    base, rocking and their rate were picked of eight combinations to match the scatter of the paper's x gyroscope.
    """
    n = round(DURATION_S)
    rate, force = truth()
    noise = 1.1 * rng.standard_normal((n, 3))
    shake = 8.5e-4 * rng.standard_normal((n, 3))
    engine = rng.random(n) < 0.03
    noise[engine] += 30.0 * rng.standard_normal((int(engine.sum()), 3))
    hit = np.zeros(n, dtype=np.bool_)
    for burst in BURSTS:
        seconds = np.arange(round(burst.start_s), min(n, round(burst.start_s + burst.length_s)))
        noise[seconds] += 3.0 * burst.strength * rng.standard_normal((len(seconds), 3))
        for second in seconds[rng.random(len(seconds)) < 0.09]:
            rows = slice(second, second + int(rng.integers(1, 3)))
            noise[rows] += 400.0 * burst.strength * rng.standard_normal(3)
            hit[rows] = True
    shake[hit] += 0.05 * rng.standard_normal((int(hit.sum()), 3))
    return rate + noise, force + shake


def rocking(rng: np.random.Generator, *, rate_hz: float) -> tuple[FloatArray, FloatArray]:
    """Rates in deg/h and forces, (N, 3), of a car that is really rocked, smoothly at 1.2 Hz, in the same bursts."""
    n = round(DURATION_S * rate_hz)
    t = np.arange(n) / rate_hz
    rate, force = truth()
    noise = 1.1 * rng.standard_normal((n, 3))
    for burst in BURSTS:
        # Nobody gets in or out on the second: the segments do not hold whole periods.
        start, end = burst.start_s + rng.uniform(-2.0, 2.0), burst.start_s + burst.length_s + rng.uniform(-2.0, 2.0)
        rows = (t >= start) & (t < end)
        phase, size = rng.uniform(0.0, 2 * np.pi, 3), ROCKING_DEG_H * burst.strength * rng.standard_normal(3)
        noise[rows] += size * np.sin(2 * np.pi * 1.2 * t[rows, None] + phase)
    return rate + noise, force + 8.5e-4 * rng.standard_normal((n, 3))
