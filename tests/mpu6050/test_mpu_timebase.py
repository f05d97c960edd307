"""The time base by itself: it is told counts of a simulated chip, and the truth is known."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from quavelet.core.units import NS_PER_MS, NS_PER_S
from quavelet.mpu6050.timebase import TimeBase

BUS_NS = 120_000  # two bytes of FIFO_COUNT at 400 kHz


@dataclass(frozen=True)
class Chip:
    """Sample n = 1, 2, ... is taken at first_ns + n periods; no oscillator is exact."""

    nominal_hz: float
    error: float
    first_ns: float

    @property
    def period_ns(self) -> float:
        return NS_PER_S / (self.nominal_hz * (1 + self.error))

    def count_at(self, t_ns: float) -> int:
        return int((t_ns - self.first_ns) / self.period_ns)

    def true_ns(self, n: int) -> float:
        return self.first_ns + n * self.period_ns

    def base(self) -> TimeBase:
        return TimeBase(nominal_period_s=1 / self.nominal_hz)


CHIPS = st.builds(
    Chip,
    nominal_hz=st.sampled_from([50.0, 100.0, 125.0, 200.0, 250.0, 500.0, 1000.0]),
    error=st.floats(-0.05, 0.05),
    first_ns=st.floats(0, 5e9),
)


def observe(chip: Chip, base: TimeBase, *, seconds: float, every_ms: float, seed: int, jitter_ms: float, check=None):
    """Counts at fixed deadlines, each late by up to `jitter_ms`, read somewhere within the transfer."""
    rng = np.random.default_rng(seed)
    begin_ns = int(chip.first_ns + chip.period_ns) + 1
    last_n = 0
    for k in range(int(seconds * 1e3 / every_ms)):
        before_ns = begin_ns + int(k * every_ms * NS_PER_MS + rng.uniform(0, jitter_ms) * NS_PER_MS)
        n = chip.count_at(before_ns + rng.uniform(0, BUS_NS))
        base.observe(n, before_ns, before_ns + BUS_NS)
        if check and n > last_n:
            check(last_n + 1, n, before_ns + BUS_NS)
        last_n = n


@given(
    chip=CHIPS,
    every_ms=st.floats(2, 50),
    jitter=st.floats(0.05, 0.5),
    seed=st.integers(0, 2**32 - 1),
)
@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.too_slow])
def test_period_is_within_3_in_1000_after_5_s_and_1_in_1000_after_30_s(chip, every_ms, jitter, seed):
    for seconds, bound in ((5, 3e-3), (30, 1e-3)):
        base = chip.base()
        observe(chip, base, seconds=seconds, every_ms=every_ms, seed=seed, jitter_ms=jitter * every_ms)
        assert base.sure
        assert base.period_s * NS_PER_S == pytest.approx(chip.period_ns, rel=bound)


@given(
    chip=CHIPS,
    every_ms=st.floats(2, 50),
    jitter=st.floats(0.0, 0.5),
    seed=st.integers(0, 2**32 - 1),
)
@settings(max_examples=40, deadline=None, suppress_health_check=[HealthCheck.too_slow])
def test_sample_times_are_within_one_period_of_the_truth_from_the_first_sample_on(chip, every_ms, jitter, seed):
    """Times by the nominal period around the mean of all counts ran 25 ms ahead in the first second."""
    base = chip.base()

    def check(first: int, last: int, _now_ns: int) -> None:
        for n in (first, last):
            # Before the period is known, a drain's first sample is reckoned from its last by the nominal one.
            unknown = 0.0 if base.sure else abs(chip.error) * (last - n)
            assert abs(base.time_ns(n) - chip.true_ns(n)) <= chip.period_ns * (1 + unknown) + BUS_NS

    observe(chip, base, seconds=8, every_ms=every_ms, seed=seed, jitter_ms=jitter * every_ms, check=check)


def test_number_of_samples_by_a_time_is_that_of_the_chip_within_one():
    chip = Chip(nominal_hz=200, error=-0.013, first_ns=1e9)
    base = chip.base()
    observe(chip, base, seconds=20, every_ms=7.3, seed=4, jitter_ms=1)
    for later_ms in np.arange(1.0, 3000.0, 3.7):
        at_ns = int(chip.first_ns + 20e9 + later_ms * NS_PER_MS)
        assert abs(base.number_at(at_ns) - chip.count_at(at_ns)) <= 1


def test_period_follows_an_oscillator_that_warms_up():
    """1 in 1000 over ten minutes; a fit that never forgets would be 0.5 in 1000 behind."""
    base = TimeBase(nominal_period_s=1 / 200)
    t_ns, n = 0.0, 0
    while t_ns < 600e9:
        period_ns = 5e6 * (1 - 1e-3 * t_ns / 600e9)
        n += 4
        t_ns += 4 * period_ns
        base.observe(n, round(t_ns + 0.5 * period_ns), round(t_ns + 0.5 * period_ns))
    assert base.period_s == pytest.approx(5e-3 * (1 - 1e-3), rel=2.5e-4)


def test_times_by_pulses_lag_behind_an_oscillator_that_warms_up():
    """By 80 ppm/K and a kelvin in half a minute; fading in a minute, as counts do, they would be 9 ms late."""
    base = TimeBase(nominal_period_s=1 / 200)
    t_ns, late_us = 0.0, []
    for n in range(1, 200 * 120):
        t_ns += 5e6 * (1 - 2.7e-6 * t_ns / NS_PER_S)
        if n % 2 == 0:
            base.observe_edge(n, round(t_ns))
            late_us.append((base.time_ns(n) - t_ns) / 1e3)
    assert np.abs(late_us).max() < 15


@given(chip=CHIPS, every=st.integers(1, 30), seed=st.integers(0, 1000))
@settings(max_examples=30, deadline=None)
def test_pulses_that_come_late_by_microseconds_time_samples_worse_than_that(chip, every, seed):
    base, rng = chip.base(), np.random.default_rng(seed)
    for n in range(1, int(10 * chip.nominal_hz), every):
        base.observe_edge(n, round(chip.true_ns(n) + rng.uniform(0, 20_000)))
    assert base.sure
    assert abs(base.time_ns(n) - chip.true_ns(n) - 10_000) < 20_000
    assert base.period_s * NS_PER_S == pytest.approx(chip.period_ns, rel=1e-5)


def test_first_pulse_drops_the_counts_and_keeps_the_period():
    chip = Chip(nominal_hz=200, error=0.02, first_ns=0)
    base = chip.base()
    observe(chip, base, seconds=5, every_ms=7.1, seed=1, jitter_ms=1)
    period_s = base.period_s
    base.observe_edge(1200, round(chip.true_ns(1200)))
    assert base.sure and base.period_s == period_s
    assert base.time_ns(1200) == round(chip.true_ns(1200))
    assert base.fits(1210, round(chip.true_ns(1210)))
    assert not base.fits(1211, round(chip.true_ns(1210)))
    assert base.is_slow(0, 5 * BUS_NS) and not base.is_slow(0, BUS_NS)


def test_count_after_pulses_moves_their_line_by_a_count_s_doubt():
    chip = Chip(nominal_hz=200, error=0.02, first_ns=0)
    base = chip.base()
    observe(chip, base, seconds=1, every_ms=7.1, seed=1, jitter_ms=1)
    for n in range(300, 1500, 2):
        base.observe_edge(n, round(chip.true_ns(n)))
    at_ns = round(chip.true_ns(1600) + 0.9 * chip.period_ns)
    base.observe(1600, at_ns - BUS_NS // 2, at_ns + BUS_NS // 2)
    assert abs(base.time_ns(1601) - chip.true_ns(1601)) < 2_000


def test_count_that_took_long_to_read_is_slow_and_others_are_not():
    base = TimeBase(nominal_period_s=1 / 200)
    assert not base.is_slow(0, 10 * NS_PER_MS)  # the first has nothing to be compared with
    base.observe(1, 0, BUS_NS)
    assert not base.is_slow(0, 2 * BUS_NS)
    assert base.is_slow(0, 5 * BUS_NS)
    # It is the fastest that counts: what grows slow by and by is slow all the same.
    for n in range(2, 20):
        took_ns = int(BUS_NS * 1.2**n)
        if not base.is_slow(n * 5 * NS_PER_MS, n * 5 * NS_PER_MS + took_ns):
            base.observe(n, n * 5 * NS_PER_MS, n * 5 * NS_PER_MS + took_ns)
    assert base.is_slow(0, 5 * BUS_NS)


@pytest.mark.parametrize("error", [-0.08, 0.08, 0.5, -0.3])
def test_rate_no_oscillator_can_have_is_not_used(error):
    chip = Chip(nominal_hz=200, error=error, first_ns=0)
    base = chip.base()
    good = [base.observe(chip.count_at(t), t, t + BUS_NS) for t in range(10 * NS_PER_MS, 5 * NS_PER_S, 10 * NS_PER_MS)]
    assert base.period_s == 1 / 200
    assert not base.sure
    assert good.count(False) > 300


@given(chip=CHIPS, cut=st.integers(0, 300), seed=st.integers(0, 1000))
@settings(max_examples=30, deadline=None)
def test_restored_time_base_goes_on_bit_for_bit(chip, cut, seed):
    whole, other = chip.base(), chip.base()
    rng = np.random.default_rng(seed)
    for k in range(400):
        t_ns = int(chip.first_ns + 1e7 + k * 1e7 + rng.uniform(0, 1e6))
        if k == cut:
            other.restore(whole.state())
        whole.observe(chip.count_at(t_ns), t_ns, t_ns + BUS_NS)
        if k >= cut:
            other.observe(chip.count_at(t_ns), t_ns, t_ns + BUS_NS)
    assert other.state() == whole.state()
    assert [other.time_ns(n) for n in (1, 77, 10_000)] == [whole.time_ns(n) for n in (1, 77, 10_000)]
