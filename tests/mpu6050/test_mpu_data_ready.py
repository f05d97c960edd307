"""Samples timed by the pulses of the INT pin, and by counts where there are none; the truth is the fake chip's."""

from __future__ import annotations

import errno
import logging

import numpy as np
import pytest
from chip_rig import Rig, check_honest, config
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from hw_fakes import MPU6050, MPU6500, FakeDataReady
from hw_fakes.faults.plan import parse
from quavelet.bus.protocol import Edge
from quavelet.core.blocks import Flag, RawBlock, array_fields
from quavelet.core.errors import BusError
from quavelet.core.health import Health
from quavelet.core.units import NS_PER_MS
from quavelet.mpu6050.decoder import Decoder
from quavelet.mpu6050.drain import Drain
from quavelet.mpu6050.source import ChipSource

INT_PIN_CFG, INT_ENABLE = 0x37, 0x38
US = 1000.0


@pytest.fixture(autouse=True)
def quiet():
    logging.disable(logging.WARNING)
    yield
    logging.disable(logging.NOTSET)


def late_us(rig: Rig) -> np.ndarray:
    """How late the time of each sample is; of those before a reset of the chip this means nothing."""
    late: np.ndarray = (rig.got.t_ns - rig.samples.true_ns(check_honest(rig))) / US
    return late


def struck(fault: str, *, rate_hz: float = 200.0, before_s: float = 3.0, after_s: float = 4.0) -> tuple[Rig, int]:
    """A rig with a line, met by a fault; and how many samples it had by then."""
    rig = Rig(config(rate_hz), pll_error=0.01, wired=True).start()
    rig.run(before_s)
    n = len(rig.got)
    rig.fake_bus.adapter.faults.add(parse(fault))
    rig.run(after_s)
    return rig, n


def timed_by_pulses(rig: Rig) -> bool:
    assert rig.source.decoder is not None
    return rig.source.decoder.state().timebase.edges


@given(
    error=st.floats(-0.05, 0.05).filter(lambda error: abs(error) > 2e-3),
    rate_hz=st.sampled_from([4.0, 50.0, 200.0, 500.0, 1000.0]),
    every_ms=st.floats(2, 30),
    jitter=st.floats(0, 0.5),
    seed=st.integers(0, 2**32 - 1),
)
@settings(max_examples=20, deadline=None, suppress_health_check=[HealthCheck.too_slow])
def test_sample_is_timed_a_microsecond_off_though_it_had_a_pulse(error, rate_hz, every_ms, jitter, seed):
    rng = np.random.default_rng(seed)
    rig = Rig(config(rate_hz), pll_error=error, wired=True).start()
    begin_ns = deadline_ns = rig.clock.now_ns()
    while deadline_ns < begin_ns + 5_000 * NS_PER_MS:
        deadline_ns += int(every_ms * NS_PER_MS)
        rig.clock.sleep_until_ns(deadline_ns + int(rng.uniform(0, jitter) * every_ms * NS_PER_MS))
        rig.drain()
    settled = rig.got.t_ns > begin_ns + 3_000 * NS_PER_MS
    assert timed_by_pulses(rig)
    assert settled.sum() > 4
    assert np.abs(late_us(rig)[settled]).max() < 1
    assert (np.diff(rig.numbers) == 1).all()
    assert rig.health.data_ready_missed == 0


@pytest.mark.parametrize("rate_hz", [200.0, 1000.0])
def test_period_by_pulses_is_off_by_more_than_a_millionth(rate_hz):
    rig = Rig(config(rate_hz), pll_error=-0.0123, wired=True).start()
    rig.run(3.0)
    assert rig.got.period_s[-1] == pytest.approx(1 / rate_hz / (1 - 0.0123), rel=1e-6)


@pytest.mark.parametrize("rate_hz", [200.0, 1000.0])
def test_lost_interrupts_stop_the_stream_or_are_not_told_or_are_told_twice(rate_hz):
    rig, n = struck("int-lost for=1", rate_hz=rate_hz, before_s=4.0)
    assert rig.health.data_ready_missed == 1
    assert timed_by_pulses(rig)
    late = late_us(rig)
    assert np.abs(late[n:]).max() < 50, "the line that pulses gave holds for a second"
    assert np.abs(late[-int(2 * rate_hz) :]).max() < 1
    assert (np.diff(rig.numbers) == 1).all()


def test_lost_interrupts_leave_time_to_a_line_that_is_no_longer_the_chips():
    """Counts take over again: by 15 minutes without a pulse the times are as good as without a line."""
    rig = Rig(config(50.0), pll_error=0.0113, wired=True).start()
    rig.run(3.0)
    rig.fake_bus.adapter.faults.add(parse("int-lost"))
    rig.run(400.0, every_ms=90.0)
    assert not timed_by_pulses(rig)
    assert rig.health.data_ready_missed == 1
    assert np.abs(late_us(rig)[-500:]).mean() < 2000


