"""The wavelet filter for a stream: undecimated (a trous, stationary), causal, late by a fixed number of rows.

Analysis, level j = 1..J, of A_0 = the signal, with steps of 2^(j-1) rows between the taps:

    A_j[n] = sum_k dec_lo[k] A_(j-1)[n - 2^(j-1) k]        D_j[n] = the same with dec_hi

Synthesis, j = J..1, of A'_J = A_J and the shrunk details D'_j:

    A'_(j-1)[n] = 1/2 sum_k (rec_lo[k] A'_j[n - 2^(j-1) k] + rec_hi[k] D'_j[n - 2^(j-1) k])

Each level makes it 2^(j-1) (L-1) rows later, all of them (2^J - 1)(L-1); D'_j waits for the levels above it.
That is `pywt.iswt` of the thresholded `pywt.swt`, late: the mean of the decimated transform over all its 2^J
shifts, so that what comes out does not depend on where a row stands in a block, or a block in the stream.

Sums are taken tap by tap in one order: a matrix product may round differently by the block's length.
"""

from __future__ import annotations

from math import log, sqrt

import numpy as np

from quavelet.core.blocks import FloatArray
from quavelet.denoise.noise_meter import WINDOW, NoiseMeter
from quavelet.denoise.rows import Memory
from quavelet.denoise.shrink import Shrink, shrink
from quavelet.denoise.thresholds import Noise, StreamRule
from quavelet.denoise.wavelets import filters


class UndecimatedFilter:
    """A `RowFilter`: the wavelet filter above.

    rule        thresholds from the sigma that `NoiseMeter` finds: "universal" or "level_scaled"
    noise       "first": sigma from the details of level 1; "level": each level's from its own
    threshold   in the unit of the signal, for all levels, in place of both; a number or one for each column
    approximation   False: A_J is left out, and with it the mean and all slow motion (paper 000, A and D); or one for
                each column

    Until the noise is measured for the first time nothing is shrunk: the rows come out late and as they were.

    Memory: count details since sigma was last found; arrays[0] sigma (levels measured, k), arrays[1] the last
    details (levels measured, <= 512, k), and within a run for each level the last rows of A_(j-1), A'_j, D'_j.
    """

    def __init__(
        self,
        wavelet: str = "db3",
        levels: int = 2,
        *,
        rule: StreamRule = "universal",
        noise: Noise = "first",
        shrink: Shrink = "soft",
        k: float = 16.0,
        alpha: float = 1.0,
        threshold: float | FloatArray | None = None,
        approximation: bool | tuple[bool, ...] = True,
    ) -> None:
        self._dec, self._rec = _banks(wavelet)
        if levels < 1:
            raise ValueError(f"levels = {levels} does not fit: give 1 or more")
        self._levels = levels
        self._shrink, self._k, self._alpha = shrink, k, alpha
        self._factors = [_factor(rule, level) for level in range(1, levels + 1)]
        self._threshold = threshold
        self._kept: FloatArray = np.asarray(approximation, dtype=np.float64)
        self._noise = NoiseMeter(levels if noise == "level" else 1)
        self._shrunk(np.zeros((1, 1)), 0, np.zeros((1, 1)))  # a wrong name or parameter is to show here
        self._inputs: list[FloatArray] = []
        self._smooths: list[FloatArray] = []
        self._details: list[FloatArray] = []

    @property
    def delay(self) -> int:
        return self._reach * ((1 << self._levels) - 1)

    @property
    def _reach(self) -> int:
        """Taps but one."""
        return len(self._dec) - 1

    def push(self, rows: FloatArray) -> FloatArray:
        return self._through(rows, measure=True)

    def drain(self) -> FloatArray:
        assert self._inputs, "nothing to drain: push a row first"
        # What is repeated has no noise, and is not to be measured.
        rest = self._through(np.repeat(self._inputs[0][-1:], self.delay, axis=0), measure=False)
        self._inputs, self._smooths, self._details = [], [], []
        return rest

    def state(self) -> Memory:
        count, arrays = self._noise.state()
        return Memory(count, (*arrays, *self._inputs, *self._smooths, *self._details))

    def restore(self, state: Memory) -> None:
        levels = self._levels
        self._noise.restore(state.count, state.arrays[:2])
        run = list(state.arrays[2:])
        self._inputs, self._smooths, self._details = run[:levels], run[levels : 2 * levels], run[2 * levels :]

    def _through(self, rows: FloatArray, *, measure: bool) -> FloatArray:
        if not len(rows):
            return rows
        if not self._inputs:
            self._stand(rows[:1])
        smooth, details = self._analysed(rows)
        measured = details[: self._noise.levels]
        sigma = self._noise.follow(measured) if measure else self._noise.held(len(rows), rows.shape[1])
        kept = [self._shrunk(d, i, sigma[min(i, len(sigma) - 1)]) for i, d in enumerate(details)]
        return self._synthesised(self._kept * smooth, kept)

    def _analysed(self, rows: FloatArray) -> tuple[FloatArray, list[FloatArray]]:
        details = []
        for i in range(self._levels):
            seen = np.concatenate([self._inputs[i], rows])
            self._inputs[i] = seen[len(rows) :].copy()
            rows, detail = _filtered(np.broadcast_to(seen, (2, *seen.shape)), self._dec, step=1 << i)
            details.append(detail)
        return rows, details

    def _synthesised(self, smooth: FloatArray, details: list[FloatArray]) -> FloatArray:
        for i in range(self._levels - 1, -1, -1):
            smooths = np.concatenate([self._smooths[i], smooth])
            late = np.concatenate([self._details[i], details[i]])
            self._smooths[i] = smooths[len(smooth) :].copy()
            self._details[i] = late[len(smooth) :].copy()
            low, high = _filtered(np.stack([smooths, late[: len(smooths)]]), self._rec, step=1 << i)
            smooth = 0.5 * (low + high)
        return smooth

    def _shrunk(self, details: FloatArray, i: int, sigma: FloatArray) -> FloatArray:
        t = self._factors[i] * sigma if self._threshold is None else self._threshold
        return shrink(details, t, kind=self._shrink, k=self._k, alpha=self._alpha)

    def _stand(self, row: FloatArray) -> None:
        """The memory after standing still at `row` (1, k) for ever. What is synthesised from before the run's first
        row comes out before that row does, and is thrown away."""
        gain, k = float(self._dec[:, 0].sum()), row.shape[1]
        for i in range(self._levels):
            rows = self._reach << i
            waiting = self._reach * ((1 << self._levels) - (2 << i))
            self._inputs.append(np.repeat(row * gain**i, rows, axis=0))
            self._smooths.append(np.zeros((rows, k)))
            self._details.append(np.zeros((rows + waiting, k)))


