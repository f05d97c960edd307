"""Is the board still? Statistics of the run of samples since it last moved, one sample at a time."""

from __future__ import annotations

from dataclasses import dataclass

from quavelet.core.units import RAD_PER_DEG, STANDARD_GRAVITY_M_S2

Six = tuple[float, float, float, float, float, float]
"""Rate x y z in rad/s, then specific force x y z in m/s^2."""

_ZERO: Six = (0.0,) * 6


@dataclass(frozen=True, slots=True, kw_only=True)
class StillnessLimits:
    """Above these the board is called moving.

    Real chips lying still show 0.13 deg/s and 5 mg rms a sample, a hand holding one several deg/s.
    gyro_sd_rad_s, accel_sd_m_s2   spread of each axis over the run; six times this for a single sample
    gyro_mean_rad_s                mean rate of each axis: the data sheet's zero-rate limit of 20 deg/s and a margin;
                                   a steady turn below it about the vertical cannot be told from a bias
    gyro_drift_rad_s, accel_drift_m_s2   difference of the means of the run's two halves
    """

    gyro_sd_rad_s: float = 0.5 * RAD_PER_DEG
    accel_sd_m_s2: float = 0.020 * STANDARD_GRAVITY_M_S2
    gyro_mean_rad_s: float = 25.0 * RAD_PER_DEG
    gyro_drift_rad_s: float = 0.15 * RAD_PER_DEG
    accel_drift_m_s2: float = 0.004 * STANDARD_GRAVITY_M_S2


@dataclass(frozen=True, slots=True)
class StillRun:
    """Samples since the board last moved: sums of the deviations from the run's first sample.

    n, elapsed_s    samples, and the time they span
    first           the first sample
    total, squares  sums of deviations and of their squares
    half_n, half    samples and sums of deviations in the run's first half (of the time asked for)
    """

    n: int = 0
    elapsed_s: float = 0.0
    first: Six = _ZERO
    total: Six = _ZERO
    squares: Six = _ZERO
    half_n: int = 0
    half: Six = _ZERO

    def mean(self) -> Six:
        """Mean of each channel; the run must hold a sample."""
        a, b, c, d, e, f = (first + total / self.n for first, total in zip(self.first, self.total, strict=True))
        return a, b, c, d, e, f


_FEW = 8
"""Samples below which a spread says nothing."""


def started(sample: Six) -> StillRun:
    """A run of one sample."""
    return StillRun(n=1, first=sample, half_n=1)


def extended(run: StillRun, sample: Six, dt_s: float, *, half_s: float, limits: StillnessLimits) -> StillRun | None:
    """The run with `sample` added, or None where the sample shows that the board moves."""
    if run.n == 0:
        return started(sample)
    n = run.n + 1
    d = tuple(x - x0 for x, x0 in zip(sample, run.first, strict=True))
    total = tuple(s + x for s, x in zip(run.total, d, strict=True))
    squares = tuple(s + x * x for s, x in zip(run.squares, d, strict=True))
    gyro_sd, accel_sd = limits.gyro_sd_rad_s, limits.accel_sd_m_s2
    for i in range(6):
        sd = gyro_sd if i < 3 else accel_sd
        mean = total[i] / n
        if abs(d[i] - mean) > 6.0 * sd:
            return None
        if n >= _FEW and squares[i] / n - mean * mean > sd * sd:
            return None
    elapsed_s = run.elapsed_s + dt_s
    in_half = elapsed_s <= half_s
    return StillRun(
        n=n,
        elapsed_s=elapsed_s,
        first=run.first,
        total=_six(total),
        squares=_six(squares),
        half_n=n if in_half else run.half_n,
        half=_six(total) if in_half else run.half,
    )


def is_steady(run: StillRun, *, limits: StillnessLimits) -> bool:
    """Whether a finished run shows no drift between its halves and no rate beyond what a bias can be."""
    rest_n = run.n - run.half_n
    if rest_n < 1:
        return False
    for i in range(6):
        drift = abs((run.total[i] - run.half[i]) / rest_n - run.half[i] / run.half_n)
        if drift > (limits.gyro_drift_rad_s if i < 3 else limits.accel_drift_m_s2):
            return False
    return max(map(abs, run.mean()[:3])) <= limits.gyro_mean_rad_s


def _six(values: tuple[float, ...]) -> Six:
    a, b, c, d, e, f = values
    return a, b, c, d, e, f
