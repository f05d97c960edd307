"""Drivers that were not written here read the truth from the fake, in this process."""

from __future__ import annotations

import errno
import importlib
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import smbus2
from packages import installed

from hw_fakes import PERFECT, FakeMpu6050, Imperfections
from hw_fakes.i2c_adapter import Adapter
from hw_fakes.in_process import patched_smbus2
from quavelet.core.clock import VirtualClock
from quavelet.core.units import NS_PER_S, RAD_PER_DEG, STANDARD_GRAVITY_M_S2

TEMP_DEGC = 31.5
RATE_DEG_S = (10.0, -20.0, 30.0)
ROLL_DEG, PITCH_DEG = 30.0, -20.0


class Oblique:
    """A board at rest, not level, whose gyroscope is told to turn: every axis shows something of its own."""

    force_m_s2 = STANDARD_GRAVITY_M_S2 * np.array(
        [
            -np.sin(PITCH_DEG * RAD_PER_DEG),
            np.sin(ROLL_DEG * RAD_PER_DEG) * np.cos(PITCH_DEG * RAD_PER_DEG),
            np.cos(ROLL_DEG * RAD_PER_DEG) * np.cos(PITCH_DEG * RAD_PER_DEG),
        ]
    )

    def rate_rad_s(self, t_s: Any) -> Any:
        return np.tile(np.array(RATE_DEG_S) * RAD_PER_DEG, (len(t_s), 1))

    def specific_force_m_s2(self, t_s: Any) -> Any:
        return np.tile(self.force_m_s2, (len(t_s), 1))

    def attitude(self, t_s: Any) -> Any:
        return np.tile([1.0, 0.0, 0.0, 0.0], (len(t_s), 1))


class Board:
    def __init__(self) -> None:
        self.clock = VirtualClock()
        self.imperfections = Imperfections(temp_degc=TEMP_DEGC, warm_temp_degc=TEMP_DEGC, bias_temp_degc=TEMP_DEGC)
        self.chip = FakeMpu6050(self.clock, motion=Oblique(), imperfections=self.imperfections)
        self.adapter = Adapter({0x68: self.chip}, clock=self.clock)

    def settle(self) -> None:
        self.clock.advance_ns(NS_PER_S // 5)


@pytest.fixture
def board() -> Iterator[Board]:
    board = Board()
    with patched_smbus2({"/dev/i2c-1": board.adapter}):
        yield board


@pytest.fixture(scope="session")
def mpu6050_raspberrypi(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return installed("mpu6050-raspberrypi==1.2", tmp_path_factory.mktemp("mpu6050-raspberrypi"))


@pytest.fixture
def driver(mpu6050_raspberrypi: Path, monkeypatch: pytest.MonkeyPatch, board: Board) -> Any:
    """The class of PyPI's mpu6050-raspberrypi, whose `import smbus` finds smbus2."""
    monkeypatch.syspath_prepend(str(mpu6050_raspberrypi))
    monkeypatch.setitem(sys.modules, "smbus", smbus2)
    for name in ("mpu6050", "mpu6050.mpu6050"):
        monkeypatch.delitem(sys.modules, name, raising=False)
    made = importlib.import_module("mpu6050.mpu6050").mpu6050(0x68)
    board.settle()
    yield made
    made.bus.close()


@pytest.mark.parametrize(("code", "range_g"), [(0x00, 2), (0x08, 4), (0x10, 8), (0x18, 16)])
def test_mpu6050_raspberrypi_reads_another_acceleration(driver: Any, board: Board, code: int, range_g: int) -> None:
    driver.set_accel_range(code)
    board.settle()
    lsb = STANDARD_GRAVITY_M_S2 * range_g / 32768
    read = driver.get_accel_data()
    assert driver.read_accel_range() == range_g
    assert [read["x"], read["y"], read["z"]] == pytest.approx(list(Oblique.force_m_s2), abs=2 * lsb, rel=0)


@pytest.mark.parametrize(("code", "range_dps"), [(0x00, 250), (0x08, 500), (0x10, 1000), (0x18, 2000)])
def test_mpu6050_raspberrypi_reads_another_rate(driver: Any, board: Board, code: int, range_dps: int) -> None:
    driver.set_gyro_range(code)
    board.settle()
    read = driver.get_gyro_data()
    assert driver.read_gyro_range() == range_dps
    assert [read["x"], read["y"], read["z"]] == pytest.approx(list(RATE_DEG_S), abs=2 * range_dps / 32768, rel=0)


def test_mpu6050_raspberrypi_reads_another_temperature(driver: Any) -> None:
    assert driver.get_temp() == pytest.approx(TEMP_DEGC, abs=2 / 340, rel=0)


def test_calls_of_smbus2_read_different_bytes(board: Board) -> None:
    with smbus2.SMBus(1) as bus:
        bus.write_byte_data(0x68, 0x6B, 1)
        board.settle()
        block = bytes(bus.read_i2c_block_data(0x68, 0x3B, 14))
        write, read = smbus2.i2c_msg.write(0x68, [0x3B]), smbus2.i2c_msg.read(0x68, 14)
        bus.i2c_rdwr(write, read)
        word = bus.read_word_data(0x68, 0x3B)
        assert block == bytes(read)
        assert any(block)
        assert word.to_bytes(2, "little") == block[:2]
        bus.write_i2c_block_data(0x68, 0x1B, [0x10, 0x18])
        bus.write_word_data(0x68, 0x19, 0x0304)
        bus.write_byte(0x68, 0x19)
        assert [bus.read_byte(0x68) for _ in range(4)] == [0x04, 0x03, 0x10, 0x18]
        assert bus.read_byte_data(0x68, 0x75) == 0x68


@pytest.mark.parametrize("code", [errno.EREMOTEIO, errno.ENXIO])
def test_smbus2_gets_an_answer_from_where_nobody_is(code: int) -> None:
    with patched_smbus2({"/dev/i2c-3": Adapter(nack_errno=code)}), smbus2.SMBus("/dev/i2c-3") as bus:
        for ask in (lambda: bus.write_quick(0x68), lambda: bus.i2c_rdwr(smbus2.i2c_msg.read(0x68, 1))):
            with pytest.raises(OSError) as missing:
                ask()
            assert missing.value.errno == code


def test_smbus2_opens_a_bus_that_is_not_there(board: Board) -> None:
    assert board.adapter.transfers == 0
    with pytest.raises(FileNotFoundError, match="/dev/i2c-7"):
        smbus2.SMBus(7)


def test_smbus2_stays_replaced_after_the_block() -> None:
    before = (smbus2.smbus2.os, smbus2.smbus2.ioctl)
    clock = VirtualClock()
    with patched_smbus2({"/dev/i2c-1": Adapter({0x68: FakeMpu6050(clock, imperfections=PERFECT)})}):
        assert smbus2.smbus2.ioctl is not before[1]
    assert (smbus2.smbus2.os, smbus2.smbus2.ioctl) == before
