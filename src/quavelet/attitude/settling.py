"""Is the attitude to be trusted yet, and with what gains is it found when it is not?"""

from __future__ import annotations

from dataclasses import dataclass, replace

from quavelet.attitude.correction import Gains
from quavelet.core.units import RAD_PER_DEG

ACQUIRE_KP = 2.0
"""With the integral's gain at kp^2/4 (critical damping) 20 deg/s of bias cost 0.7 deg of tilt after 5 s."""
ACQUIRE_S = 15.0
"""Time at full gain; over the same time again it falls to 1. A bias about the vertical is learned only as the
board tilts, so this takes much longer than the tilt itself."""
ACQUIRE_LIMIT_RAD_S = 25.0 * RAD_PER_DEG
"""The integral must hold any bias: the data sheet's 20 deg/s (PS 6.1) and a margin."""
SETTLED_RAD, UNSETTLED_RAD = 2.5 * RAD_PER_DEG, 5.0 * RAD_PER_DEG
"""Root mean square error below which the attitude is trusted, and above which it no longer is while the bias is
unknown."""
AGREE_S = 2.0
"""How long gravity must agree."""
LEAST_S = 4.0
"""No trust before the tilt error of an unknown bias has died down."""
FORGET = 5.0
"""With the bias known the loop forgets a wrong start to e^-5 after so many of its time constants."""


@dataclass(frozen=True, slots=True)
class Settling:
    """settling: the attitude is not to be trusted; agreeing_s how long gravity has agreed. acquiring_s: how long the
    strong gains have been on, None when they are off. since_s: time since the start or the last long gap."""

    settling: bool = True
    agreeing_s: float = 0.0
    since_s: float = 0.0
    acquiring_s: float | None = None


def restarted(*, bias_known: bool, after_gap: bool = False) -> Settling:
    """At the start, or where a long gap ends. A known bias needs the strong gains only to make up for a gap."""
    return Settling(acquiring_s=0.0 if after_gap or not bias_known else None)


def settled() -> Settling:
    """Nothing left to settle."""
    return Settling(settling=False)


def after_step(s: Settling, error_rad: float, dt: float, kp: float, *, bias_known: bool) -> Settling:
    """One more step with this root mean square tilt error."""
    agreeing_s = s.agreeing_s + dt if error_rad < SETTLED_RAD else 0.0
    since_s = s.since_s + dt
    if not s.settling:
        settling = not bias_known and error_rad > UNSETTLED_RAD
    elif bias_known:
        settling = agreeing_s < AGREE_S and since_s * max(kp, 0.1) < FORGET
    else:
        settling = agreeing_s < AGREE_S or since_s < LEAST_S
    acquiring_s = None if s.acquiring_s is None or (bias_known and not settling) else s.acquiring_s + dt
    return Settling(settling, agreeing_s, since_s, acquiring_s)


def gains_of(s: Settling, tracking: Gains, *, bias_known: bool) -> Gains:
    """The gains of the next step: those asked for, or the strong ones while acquiring."""
    if s.acquiring_s is None:
        return tracking
    share = min(1.0, max(0.0, 2.0 - s.acquiring_s / ACQUIRE_S))
    kp = max(tracking.kp, 1.0 + (ACQUIRE_KP - 1.0) * share)
    if bias_known:
        return replace(tracking, kp=kp, kd=0.0)
    return Gains(kp, 0.25 * kp * kp, 0.0, tracking.kd_tau_s, ACQUIRE_LIMIT_RAD_S)
