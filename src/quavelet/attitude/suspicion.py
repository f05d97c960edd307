"""A rate that is steady and small, and is not the bias: a slow turn, or a bias that has run away."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from quavelet.attitude.quiet import WINDOW_S, Quiet, Window, last_of
from quavelet.core.blocks import FloatArray
from quavelet.core.units import RAD_PER_DEG, STANDARD_GRAVITY_M_S2

QUIET_S = 10.0
"""After so long the heading is suspect."""
SMALL_RAD_S = 0.3 * RAD_PER_DEG
TILTS_M_S2 = 0.2 * RAD_PER_DEG * STANDARD_GRAVITY_M_S2
"""A second in which the force changes by more from one half to the other is one of motion."""
WARM_UP_S = 300.0
CHANGING_DEGC_S = 0.2 / 60.0
FAST_S, SLOW_S = 30.0, 90.0


@dataclass(frozen=True, slots=True)
class Suspicion:
    """How long the board has been quiet with a rate that is not the bias, what that rate adds up to (rad), and
    whether heading is suspect for it; it stays so until the board is still again, or the rate is taken for the bias."""

    quiet_s: float = 0.0
    turned_rad: tuple[float, float, float] = (0.0, 0.0, 0.0)
    suspect: bool = False


@dataclass(frozen=True, slots=True, eq=False)
class Taken:
    """A rate that is taken for the bias, rad/s, and how long it has been there."""

    mean_rad_s: FloatArray
    duration_s: float


@dataclass(frozen=True, slots=True)
class Warmth:
    """The chip's temperature through two low-passes. A ramp shows as their difference, its slope times the
    difference of their time constants."""

    fast_degc: float = 0.0
    slow_degc: float = 0.0

    @property
    def changes(self) -> bool:
        """Does the temperature change by more than 0.2 degC a minute?"""
        return abs(self.fast_degc - self.slow_degc) > CHANGING_DEGC_S * (SLOW_S - FAST_S)


def warmed(warmth: Warmth, temp_degc: float, dt: float) -> Warmth:
    """After one more sample."""
    return Warmth(
        warmth.fast_degc + dt / (FAST_S + dt) * (temp_degc - warmth.fast_degc),
        warmth.slow_degc + dt / (SLOW_S + dt) * (temp_degc - warmth.slow_degc),
    )


def after_window(
    s: Suspicion,
    quiet: Quiet,
    window: Window,
    bias: FloatArray,
    chunk: FloatArray,
    *,
    relearn_s: float,
    may_relearn: bool,
) -> tuple[Suspicion, Taken | None]:
    """After one more chunk of a board that is not still, and the rate that is to be taken for the bias, if any."""
    half = last_of(quiet.chunks, WINDOW_S)[:, 5:8]
    middle = len(half) // 2
    drift = np.abs(half[middle:].mean(axis=0) - half[:middle].mean(axis=0))
    small = np.abs(window.mean[:3] - bias) < SMALL_RAD_S
    if not (window.calm and small.all() and (drift < TILTS_M_S2).all()):
        return Suspicion(suspect=s.suspect), None
    duration_s = float(chunk[0, 0])
    quiet_s = s.quiet_s + duration_s
    x, y, z = (s.turned_rad + duration_s * chunk[0, 2:5]).tolist()
    if relearn_s > 0.0 and may_relearn and quiet_s >= relearn_s:
        return Suspicion(), Taken(np.array([x, y, z]) / quiet_s, quiet_s)
    return Suspicion(quiet_s, (x, y, z), s.suspect or quiet_s >= QUIET_S), None