def test_wire_that_was_never_there_is_not_told_or_times_are_not_those_of_counts():
    without, unwired = (Rig(pll_error=0.01, wired=wired) for wired in (False, True))
    unwired.chip.int_connected = False
    for rig in (without, unwired):
        rig.start().run(3.0)
    assert (without.health.data_ready_missed, unwired.health.data_ready_missed) == (0, 1)
    assert np.array_equal(without.got.t_ns, unwired.got.t_ns)


@pytest.mark.parametrize("fault", ["brown-out", "asleep", "unplugged for=0.3", "unplugged for=2"])
def test_chip_that_was_reset_is_timed_by_where_its_pulses_were_before(fault):
    rig, n = struck(fault)
    late = late_us(rig)
    assert rig.health.chip_restarts == 1
    assert timed_by_pulses(rig)
    assert np.abs(late[n + 2 :]).max() < 5000
    assert np.abs(late[-300:]).max() < 2
    assert rig.health.data_ready_missed == 0


@pytest.mark.parametrize("fault", ["overflow", "slip bytes=3", "eio n=3", "slow factor=4 for=0.2"])
def test_gap_in_which_the_chip_samples_on_costs_the_time_of_a_sample(fault):
    rig, n = struck(fault)
    assert np.abs(late_us(rig)[n:]).max() < 1
    missing = np.diff(rig.numbers) - 1
    assert rig.health.samples_lost == missing.sum()
    assert rig.health.data_ready_missed == 0


def test_whole_frame_that_vanished_from_the_fifo_shifts_all_times_after_it_and_is_no_gap():
    """No count can tell; the pulses do, some drains later."""
    rig, n = struck("slip bytes=14")
    late = (rig.got.t_ns - rig.samples.true_ns(rig.numbers)) / US
    assert (np.abs(late[n:]) > 1).sum() < 40
    assert np.abs(late[-400:]).max() < 1
    assert (rig.health.samples_lost, rig.health.gaps, rig.health.fifo_resets) == (1, 1, 0)


@pytest.mark.parametrize("stall_ms", [400.0, 1500.0, 8000.0])
def test_long_stall_costs_the_number_of_a_sample(stall_ms):
    """The kernel keeps a thousand edges; of more the numbers still tell how many there were."""
    rig = Rig(config(200.0), pll_error=0.01, wired=True).start()
    rig.run(3.0)
    rig.drain(stall_ms)
    rig.run(2.0)
    assert np.abs(late_us(rig)).max() < 5000
    assert np.abs(late_us(rig)[-300:]).max() < 1
    assert rig.health.samples_lost == (np.diff(rig.numbers) - 1).sum()


@pytest.mark.parametrize(
    ("register", "byte"), [(INT_PIN_CFG, 0x20), (INT_PIN_CFG, 0x80), (INT_ENABLE, 0x10), (INT_ENABLE, 0x00)]
)
def test_setting_of_the_pin_that_changed_by_itself_stays_so(register, byte):
    rig = Rig(pll_error=0.01, wired=True).start()
    rig.run(3.0)
    rig.wr(register, byte)
    rig.run(3.0)
    assert rig.health.registers_upset == 1
    assert timed_by_pulses(rig)
    assert np.abs(late_us(rig)[-200:]).max() < 1


@pytest.mark.parametrize("personality", [MPU6050, MPU6500])
def test_pin_is_set_up_where_no_line_is_or_otherwise_where_one_is(personality):
    for wired, enable in ((False, 0x10), (True, 0x11)):
        rig = Rig(personality=personality, wired=wired)
        rig.chip.registers[INT_PIN_CFG] = 0xE2
        rig.start()
        assert rig.chip.registers[INT_ENABLE] == enable
        assert rig.source.info is not None and rig.source.info.data_ready == wired


class Failing(FakeDataReady):
    """A line whose GPIO chip goes and comes."""

    gone = False

    def wait(self, timeout_s: float) -> list[Edge]:
        if self.gone:
            raise BusError("the line fake:int is gone with its GPIO chip: plug it in again", errno=errno.ENODEV)
        return super().wait(timeout_s)


def wired_to(line_type: type[FakeDataReady], **chip: float) -> Rig:
    rig = Rig(pll_error=0.01, **chip)
    rig.line = line_type(rig.chip, clock=rig.clock)
    rig.source = rig.new_source()
    return rig.start()


