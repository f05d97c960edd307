"""Sample times: the FIFO has none, so sample count is fitted against the host's clock.

A line, host time over sample number, by least squares with old observations fading. Its slope is the
chip's sample period, which is off by up to 1 % on the PLL and 5 % without (PS 6.6), an error that would
go straight into every integrated angle. Where the chip's INT pin is wired to this machine, the pulses of samples, which
have their times, take the place of the counts.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import exp

from quavelet.core.units import NS_PER_S

FADE_S = 20.0
"""Time constant with which old observations fade. The oscillator drifts with temperature, in minutes, and a line that
lags behind it is late by the rate of the drift times the square of this: 1 ms at 2.5 ppm/s."""
EDGE_FADE_S = 2.0
"""The same for pulses. They need less averaging than counts, and a line that lags behind a drifting oscillator is late
by the rate of the drift times the square of this."""
EDGE_WORTH = 100.0
"""Counts that follow a pulse are worth so much less: they are late by up to a period, and it by some microseconds. Its
full worth would keep a line too long that is no longer the chip's."""
SURE_AFTER_S = 1.0
"""Observed time after which the fitted period is used instead of the nominal one."""
BOUND = 0.06
"""The largest error the chip's oscillator can have: 5 % untrimmed, 1 % of margin."""
SLOW_FACTOR = 3
"""A count that took this much longer to read than the fastest is not used: nobody knows when it was taken."""
SLOW_MARGIN_NS = 100_000
SURPRISE = 2.5
"""Samples: one is the count's own uncertainty at either end."""
FIT_PERIODS = 0.25
"""How far a pulse may be from where its sample is expected."""


@dataclass(frozen=True, slots=True)
class TimeBaseState:
    """All memory: weighted means and central moments of (sample number, host time since `t0_ns`), and the last pair.

    A count of n samples is the number n + 1/2: the next one is between 0 and 1 period away, half a period on average.
    edges   all observations are pulses, which are exact
    """

    t0_ns: int = 0
    observations: int = 0
    first_ns: int = 0
    last_ns: int = 0
    last_n: float = 0.0
    weight: float = 0.0
    mean_n: float = 0.0
    mean_t_ns: float = 0.0
    moment_nn: float = 0.0
    moment_nt: float = 0.0
    fastest_ns: int = 0
    period_ns: float = 0.0
    sure: bool = False
    edges: bool = False


