"""Sample times, numbers and memory of the decoder, fed by the source from a chip whose every sample is known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from chip_rig import Rig, Transfer, check_honest, config
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from quavelet.core.blocks import Flag, RawBlock, array_fields
from quavelet.core.health import Health
from quavelet.core.units import NS_PER_MS, NS_PER_S
from quavelet.mpu6050.decoder import Decoder, DecoderState
from quavelet.mpu6050.drain import Drain
from quavelet.mpu6050.source import ChipSource


def errors_in_periods(rig: Rig) -> np.ndarray:
    """How late the time of each sample is, in sample periods."""
    numbers = check_honest(rig)
    assert rig.samples.run is not None
    late: np.ndarray = (rig.got.t_ns - rig.samples.true_ns(numbers)) / rig.samples.run.period_ns
    return late


@given(
    error=st.floats(-0.05, 0.05),
    rate_hz=st.sampled_from([50.0, 100.0, 200.0, 500.0, 1000.0]),
    every_ms=st.floats(2, 30),
    jitter=st.floats(0, 0.5),
    seed=st.integers(0, 2**32 - 1),
)
@settings(max_examples=40, deadline=None, suppress_health_check=[HealthCheck.too_slow])
def test_every_sample_is_timed_within_one_period_of_the_truth(error, rate_hz, every_ms, jitter, seed):
    rng = np.random.default_rng(seed)
    rig = Rig(config(rate_hz), pll_error=error).start()
    deadline_ns = rig.clock.now_ns()
    for _ in range(int(6000 / every_ms)):
        deadline_ns += int(every_ms * NS_PER_MS)
        rig.clock.sleep_until_ns(deadline_ns + int(rng.uniform(0, jitter) * every_ms * NS_PER_MS))
        rig.drain()
    late = errors_in_periods(rig)
    # The transfer of the count is not at one instant. Before the period is known, a drain's first sample is reckoned
    # from its last by the nominal one.
    longest_ms = every_ms * (1 + jitter) + 2
    unknown = np.where(rig.got.flags & Flag.CLOCK_UNSURE, 1.5 * abs(error) * longest_ms * rate_hz / 1000, 0.0)
    assert (np.abs(late) <= 1 + 0.2 * rate_hz / 1000 + unknown).all()
    assert (np.diff(check_honest(rig)) == 1).all()


@pytest.mark.parametrize(("rate_hz", "every_ms"), [(50.0, 2.0), (50.0, 7.1), (100.0, 3.3), (200.0, 7.1), (200.0, 23.7)])
def test_times_are_right_on_average_however_often_the_fifo_is_looked_at(rate_hz, every_ms):
    """Drains that find nothing count too: without them a stream drained often was timed up to half a period early."""
    rig = Rig(config(rate_hz), pll_error=0.0113).start()
    rig.run(12.0, every_ms=every_ms)
    assert abs(errors_in_periods(rig)[len(rig.got) // 2 :].mean()) < 0.12


@pytest.mark.parametrize("error", [-0.03, 0.0, 0.01, 0.05])
def test_period_is_the_chips_own_once_measured_and_the_nominal_one_before(error):
    rig = Rig(pll_error=error).start()
    assert rig.source.decoder is not None
    rig.run(0.9)
    assert rig.source.decoder.measured_rate_hz is None
    assert (rig.got.period_s == 0.005).all()
    rig.run(30.0)
    assert rig.source.decoder.measured_rate_hz == pytest.approx(200 * (1 + error), rel=1e-3)
    assert rig.got.period_s[-1] == pytest.approx(0.005 / (1 + error), rel=1e-3)


def late_count(rig: Rig, ms: float, *, chip_first: bool = True) -> None:
    """The next count takes `ms` longer, after the chip has told it or before, as when the kernel is busy elsewhere."""
    mark = len(rig.bus.trace)

    def late(k: int, transfer: Transfer) -> None:
        if k >= mark and transfer.register == 0x72:
            rig.wait_ms(ms)
            rig.bus.spoil, rig.bus.alter = (lambda _k, _transfer: False), (lambda _k, _transfer, answer: answer)

    def before(k: int, transfer: Transfer) -> bool:
        late(k, transfer)
        return False

    def after(k: int, transfer: Transfer, answer: bytes) -> bytes:
        late(k, transfer)
        return answer

    if chip_first:
        rig.bus.alter = after
    else:
        rig.bus.spoil = before


def test_count_that_came_late_is_not_used_for_time_and_is_counted():
    steady, disturbed = Rig().start(), Rig().start()
    for rig in (steady, disturbed):
        rig.run(5.0)
        for _ in range(20):
            if rig is disturbed:
                late_count(rig, 40)
            rig.drain(50)
            rig.run(0.5)
    assert disturbed.health.slow_queries == 20
    assert steady.health.slow_queries == 0
    assert (np.diff(check_honest(disturbed)) == 1).all()
    assert np.abs(errors_in_periods(disturbed)).max() < 1
    assert disturbed.got.period_s[-1] == pytest.approx(steady.got.period_s[-1], rel=1e-4)


@pytest.mark.parametrize("chip_first", [True, False])
@pytest.mark.parametrize("ms", [15, 40, 150])
def test_late_count_just_after_a_gap_does_not_shift_all_times_that_follow(ms, chip_first):
    """Whoever was busy enough to let the FIFO overflow is busy a moment later, too."""
    rig = Rig(config(50.0)).start()
    rig.run(5.0)
    rig.drain(2000)
    late_count(rig, ms, chip_first=chip_first)
    rig.drain(20)
    while not len(rig.drain(2)):  # and looks again very soon, and finds nothing new
        pass
    rig.run(2.0)
    late = errors_in_periods(rig)
    assert rig.health.slow_queries == 1
    assert np.abs(late[-80:]).max() < 0.2
    assert np.abs(late).max() < 1 + ms / 20


def test_rate_no_oscillator_has_is_counted_and_not_used():
    rig = Rig(pll_error=0.09).start()
    rig.run(5.0)
    assert rig.source.decoder is not None and rig.source.decoder.measured_rate_hz is None
    assert rig.health.rate_out_of_bounds > 300
    assert (rig.got.period_s == 0.005).all()
    check_honest(rig)


@pytest.mark.parametrize("seed", [7, 8])
@pytest.mark.parametrize("error", [-0.02, 0.003, 0.0101])
@pytest.mark.parametrize("rate_hz", [200.0, 1000.0])
def test_numbers_and_times_do_not_slip_over_a_hundred_resets_of_the_fifo(rate_hz, error, seed):
    rig = Rig(config(rate_hz), pll_error=error).start()
    rng = np.random.default_rng(seed)
    rig.run(30.0)
    lost = []
    for _ in range(100):
        rig.wr(0x74, 0xAA)
        rig.run(float(rng.uniform(0.05, 0.5)))
        lost.append(rig.health.samples_lost)
    assert rig.health.gaps == 100
    assert np.abs(errors_in_periods(rig)).max() < 1.2
    assert rig.got.period_s[-1] == pytest.approx(1 / rate_hz / (1 + error), rel=1e-4)
    numbers = check_honest(rig)
    truly_lost = np.cumsum((np.diff(numbers) - 1)[np.diff(numbers) > 1])
    assert np.abs(np.array(lost) - truly_lost).max() <= 1


def recorded(seed: int) -> tuple[Rig, list[Drain]]:
    """Drains of a stream with overflows, failures and late counts."""
    rig = Rig(pll_error=-0.011)
    drains: list[Drain] = []
    rig.source = ChipSource(
        rig.bus, address=0x68, config=rig.config, clock=rig.clock, health=rig.health, on_drain=drains.append
    )
    rig.start()
    rng = np.random.default_rng(seed)
    for k in range(400):
        if rng.random() < 0.02:
            late_count(rig, 5)
        mark, unlucky = len(rig.bus.trace), rng.random() < 0.02
        rig.bus.spoil = lambda at, _t, mark=mark, unlucky=unlucky: unlucky and at == mark + 1
        rig.drain(float(rng.choice([2.0, 10.0, 30.0, 500.0], p=[0.3, 0.5, 0.19, 0.01])) + (k % 3) * 0.1)
    return rig, drains


def same(a: RawBlock, b: RawBlock) -> bool:
    return all(np.array_equal(getattr(a, name), getattr(b, name), equal_nan=True) for name in array_fields(RawBlock))


def without_held(state: DecoderState) -> DecoderState:
    return replace(state, spikes=replace(state.spikes, held=None))


@given(seed=st.integers(0, 50), cut=st.integers(0, 400))
@settings(max_examples=25, deadline=None)
def test_decoder_restored_at_any_point_goes_on_bit_for_bit(seed, cut):
    rig, drains = recorded(seed)
    assert rig.source.info is not None
    before, after = (Decoder(rig.source.info, health=Health()) for _ in range(2))
    for drain, live in zip(drains[:cut], rig.blocks, strict=False):
        assert same(before.decode(drain), live)
    after.restore(before.state())
    for drain, live in zip(drains[cut:], rig.blocks[cut:], strict=True):
        assert same(after.decode(drain), live)
    assert rig.source.decoder is not None
    one, other = after.state(), rig.source.decoder.state()
    held, also_held = one.spikes.held, other.spikes.held  # arrays, which do not compare as a whole
    assert held is also_held is None or (held and also_held and same(held, also_held))
    assert without_held(one) == without_held(other)


def test_drains_that_got_lost_from_a_recording_are_a_gap():
    rig, drains = recorded(3)
    assert rig.source.info is not None
    decoder = Decoder(rig.source.info, health=Health())
    blocks = [decoder.decode(drain) for k, drain in enumerate(drains) if not 300 <= k < 310]
    rig.blocks = blocks
    check_honest(rig)


def test_first_sample_after_a_gap_before_anything_was_timed_is_flagged():
    rig = Rig().start()
    rig.wait_ms(2000)
    assert len(rig.drain()) == 0
    rig.run(0.2)
    assert rig.got.flags[0] & 1
    assert (rig.got.gap_ns == 0).all()
    assert rig.got.t_ns[0] > 5 * NS_PER_S
