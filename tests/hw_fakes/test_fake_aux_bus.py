"""The auxiliary bus: its time and its wires, the bypass, and magnetometers on it."""

from __future__ import annotations

import numpy as np
import pytest
from aux_bench import CHIP, EN, NOBODY, OTHER, READ, SLV4_CTRL, Bench, Silent

from hw_fakes.chip.aux_master import SettableClock
from hw_fakes.magnetometers.akm import Ak8963
from hw_fakes.magnetometers.base import MagnetometerImperfections
from hw_fakes.magnetometers.hmc5883l import Hmc5883l
from hw_fakes.target import Nack
from hw_fakes.world.motion import Turntable
from quavelet.core.clock import VirtualClock


@pytest.mark.parametrize(("clk", "khz"), [(0, 348), (8, 258), (9, 500), (10, 471), (12, 421), (13, 400), (15, 364)])
def test_wire_time_goes_by_the_clock_that_is_set(clk, khz):
    bench = Bench()
    bench.wr(0x24, clk)
    bench.slave(0, READ | CHIP, 0, EN | 6)
    bench.sample()
    # START, address, register, repeated START, address, six bytes, STOP.
    assert bench.master.busy_ns == pytest.approx((3 + 9 * 9) * 1e6 / khz, rel=0.002)
    before = bench.master.busy_ns
    bench.wr(0x25, READ | NOBODY)
    bench.sample()
    assert bench.master.busy_ns - before == pytest.approx(11 * 1e6 / khz, rel=0.002)
    before = bench.master.busy_ns
    bench.wr(0x25, CHIP)
    bench.sample()
    assert bench.master.busy_ns - before == pytest.approx((2 + 27) * 1e6 / khz, rel=0.002)


def test_data_ready_waits_for_external_data_only_where_it_is_asked_to():
    bench = Bench()
    bench.slave(0, READ | CHIP, 3, EN | 7)
    bench.slave(1, READ | NOBODY, 3, EN | 7)
    bench.wr(0x67, 0x01)
    bench.wr(SLV4_CTRL, 1)
    assert bench.master.delay_ns(bench.registers) == 0
    bench.wr(0x24, 0x4D)
    delay_ns = bench.master.delay_ns(bench.registers)
    bench.sample()
    assert delay_ns == pytest.approx(bench.master.busy_ns, abs=2)
    assert delay_ns == pytest.approx((3 + 9 * 10 + 11) * 2500, abs=2)
    assert bench.master.delay_ns(bench.registers, 1) == 11 * 2500
    bench.wr(0x6A, 0x00)
    assert bench.master.delay_ns(bench.registers) == 0


def test_bypass_needs_its_bit_and_the_master_off():
    bench = Bench()
    seen = {}
    for user_ctrl in (0x00, 0x20):
        for pin_cfg in (0x00, 0x02):
            bench.wr(0x6A, user_ctrl)
            bench.wr(0x37, pin_cfg)
            seen[user_ctrl, pin_cfg] = bench.master.bypass(bench.registers)
    assert [setting for setting, is_open in seen.items() if is_open] == [(0x00, 0x02)]


def test_chip_behind_the_bypass_is_silent_while_that_is_closed():
    bench = Bench()
    bench.wr(0x6A, 0x00)
    bench.master.behind(bench.registers)
    door = bench.master.outside()[CHIP]
    with pytest.raises(Nack):
        door.write(b"\x10")
    with pytest.raises(Nack):
        door.read(1)
    bench.wr(0x37, 0x02)
    door.write(b"\x10")
    assert door.read(1) == b"\x10"
    door.stop()


def test_slave_sees_the_instant_of_the_sample_not_that_of_the_look():
    seen = []
    bench = Bench({})

    class Watch(Silent):
        def write(self, _data):
            seen.append(bench.clock.now_ns())

        def read(self, n):
            return bytes(n)

    bench.master.targets[CHIP] = Watch()
    bench.slave(0, READ | CHIP, 0, EN | 1)
    bench.outer.advance_ns(10_000)
    for t_ns in (1000, 2000, 3000):
        bench.sample(t_ns)
    assert seen == [1000, 2000, 3000]
    assert bench.clock.now_ns() == 10_000


def test_time_of_the_chips_never_goes_back():
    clock = SettableClock(VirtualClock())
    clock.outer.advance_ns(5000)
    assert clock.now_ns() == 5000
    with clock.at(3000):
        assert clock.now_ns() == 5000
    with clock.at(7000):
        assert clock.now_ns() == 7000
    assert clock.now_ns() == 7000
    clock.sleep_until_ns(9000)
    assert clock.now_ns() == 9000


# With magnetometers


def hmc_bench(*, config_a=0x18):
    clock = SettableClock(VirtualClock())
    noisy = MagnetometerImperfections(noise_ut=0.5, seed=4)
    chip = Hmc5883l(clock, Turntable(start_s=0), imperfections=noisy)
    bench = Bench({OTHER: chip}, clock=clock)
    bench.outer.advance_ns(60_000_000)
    chip.write(bytes([0x00, config_a, 0x20, 0x00]))
    chip.stop()
    return bench, chip


def test_measurements_are_the_same_through_the_master_and_through_the_bypass():
    period_ns = 5_000_000

    def through_the_bypass():
        bench, chip = hmc_bench()
        data = []
        for _ in range(400):
            bench.outer.advance_ns(period_ns)
            chip.write(b"\x03")
            data.append(chip.read(6))
            chip.stop()
        return data

    def through_the_master(samples_a_look):
        bench, _ = hmc_bench()
        bench.slave(0, READ | OTHER, 0x03, EN | 6)
        data, t_ns = [], bench.outer.now_ns()
        for _ in range(400 // samples_a_look):
            bench.outer.advance_ns(samples_a_look * period_ns)
            for _ in range(samples_a_look):
                t_ns += period_ns
                bench.sample(t_ns)
                data.append(bench.ext(6))
        return data

    reference = through_the_bypass()
    assert len(set(reference)) > 100
    assert through_the_master(1) == through_the_master(40) == reference


def test_ak8963_at_100_hz_through_the_master_is_new_every_tenth_sample_and_freezes_without_status_2():
    def distinct(length):
        clock = SettableClock(VirtualClock())
        bench = Bench({CHIP: Ak8963(clock, Turntable(start_s=0, rate_deg_s=200, ramp_s=0.1))}, clock=clock)
        bench.slave_4(CHIP, 0x0A, output=0x16)
        bench.sample()
        bench.slave(0, READ | CHIP, 0x03, EN | length)
        seen = set()
        for _ in range(1000):
            bench.outer.advance_ns(1_000_000)
            bench.sample()
            seen.add(bench.ext(6))
        return len(seen)

    assert distinct(7) == pytest.approx(100, abs=3)
    assert distinct(6) <= 2


def test_little_endian_words_of_the_ak8963_come_big_endian_with_swapping_at_odd_registers():
    def words(control, order):
        clock = SettableClock(VirtualClock())
        bench = Bench({CHIP: Ak8963(clock, Turntable())}, clock=clock)
        bench.slave(0, CHIP, 0x0A, EN | 1, output=0x16)
        bench.sample()
        bench.outer.advance_ns(9_000_000)
        bench.slave(0, READ | CHIP, 0x03, EN | control | 7)
        bench.sample()
        return np.frombuffer(bench.ext(6), dtype=order).astype(int).tolist()

    assert words(0x00, "<i2") == words(0x50, ">i2")
    assert any(words(0x00, "<i2"))
