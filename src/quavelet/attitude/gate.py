"""Still: how it begins, what is learned meanwhile, and how it ends."""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import sqrt

import numpy as np

from quavelet.attitude.horizon import Horizon
from quavelet.attitude.kernel import Quaternion, Vector, step, tilt_error, up_in_body
from quavelet.attitude.quiet import WINDOW_S, Quiet, Window, last_of, turned
from quavelet.core.blocks import FloatArray
from quavelet.core.units import RAD_PER_DEG, STANDARD_GRAVITY_M_S2

RATE_LIMIT_RAD_S = 0.03 * RAD_PER_DEG
"""A mean rate about the vertical that is less cannot be told from a bias that has drifted."""
RATE_MOST_RAD_S = 0.3 * RAD_PER_DEG
"""The same limit for the noisiest chip and the least known bias."""
FORCE_LIMIT_M_S2 = 0.1 * RAD_PER_DEG * STANDARD_GRAVITY_M_S2
SURE = 4.5
"""Sigmas of a mean beyond which it is not chance, with three axes asked twenty times a second for hours."""
SHOWS = 3.0
"""Sigmas of an angle from which on it is turned after all, and of a mean with which stillness does not begin."""
INSTANT = 8.0
"""Sigmas of a single sample that end stillness at once; the quietest second has a sigma that is a little small."""
KP = 1.0
"""1/s, gain of the tilt when stillness begins: from there it is the mean of all of it."""
LEAST_GAIN = 0.005
"""1/s, for a support that gives and an accelerometer that drifts."""
FORCE_TAU_S = 30.0
BIAS_TAU_S = 15.0
"""Paper 000's corrected scheme: shorter follows a chip that warms up, longer is quieter."""


@dataclass(frozen=True, slots=True, eq=False)
class Gate:
    """Memory of a board that is still.

    still_s        since it is
    force          (3,) mean force that is held to be its own, m/s^2
    limit_rad_s    of a single sample of each axis' rate less the bias
    tilt_ms        mean square of the tilt error, rad^2
    bias_variance  (3,) of the bias, (rad/s)^2
    """

    still_s: float
    force: FloatArray
    limit_rad_s: Vector
    tilt_ms: float
    bias_variance: FloatArray


def looks_still(quiet: Quiet, window: Window, bias: FloatArray, bias_variance: FloatArray) -> bool:
    """Has the board stood still for the last second, with the rate of all the calm before it?"""
    rate, variance = window.mean[:3] - bias, window.mean_ms[:3] + bias_variance
    if not window.calm or not _rate_agrees(rate, variance, sigmas=SHOWS):
        return False
    stretch = last_of(quiet.chunks, WINDOW_S + quiet.calm_s)
    duration_s = float(stretch[:, 0].sum())
    variance = quiet.density2[:3] / duration_s + bias_variance
    if not _rate_agrees(turned(stretch, bias) / duration_s, variance, sigmas=SHOWS):
        return False
    half = last_of(quiet.chunks, WINDOW_S)[:, 5:8]
    middle = len(half) // 2
    drift = half[middle:].mean(axis=0) - half[:middle].mean(axis=0)
    return bool((np.abs(drift) <= _force_limit(4.0 * window.mean_ms[3:])).all())


def stays_still(gate: Gate, quiet: Quiet, window: Window, bias: FloatArray) -> bool:
    """Does it still, by the last second and by all that is in the window?"""
    rate, variance = window.mean[:3] - bias, window.mean_ms[:3] + gate.bias_variance
    if not window.calm or not _rate_agrees(rate, variance, sigmas=SURE):
        return False
    if not (np.abs(window.mean[3:] - gate.force) <= _force_limit(2.0 * window.mean_ms[3:])).all():
        return False
    duration_s = quiet.duration_s
    variance = quiet.density2[:3] / duration_s + gate.bias_variance
    return _rate_agrees(turned(quiet.chunks, bias) / duration_s, variance, sigmas=SURE)


def entered(window: Window, quiet: Quiet, horizon: Horizon) -> Gate:
    """The board is still from here on."""
    x, y, z = (INSTANT * quiet.sd[:3]).tolist()
    return Gate(0.0, window.mean[3:], (x, y, z), horizon.tilt_ms, horizon.bias_variance)


def left(gate: Gate, rate_rad_s: Vector) -> bool:
    """Does this one sample show that the board moves?"""
    x, y, z = rate_rad_s
    a, b, c = gate.limit_rad_s
    return not (-a < x < a and -b < y < b and -c < z < c)


