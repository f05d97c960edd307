"""Is the board still? Decided by what it has itself shown of stillness: noise is learned from the quietest seconds.

Samples come in chunks of a twentieth of a second. A second of chunks is calm when no axis is more than twice as noisy
as in the quietest second so far; it is still when also its mean rate is the bias and its mean force the one known.
Over eight seconds the same is asked of the rate, whose noise is then as much less.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from quavelet.core.blocks import FloatArray
from quavelet.core.units import RAD_PER_DEG, STANDARD_GRAVITY_M_S2

CHUNK_S = 0.05
WINDOW_S, LONG_S = 1.0, 8.0
FORGET_S = 60.0
"""What was learned follows the noise of a board that is still, which grows as a chip warms up, with this time
constant; it follows no other, else slow motion would be taken for noise."""
LOUDER = 2.0
"""Spread in units of the quietest second's that is still calm: a second has some 100 samples, which makes the
quietest of many 20 % too quiet."""
LEAST_SD = np.array([0.01 * RAD_PER_DEG] * 3 + [0.0005 * STANDARD_GRAVITY_M_S2] * 3)
"""No chip is quieter (a third of the data sheet's noise); below this a count's step is all there is."""
MOST_SD = np.array([0.5 * RAD_PER_DEG] * 3 + [0.020 * STANDARD_GRAVITY_M_S2] * 3)
"""Whatever has been learned, a louder board moves or shakes."""
SETTLE_S = 2.0
"""Towards a quieter second what was learned goes sooner."""

NOT_WHITE = 2.0
"""Real noise is not white: means over seconds have a variance up to three times as large as those over a twentieth
of a second let expect."""

_N, _MEAN, _SQUARES, _TINY_S = 1, slice(2, 8), slice(8, 14), 1e-9
_MOST = 1e9


@dataclass(frozen=True, slots=True, eq=False)
class Quiet:
    """All memory.

    chunks     (k, 14) the chunks of the window: s, samples, mean of rate and force, sums of squares about them
    least      (6,) variance of a sample in the quietest second
    density2   (6,) squared noise density of the means, (rad/s)^2 s and (m/s^2)^2 s
    calm_s     how long the last second has been calm
    """

    chunks: FloatArray
    least: FloatArray
    density2: FloatArray
    calm_s: float = 0.0

    @property
    def duration_s(self) -> float:
        """How long the chunks are together."""
        return float(self.chunks[:, 0].sum())

    @property
    def sd(self) -> FloatArray:
        """(6,) the noise of single samples as learned."""
        sd: FloatArray = np.sqrt(np.maximum(self.least, LEAST_SD**2))
        return sd


@dataclass(frozen=True, slots=True, eq=False)
class Window:
    """The last second: means (6,), squared sigma of them (6,), and whether all axes are calm."""

    mean: FloatArray
    mean_ms: FloatArray
    calm: bool


def unheard() -> Quiet:
    """Nothing learned."""
    return Quiet(np.empty((0, 14)), np.full(6, np.inf), np.full(6, np.inf))


def interrupted(quiet: Quiet) -> Quiet:
    """The chunks are not of one piece any more; what was learned stays."""
    return replace(quiet, chunks=np.empty((0, 14)), calm_s=0.0)


def shortened(quiet: Quiet) -> Quiet:
    """The last second only: what was before it is not still."""
    return replace(quiet, chunks=last_of(quiet.chunks, WINDOW_S))


def as_chunk(rows: tuple[tuple[float, ...], ...], duration_s: float) -> FloatArray:
    """(1, 14) the chunk of rows of rate and force."""
    values = np.array(rows)
    mean = values.mean(axis=0)
    squares = ((values - mean) ** 2).sum(axis=0)
    return np.concatenate([[duration_s, len(rows)], mean, squares])[None]


def heard(quiet: Quiet, chunk: FloatArray, *, still: bool) -> tuple[Quiet, FloatArray, Window | None]:
    """With one more chunk: the memory, the chunks that have become too old for it, and the last second, None where
    there is none yet. `still`: the board was so up to here."""
    chunks = np.concatenate([quiet.chunks, chunk])
    kept = last_of(chunks, LONG_S)
    gone = chunks[: len(chunks) - len(kept)]
    last = last_of(kept, WINDOW_S)
    if last[:, 0].sum() < WINDOW_S - _TINY_S:
        return replace(quiet, chunks=kept), gone, None
    n, duration_s = last[:, _N : _N + 1], float(last[:, 0].sum())
    mean = (n * last[:, _MEAN]).sum(axis=0) / n.sum()
    between = (n * (last[:, _MEAN] - mean) ** 2).sum(axis=0)
    variance = (last[:, _SQUARES].sum(axis=0) + between) / n.sum()
    # Of the chunks' means, not of the samples: what the chip's low-pass leaves of the noise is not independent.
    density2 = NOT_WHITE * between / ((len(last) - 1) * n.mean()) * duration_s / len(last)
    calm_s = quiet.calm_s
    least, known = np.minimum(quiet.least, variance), quiet.density2
    step_s = float(chunk[0, 0])
    share = step_s / FORGET_S if still else 0.0
    quiet = Quiet(kept, least + share * (variance - least), known)
    calm = bool((variance <= (LOUDER * quiet.sd) ** 2).all() and (variance <= MOST_SD**2).all())
    if calm:
        # Down at once: the first calm second may have been one of motion.
        shares = np.where(density2 < known, step_s / SETTLE_S, share)
        known = np.where(np.isinf(known), density2, known + shares * (density2 - np.minimum(known, _MOST)))
        quiet = replace(quiet, density2=known, calm_s=calm_s + step_s)
    else:
        known = np.minimum(known, density2)
    return quiet, gone, Window(mean, known / duration_s, calm)


def last_of(chunks: FloatArray, duration_s: float) -> FloatArray:
    """The last chunks that make up `duration_s`, or all there are."""
    total = np.cumsum(chunks[::-1, 0])
    count = int(np.searchsorted(total, duration_s - _TINY_S)) + 1
    return chunks[-count:]


def turned(chunks: FloatArray, bias: FloatArray) -> FloatArray:
    """(3,) the angle in rad that the rate less `bias` makes of these chunks."""
    angle: FloatArray = (chunks[:, :1] * (chunks[:, 2:5] - bias)).sum(axis=0)
    return angle
