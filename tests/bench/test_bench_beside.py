"""The check-up tells which magnetometer is behind the chip, and does not blame a board that has none."""

from __future__ import annotations

import pytest
from boards import QUIET

from hw_fakes import FakeBus, FakeMpu6050, Still, board
from quavelet.bench.beside import magnetometer
from quavelet.bench.finding import Finding
from quavelet.core.clock import VirtualClock
from quavelet.mpu6050.magnetometer.asked import MagnetometerParams
from quavelet.settings import Settings

FOUND = {
    "gy-87": "QMC5883L at 0x0d",
    "gy-87-hmc5883l": "HMC5883L at 0x1e",
    "mpu-9150": "AK8975 at 0x0c",
    "mpu-9250": "AK8963 at 0x0c",
}


def looked(name: str, *, use: str = "no", outside: bool = False) -> Finding:
    clock = VirtualClock()
    bought = board(name)
    aux = bought.aux_master(clock, Still())
    chip = FakeMpu6050(clock, personality=bought.personality, aux=aux, **QUIET)
    there = aux.targets if outside else aux.outside()
    before = [chip.registers[register] for register in (0x37, 0x6A, 0x6B)]
    bus = FakeBus({0x68: chip, **there}, clock=clock)
    finding = magnetometer(bus, settings=Settings(magnetometer=MagnetometerParams(use=use)), clock=clock)
    assert [chip.registers[register] for register in (0x37, 0x6A, 0x6B)] == before
    return finding


@pytest.mark.parametrize("name", FOUND)
def test_magnetometer_behind_the_chip_is_not_told_of(name):
    finding = looked(name)
    assert finding.ok
    assert finding.found == FOUND[name]
    assert 'magnetometer.use = "auto"' in finding.advice
    assert looked(name, use="auto").advice == ""


def test_plain_board_is_blamed_for_having_none():
    finding = looked("gy-521")
    assert finding.ok and not finding.advice
    assert "no magnetometer" in finding.found


def test_magnetometer_that_was_asked_for_by_name_is_not_missed():
    finding = looked("gy-87", use="HMC5883L")
    assert not finding.ok
    assert "check its wires" in finding.advice


def test_magnetometer_on_the_outer_bus_is_promised_with_the_samples():
    finding = looked("gy-87", outside=True)
    assert finding.ok and not finding.advice
    assert "outer bus" in finding.found