def rested(
    gate: Gate, q: Quaternion, chunk: FloatArray, gone: FloatArray, bias: FloatArray, quiet: Quiet
) -> tuple[Quaternion, Gate, FloatArray]:
    """After one more chunk of stillness: the attitude nearer to gravity, the memory, and the bias with what the
    chunks that have left the window say of it."""
    duration_s = float(chunk[0, 0])
    force = chunk[0, 5:8]
    fx, fy, fz = force.tolist()
    share = min(1.0, duration_s * max(1.0 / (gate.still_s + 1.0 / KP), LEAST_GAIN))
    ex, ey, ez = tilt_error(q, (fx, fy, fz))
    q = step(q, (share * ex, share * ey, share * ez), 1.0, "exp")
    noise_ms = float(quiet.density2[3:].mean()) / duration_s / STANDARD_GRAVITY_M_S2**2
    bias, variance = learned(bias, gate.bias_variance, gone, quiet)
    return (
        q,
        replace(
            gate,
            still_s=gate.still_s + duration_s,
            force=gate.force + duration_s / FORCE_TAU_S * (force - gate.force),
            tilt_ms=(1.0 - share) ** 2 * gate.tilt_ms + share * share * noise_ms,
            bias_variance=variance,
        ),
        bias,
    )


def learned(bias: FloatArray, variance: FloatArray, chunks: FloatArray, quiet: Quiet) -> tuple[FloatArray, FloatArray]:
    """The bias and its variance after chunks that were still: a running mean first, then with BIAS_TAU_S."""
    for chunk in chunks:
        duration_s = chunk[0]
        variance = variance + quiet.density2[:3] / (BIAS_TAU_S * BIAS_TAU_S) * duration_s
        share = variance / (variance + quiet.density2[:3] / duration_s)
        bias = bias + share * (chunk[2:5] - bias)
        variance = variance * (1.0 - share)
    return bias, variance


@dataclass(frozen=True, slots=True, eq=False)
class Replay:
    """What is to be turned after all, rad in the body; how sure the tilt then is, rad; and the bias."""

    turn_rad: Vector
    tilt_rad: float
    bias: FloatArray
    bias_variance: FloatArray


def replayed(gate: Gate, quiet: Quiet, partial: FloatArray, q: Quaternion, bias: FloatArray) -> Replay:
    """Where stillness ends. `partial`: the chunk that is not in the window yet, one row or none.

    A turn about the vertical is looked for in the whole window, one about a horizontal axis in the last second:
    gravity has shown it before. Chunks before the last second that show no turn are as still as any.
    """
    whole = np.concatenate([quiet.chunks, partial])
    late = last_of(whole, WINDOW_S + float(partial[:, 0].sum()))
    early = whole[: len(whole) - len(late)]
    up = np.array(up_in_body(q))
    long, long_ms = _turn(whole, quiet, gate.bias_variance, bias)
    about_up = float((long * up).sum())
    if about_up * about_up <= SHOWS * SHOWS * float((long_ms * up * up).sum()):
        bias, variance = learned(bias, gate.bias_variance, early, quiet)
        long, long_ms = _turn(late, quiet, variance, bias)
        about_up = float((long * up).sum())
        if about_up * about_up <= SHOWS * SHOWS * float((long_ms * up * up).sum()):
            about_up = 0.0
    else:
        variance = gate.bias_variance
    short, short_ms = _turn(late, quiet, variance, bias)
    short = np.where(short * short > SHOWS * SHOWS * short_ms, short, 0.0)
    across = short - (short * up).sum() * up
    x, y, z = (across + about_up * up).tolist()
    tilt_rad = sqrt(gate.tilt_ms + float(short_ms.max()) + 0.25 * float((across * across).sum()))
    return Replay((x, y, z), tilt_rad, bias, variance)


def _turn(
    chunks: FloatArray, quiet: Quiet, bias_variance: FloatArray, bias: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """The angle these chunks make, and its variance."""
    duration_s = float(chunks[:, 0].sum())
    return turned(chunks, bias), quiet.density2[:3] * duration_s + bias_variance * duration_s * duration_s


def _rate_agrees(rate: FloatArray, variance: FloatArray, *, sigmas: float) -> bool:
    limit = np.minimum(np.maximum(RATE_LIMIT_RAD_S, sigmas * np.sqrt(variance)), RATE_MOST_RAD_S)
    return bool((np.abs(rate) <= limit).all())


def _force_limit(variance: FloatArray) -> FloatArray:
    limit: FloatArray = np.maximum(FORCE_LIMIT_M_S2, SURE * np.sqrt(variance))
    return limit