class TimeBase:
    """Fits the host time of sample number n, to counts or to pulses."""

    def __init__(self, *, nominal_period_s: float) -> None:
        self.nominal_ns = nominal_period_s * NS_PER_S
        self._s = TimeBaseState(period_ns=self.nominal_ns)

    def state(self) -> TimeBaseState:
        return self._s

    def restore(self, state: TimeBaseState) -> None:
        self._s = state

    @property
    def period_s(self) -> float:
        """The sample period in s: measured once `sure`, nominal before."""
        return self._s.period_ns / NS_PER_S

    @property
    def sure(self) -> bool:
        """Whether the period is measured."""
        return self._s.sure

    @property
    def started(self) -> bool:
        """Whether there is any observation to time samples by."""
        return self._s.observations > 0

    def is_slow(self, before_ns: int, after_ns: int) -> bool:
        """Whether reading the count took so long that its moment is in doubt."""
        s = self._s
        return s.observations > 0 and after_ns - before_ns > SLOW_FACTOR * s.fastest_ns + SLOW_MARGIN_NS

    def observe(self, n: int, before_ns: int, after_ns: int) -> bool:
        """Between these host times the chip had taken `n` samples in all.

        Returns False where the fit lies outside what an oscillator can do; the period then stays.
        """
        s, at_ns, took_ns = self._s, (before_ns + after_ns) // 2, after_ns - before_ns
        self._s = replace(s, fastest_ns=min(s.fastest_ns, took_ns) if s.observations else took_ns)
        return self._fit(n + 0.5, at_ns, edge=False)

    def observe_edge(self, n: int, t_ns: int, *, anew: bool = False) -> bool:
        """The chip took sample number `n` at this host time. The first one drops all counts, and `anew` all pulses;
        the period is kept. Returns as `observe`."""
        if anew or not self._s.edges:
            self._s = replace(self._s, observations=0)
        return self._fit(float(n), t_ns, edge=True)

    def note_query(self, before_ns: int, after_ns: int) -> None:
        """A count was read between these host times, and is not needed."""
        self._s = replace(self._s, fastest_ns=min(self._s.fastest_ns, after_ns - before_ns))

    def fits(self, n: int, t_ns: int) -> bool:
        """Whether sample number `n` can have been taken at this host time, by the fit up to now."""
        s = self._s
        unknown = 0.0 if s.sure else BOUND * abs(t_ns - s.last_ns) / s.period_ns
        return abs(self.number_at(t_ns) - n) <= FIT_PERIODS + unknown

    def _fit(self, n: float, at_ns: int, *, edge: bool) -> bool:
        s = self._s
        if s.observations == 0:
            begun = TimeBaseState(t0_ns=at_ns, first_ns=at_ns, last_ns=at_ns)
            s = replace(begun, fastest_ns=s.fastest_ns, period_ns=s.period_ns, sure=s.sure)
        t = float(at_ns - s.t0_ns)
        keep = exp(-(at_ns - s.last_ns) / ((EDGE_FADE_S if edge else FADE_S) * NS_PER_S))
        if s.edges and not edge:
            keep *= EDGE_WORTH
        weight = keep * s.weight + 1.0
        dn, dt = n - s.mean_n, t - s.mean_t_ns
        mean_n, mean_t = s.mean_n + dn / weight, s.mean_t_ns + dt / weight
        moment_nn = keep * s.moment_nn + dn * (n - mean_n)
        moment_nt = keep * s.moment_nt + dn * (t - mean_t)
        period, sure, good = s.period_ns, s.sure, True
        if at_ns - s.first_ns >= SURE_AFTER_S * NS_PER_S and moment_nn > 0:
            fitted = moment_nt / moment_nn
            good = abs(fitted / self.nominal_ns - 1.0) <= BOUND
            if good:
                period, sure = fitted, True
        self._s = TimeBaseState(
            t0_ns=s.t0_ns,
            observations=s.observations + 1,
            first_ns=s.first_ns,
            last_ns=at_ns,
            last_n=n,
            weight=weight,
            mean_n=mean_n,
            mean_t_ns=mean_t,
            moment_nn=moment_nn,
            moment_nt=moment_nt,
            fastest_ns=s.fastest_ns,
            period_ns=period,
            sure=sure,
            edges=edge,
        )
        return good

    def time_ns(self, n: int) -> int:
        """Host time of the sample number `n`, counted from 1, by the present fit."""
        s = self._s
        anchor_n, anchor_t_ns = self._anchor()
        return s.t0_ns + round(anchor_t_ns + (n - anchor_n) * s.period_ns)

    def number_at(self, at_ns: int) -> float:
        """How many samples the chip had taken at this host time, by the present fit, and what part of the next."""
        s = self._s
        anchor_n, anchor_t_ns = self._anchor()
        return (at_ns - s.t0_ns - anchor_t_ns) / s.period_ns + anchor_n

    def surprising(self, n: int, before_ns: int, after_ns: int) -> bool:
        """Whether `n` samples in all, counted between these host times, are many more or fewer than the period makes
        of the time since the last observation: within it no oscillator wanders by a twentieth."""
        s = self._s
        due = ((before_ns + after_ns) // 2 - s.last_ns) / s.period_ns
        return s.sure and abs(n + 0.5 - s.last_n - due) > SURPRISE + due / 20

    def _anchor(self) -> tuple[float, float]:
        """A sample number, and the time since `t0_ns` at which it was counted on average."""
        s = self._s
        # By the nominal period a line through the mean would be wrong by 5 % of half the observed time.
        return (s.mean_n, s.mean_t_ns) if s.sure else (s.last_n, float(s.last_ns - s.t0_ns))
