"""Drivers that were not written here read the truth from the fake, in this process."""

from __future__ import annotations

import errno
import importlib
import os
import re
import subprocess
import sys
import textwrap
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import smbus2
from oblique import (
    ACCEL_LSB_M_S2,
    FORCE_M_S2,
    GYRO_LSB_PER_DEG_S,
    RATE_DEG_S,
    TEMP_DEGC,
    TEMP_LSB_DEGC,
    Oblique,
    at_temperature,
)
from packages import installed

from hw_fakes import PERFECT, FakeMpu6050, Sway, pytest_plugin
from hw_fakes.ways.in_process import patched_smbus2
from hw_fakes.wire.adapter import Adapter
from quavelet.core.clock import VirtualClock
from quavelet.core.units import NS_PER_S


class Board:
    def __init__(self) -> None:
        self.clock = VirtualClock()
        self.chip = FakeMpu6050(self.clock, motion=Oblique(), imperfections=at_temperature())
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
    return installed(tmp_path_factory.mktemp("mpu6050-raspberrypi"), "mpu6050-raspberrypi==1.2")


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
    read = driver.get_accel_data()
    assert driver.read_accel_range() == range_g
    assert [read["x"], read["y"], read["z"]] == pytest.approx(FORCE_M_S2, abs=2 * ACCEL_LSB_M_S2[range_g], rel=0)


@pytest.mark.parametrize(("code", "range_dps"), [(0x00, 250), (0x08, 500), (0x10, 1000), (0x18, 2000)])
def test_mpu6050_raspberrypi_reads_another_rate(driver: Any, board: Board, code: int, range_dps: int) -> None:
    driver.set_gyro_range(code)
    board.settle()
    read = driver.get_gyro_data()
    assert driver.read_gyro_range() == range_dps
    assert [read["x"], read["y"], read["z"]] == pytest.approx(
        list(RATE_DEG_S), abs=2 / GYRO_LSB_PER_DEG_S[range_dps], rel=0
    )


def test_mpu6050_raspberrypi_reads_another_temperature(driver: Any) -> None:
    assert driver.get_temp() == pytest.approx(TEMP_DEGC, abs=2 * TEMP_LSB_DEGC, rel=0)


def test_mpu6050_raspberrypi_sets_another_filter_than_asked_for(driver: Any, board: Board) -> None:
    """Its set_filter_range, new in 1.2, is right: it keeps EXT_SYNC_SET and sets DLPF_CFG."""
    driver.bus.write_byte_data(0x68, 0x1A, 0x28)
    names = ("256", "188", "98", "42", "20", "10", "5")
    for code, bandwidth in enumerate(getattr(driver, f"FILTER_BW_{name}") for name in names):
        driver.set_filter_range(bandwidth)
        assert board.chip.registers[0x1A] == 0x28 | code


def test_mpu6050_raspberrypi_joins_bytes_of_two_samples(driver: Any, board: Board) -> None:
    """It reads the high and the low byte in two transactions, between which the chip may put a newer sample in place.

    Where the high byte has just changed the value is 256 counts off; a burst read of the same chip never is.
    """
    driver.set_gyro_range(driver.GYRO_RANGE_250DEG)
    swaying = FakeMpu6050(board.clock, motion=Sway(), imperfections=PERFECT)
    board.adapter.detach(0x68)
    board.adapter.attach(0x68, swaying)
    driver.bus.write_byte_data(0x68, 0x6B, 0)
    board.settle()

    def true_counts() -> float:
        t_s = swaying.world_time_s(board.clock.now_ns())
        return float(np.degrees(swaying.motion.rate_rad_s(np.array([t_s]))[0, 0])) * 131

    single, burst = [], []
    for _ in range(3000):
        single.append(driver.read_i2c_word(0x43) - true_counts())
        burst.append(
            int.from_bytes(bytes(driver.bus.read_i2c_block_data(0x68, 0x43, 2)), "big", signed=True) - true_counts()
        )
    assert max(map(abs, burst)) < 64
    torn = [error for error in map(abs, single) if error > 64]
    assert len(torn) > 10
    assert torn == pytest.approx([256] * len(torn), abs=64)


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


def test_example_of_the_pytest_plugin_passes(mpu6050_raspberrypi: Path, tmp_path: Path) -> None:
    assert pytest_plugin.__doc__
    example = re.search(r"(?m)^    @pytest.*\n(^    .*\n)+", pytest_plugin.__doc__)
    assert example
    header = "import pytest\nfrom hw_fakes import Still\n\n"
    (tmp_path / "test_it.py").write_text(header + textwrap.dedent(example[0]), encoding="utf-8")
    done = subprocess.run(
        [sys.executable, "-m", "pytest", "-p", "no:cacheprovider", "-q", "-W", "error", "test_it.py"],
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": str(mpu6050_raspberrypi)},
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    assert "1 passed" in done.stdout, done.stdout + done.stderr