def _banks(wavelet: str) -> tuple[FloatArray, FloatArray]:
    """Analysis and synthesis taps, (L, 2) low and high. Raises ValueError where they do not undo each other."""
    f = filters(wavelet)
    both = np.convolve(f.dec_lo, f.rec_lo) + np.convolve(f.dec_hi, f.rec_hi)
    both[len(f) - 1] -= 2.0
    if np.abs(both).max() > 1e-6:
        raise ValueError(f"{wavelet} gives a signal back only approximately: use it offline, and db3 or sym6 here")
    return np.column_stack([f.dec_lo, f.dec_hi]), np.column_stack([f.rec_lo, f.rec_hi])


def _factor(rule: StreamRule, level: int) -> float:
    universal = sqrt(2.0 * log(WINDOW))
    if rule == "universal":
        return universal
    if rule == "level_scaled":
        return universal / log(level + 1)
    raise ValueError(f"rule {rule!r} is not one for a stream: give universal or level_scaled")


def _filtered(seen: FloatArray, taps: FloatArray, *, step: int) -> FloatArray:
    """Each of the two of `seen` (2, reach + N, k) through its own taps, `step` rows apart; (2, N, k)."""
    reach = (len(taps) - 1) * step
    n = seen.shape[1] - reach
    out: FloatArray = taps[0][:, None, None] * seen[:, reach:]
    for i in range(1, len(taps)):
        start = reach - i * step
        out += taps[i][:, None, None] * seen[:, start : start + n]
    return out
