"""What all magnetometers do: data at their own instants, iron, noise, and the way they are mounted."""

from __future__ import annotations

import numpy as np
import pytest
from magnetometer_bench import Bench, body_field_ut

from hw_fakes.magnetometers.akm import Ak8963, Ak8975
from hw_fakes.magnetometers.base import MagnetometerImperfections
from hw_fakes.magnetometers.hmc5883l import Hmc5883l
from hw_fakes.magnetometers.qmc5883l import Qmc5883l
from hw_fakes.world.motion import Turntable

CHIPS = {"hmc5883l": Hmc5883l, "qmc5883l": Qmc5883l, "ak8963": Ak8963, "ak8975": Ak8975}
START = {
    Hmc5883l: (0x02, 0x00, 0x03),
    Qmc5883l: (0x09, 0x0D, 0x00),
    Ak8963: (0x0A, 0x16, 0x03),
    Ak8975: (0x0A, 0x01, 0x03),
}


@pytest.mark.parametrize("chip", list(CHIPS.values()), ids=list(CHIPS))
def test_data_do_not_depend_on_how_often_one_looks(chip):
    def read(looks):
        iron = MagnetometerImperfections(noise_ut=1.0, seed=7)
        bench = Bench(chip, motion=Turntable(start_s=0), imperfections=iron)
        control, value, data = START[chip]
        bench.wr(control, value)
        for _ in range(looks):
            bench.wait_ms(1000 / looks)
            bench.byte(0x02 if chip in (Ak8963, Ak8975) else 0x0C)
        return bench.rd(data, 6), bench.chip.measurements

    assert read(1) == read(8) == read(1000)


@pytest.mark.parametrize(("chip", "status"), [(Hmc5883l, 0x09), (Qmc5883l, 0x06), (Ak8963, 0x02)])
def test_transaction_shows_what_was_there_when_it_began(chip, status):
    bench = Bench(chip)
    control, value, _ = START[chip]
    bench.wr(control, value)
    bench.chip.write(bytes([status]))
    bench.wait_ms(100)
    assert bench.chip.read(1) == b"\x00"
    bench.chip.stop()
    assert bench.byte(status) & 1


@pytest.mark.parametrize("chip", list(CHIPS.values()), ids=list(CHIPS))
def test_iron_and_mounting_are_seen_where_they_are_given(chip):
    mounting = ((0.0, -1.0, 0.0), (1.0, 0.0, 0.0), (0.0, 0.0, 1.0))
    soft = ((1.1, 0.02, 0.0), (0.0, 0.9, 0.03), (0.01, 0.0, 1.05))
    iron = MagnetometerImperfections(hard_iron_ut=(10.0, -20.0, 30.0), soft_iron=soft)
    bench = Bench(chip, imperfections=iron, mounting=mounting)
    x, y, z = body_field_ut()
    expected = [
        1.1 * -y + 0.02 * x + 10,
        0.9 * x + 0.03 * z - 20,
        0.01 * -y + 1.05 * z + 30,
    ]
    assert np.allclose(bench.chip.field_ut(bench.clock.now_ns()), expected)


@pytest.mark.parametrize("chip", list(CHIPS.values()), ids=list(CHIPS))
def test_noise_has_its_size_and_comes_again_with_its_seed(chip):
    def noise(seed):
        part = Bench(chip, imperfections=MagnetometerImperfections(noise_ut=0.5, seed=seed)).chip
        return np.array([part.noise_ut(number) for number in range(2000)])

    assert np.std(noise(1)) == pytest.approx(0.5, rel=0.05)
    assert np.array_equal(noise(1), noise(1))
    assert not np.array_equal(noise(1), noise(2))


def test_oscillator_that_is_off_gives_more_measurements():
    bench = Bench(Ak8963, imperfections=MagnetometerImperfections(rate_error=0.05))
    bench.wr(0x0A, 0x06)
    bench.wait_ms(10_000)
    bench.byte(0x02)
    assert bench.chip.measurements == pytest.approx(1050, abs=1)


@pytest.mark.parametrize("chip", list(CHIPS.values()), ids=list(CHIPS))
def test_power_cut_brings_power_up_values(chip):
    bench = Bench(chip)
    fresh = [bench.rd(register) for register in range(0x13)]
    control, value, _ = START[chip]
    bench.wr(control, value)
    bench.wait_ms(100)
    bench.chip.power_cut()
    assert [bench.rd(register) for register in range(0x13)] == fresh


@pytest.mark.parametrize("chip", list(CHIPS.values()), ids=list(CHIPS))
def test_field_turns_with_the_board(chip):
    bench = Bench(chip, motion=Turntable(start_s=0, turn_deg=90.0), mounting=((1, 0, 0), (0, 1, 0), (0, 0, 1)))
    start_ns = bench.clock.now_ns()
    x, y, z = bench.chip.field_ut(start_ns)
    assert np.allclose(bench.chip.field_ut(start_ns + 60_000_000_000), [y, -x, z])