def test_line_that_fails_stops_the_stream_or_is_told_at_each_drain(caplog):
    logging.disable(logging.NOTSET)
    rig = wired_to(Failing)
    line = rig.line
    assert isinstance(line, Failing)
    for line.gone in (False, True, False):
        rig.run(3.0)
    assert rig.health.data_ready_missed == 1
    (record,) = caplog.records
    assert record.message.startswith("the line fake:int is gone")
    assert timed_by_pulses(rig)
    assert np.abs(late_us(rig)[600:]).max() < 100
    assert (np.diff(rig.numbers) == 1).all()


class Noisy(FakeDataReady):
    """A wire that picks up motors beside the pulses, or in their place."""

    def wait(self, timeout_s: float) -> list[Edge]:
        edges = super().wait(timeout_s)
        if not edges:
            return []
        rng = np.random.default_rng(edges[-1].seq)
        times = {edge.t_ns for edge in edges if self.pulses}
        times |= {int(edges[-1].t_ns - t) for t in rng.integers(0, 10 * NS_PER_MS, rng.poisson(self.a_drain))}
        self.count += len(times)
        return [Edge(t_ns, self.count - len(times) + k) for k, t_ns in enumerate(sorted(times), 1)]

    count = 0
    a_drain = 30.0
    pulses = False


def test_wire_that_carries_noise_alone_is_taken_for_one_that_carries_pulses():
    rig = wired_to(Noisy)
    rig.run(5.0)
    assert rig.health.data_ready_missed >= 1
    assert np.abs(late_us(rig)[200:]).max() < 5000
    assert (np.diff(rig.numbers) == 1).all()


def test_single_edges_of_noise_between_pulses_stop_them_from_being_used():
    rig = wired_to(Noisy)
    assert isinstance(rig.line, Noisy)
    rig.line.pulses, rig.line.a_drain = True, 0.01
    rig.run(10.0)
    late = np.abs(late_us(rig)[400:])
    assert (late < 1).mean() > 0.8
    assert late.max() < 3000


def recorded(seed: int) -> tuple[Rig, list[Drain]]:
    """Drains of a stream with stalls, a chip that is reset, and interrupts that stay away."""
    rig = Rig(pll_error=-0.011, wired=True)
    drains: list[Drain] = []
    rig.source = ChipSource(
        rig.bus, address=0x68, config=rig.config, clock=rig.clock, health=rig.health, line=rig.line,
        on_drain=drains.append,
    )  # fmt: skip
    rig.start()
    rng = np.random.default_rng(seed)
    plans = {60: "int-lost for=0.3", 150: "brown-out", 250: "overflow", 300: "int-lost for=0.2"}
    for k in range(400):
        if k in plans:
            rig.fake_bus.adapter.faults.add(parse(plans[k]))
        rig.drain(float(rng.choice([2.0, 10.0, 30.0, 500.0], p=[0.3, 0.5, 0.19, 0.01])) + (k % 3) * 0.1)
    rig.blocks = [block for block in rig.blocks if len(block)]
    return rig, drains


def same(a: RawBlock, b: RawBlock) -> bool:
    return all(np.array_equal(getattr(a, name), getattr(b, name), equal_nan=True) for name in array_fields(RawBlock))


@given(seed=st.integers(0, 20), cut=st.integers(0, 400))
@settings(max_examples=10, deadline=None)
def test_decoder_restored_at_any_point_times_otherwise_or_a_replay_does(seed, cut):
    rig, drains = recorded(seed)
    assert rig.source.info is not None and rig.source.decoder is not None
    assert rig.health.data_ready_missed >= 1
    health = Health()
    before, after = (Decoder(rig.source.info, health=health) for _ in range(2))
    blocks = [before.decode(drain) for drain in drains[:cut]]
    after.restore(before.state())
    blocks += [after.decode(drain) for drain in drains[cut:]]
    for live, again in zip(rig.blocks, (block for block in blocks if len(block)), strict=True):
        assert same(live, again)
    one, other = after.state(), rig.source.decoder.state()
    assert (one.pulses, one.timebase) == (other.pulses, other.timebase)
    assert health.data_ready_missed == rig.health.data_ready_missed


def test_drains_lost_from_a_recording_cost_the_times_after_them():
    rig, drains = Rig(pll_error=0.01, wired=True), list[Drain]()
    rig.source = rig.new_source()
    rig.source._on_drain = drains.append
    rig.start().run(6.0)
    assert rig.source.info is not None
    decoder = Decoder(rig.source.info, health=Health())
    rig.blocks = [decoder.decode(drain) for k, drain in enumerate(drains) if not 300 <= k < 340]
    assert np.abs(late_us(rig)[400:]).max() < 1
    assert (rig.got.flags & Flag.GAP != 0).sum() == 1
