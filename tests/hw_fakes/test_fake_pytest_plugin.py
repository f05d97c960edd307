"""The fixture fake_mpu6050 under drivers of others."""

from __future__ import annotations

import errno
import math
import re
import subprocess
import sys
import threading
import time
from datetime import datetime
from pathlib import Path
from types import ModuleType

import _pytest.timing
import numpy as np
import pytest
import smbus2

from hw_fakes import MPU6500, AllOnes, FakeMpu6050, NotAcknowledged, RecordedCounts, Still, Turntable
from hw_fakes.pytest_plugin import Bench, bench
from quavelet.core.clock import MonotonicClock, VirtualClock

REAL = {name: getattr(time, name) for name in ("sleep", "time", "monotonic", "perf_counter")}
G = 9.80665


def wake(bus: smbus2.SMBus, *, address: int = 0x68) -> None:
    bus.write_byte_data(address, 0x6B, 1)


def sensors(bus: smbus2.SMBus, *, address: int = 0x68) -> list[int]:
    block = bytes(bus.read_i2c_block_data(address, 0x3B, 14))
    return [int.from_bytes(block[k : k + 2], "big", signed=True) for k in range(0, 14, 2)]


def module(monkeypatch: pytest.MonkeyPatch, name: str, source: str) -> ModuleType:
    """A module as it is after its import."""
    made = ModuleType(name)
    exec(source, vars(made))
    monkeypatch.setitem(sys.modules, name, made)
    return made


def session(folder: Path, source: str, *options: str) -> str:
    """What pytest says of a file of tests, in a process of its own that takes every warning for an error."""
    (folder / "test_it.py").write_text(source, encoding="utf-8")
    command = [sys.executable, "-W", "error", "-m", "pytest", "-p", "no:cacheprovider", "--strict-markers", "-q"]
    run = subprocess.run(
        [*command, *options, "test_it.py"], cwd=folder, capture_output=True, text=True, timeout=120, check=False
    )
    return run.stdout + run.stderr


# The chip


@pytest.mark.fake_mpu6050(motion=Turntable(start_s=0.0), perfect=True)
def test_a_driver_gets_another_truth_than_the_fixture_tells(fake_mpu6050: Bench) -> None:
    with smbus2.SMBus(1) as bus:
        wake(bus)
        time.sleep(3)
        assert fake_mpu6050.truth.rate_deg_s == pytest.approx((0.0, 0.0, 30.0), abs=1e-9)
        assert sensors(bus) == [0, 0, 16384, round((25 - 36.53) * 340), 0, 0, 30 * 131]
    turned_deg = math.degrees(2 * math.acos(fake_mpu6050.truth.attitude[0]))
    fake_mpu6050.advance(2)
    assert math.degrees(2 * math.acos(fake_mpu6050.truth.attitude[0])) - turned_deg == pytest.approx(60.0)


def test_without_a_marker_it_is_no_typical_chip_that_lies_still(fake_mpu6050: Bench) -> None:
    assert fake_mpu6050.truth.attitude == (1.0, 0.0, 0.0, 0.0)
    assert fake_mpu6050.truth.force_m_s2 == pytest.approx((0.0, 0.0, G))
    with smbus2.SMBus(1) as bus:
        wake(bus)
        fake_mpu6050.settle()
        counts = sensors(bus)
    assert counts[2] == pytest.approx(16384, rel=0.06)
    assert counts[4] == pytest.approx(4.5 * 131, abs=0.5 * 131)  # its gyroscope has a bias
    assert fake_mpu6050.truth.temp_degc == pytest.approx(26, abs=0.1)


@pytest.mark.fake_mpu6050(motion=Still(roll_deg=30.0), perfect=True, address=0x69)
class TestMarkerOfAClass:
    @pytest.mark.fake_mpu6050(bus=7, address=0x68, personality=MPU6500)
    def test_a_nearer_marker_leaves_the_farther_one_as_it_was_or_forgets_it(self, fake_mpu6050: Bench) -> None:
        assert fake_mpu6050.truth.force_m_s2 == pytest.approx((0.0, G / 2, G * math.sqrt(0.75)))
        with smbus2.SMBus(7) as bus:
            wake(bus)
            fake_mpu6050.settle()
            assert bus.read_byte_data(0x68, 0x75) == 0x70
            assert sensors(bus)[:3] == [0, 8192, round(16384 * math.sqrt(0.75))]

    def test_the_marker_of_the_class_is_forgotten(self, fake_mpu6050: Bench) -> None:
        assert list(fake_mpu6050.adapter.targets.items()) == [(0x69, fake_mpu6050.chip)]


@pytest.mark.fake_mpu6050(perfect=True, internal_error=-0.05)
def test_an_error_that_is_given_is_lost_in_a_perfect_chip(fake_mpu6050: Bench) -> None:
    fake_mpu6050.bus.write(0x68, b"\x6b\x00")
    assert fake_mpu6050.chip.true_rate_hz() == pytest.approx(8000 * 0.95)


def test_a_second_chip_or_a_refusal_is_not_seen_by_the_driver(fake_mpu6050: Bench) -> None:
    fake_mpu6050.adapter.attach(0x69, FakeMpu6050(fake_mpu6050.clock))
    with smbus2.SMBus(1) as bus:
        assert bus.read_byte_data(0x69, 0x75) == 0x68
        fake_mpu6050.kernel.fail_with = errno.ETIMEDOUT
        with pytest.raises(TimeoutError):
            bus.read_byte_data(0x69, 0x75)


@pytest.mark.fake_mpu6050(motion=Still(yaw_deg=90.0), perfect=True, board="gy-87")
def test_a_boards_magnetometer_is_not_behind_the_bypass(fake_mpu6050: Bench) -> None:
    with smbus2.SMBus(1) as bus:
        wake(bus)
        with pytest.raises(OSError, match="Remote I/O"):
            bus.read_byte_data(0x0D, 0x0D)
        bus.write_byte_data(0x68, 0x37, 0x02)
        bus.write_i2c_block_data(0x0D, 0x09, [0x0D, 0x00, 0x01])  # QMC5883L: continuous at 200 Hz, +-2 G
        time.sleep(0.02)
        block = bytes(bus.read_i2c_block_data(0x0D, 0x00, 6))
    read_ut = [int.from_bytes(block[k : k + 2], "little", signed=True) / 120 for k in (0, 2, 4)]
    assert read_ut == pytest.approx(fake_mpu6050.truth.field_ut, abs=0.02)
    x, y, z = fake_mpu6050.truth.field_ut
    assert x > 15 > 5 > abs(y)  # x to the north, up in z: the field goes down
    assert z < -40


NINE = np.zeros((9, 3), dtype=np.int16)
COUNTS = RecordedCounts(acc=NINE, gyr=NINE, temp=NINE[:, 0], acc_lsb_per_g=16384, gyr_lsb_per_dps=131, rate_hz=200)


@pytest.mark.fake_mpu6050(source=COUNTS)
def test_recorded_counts_have_a_truth(fake_mpu6050: Bench) -> None:
    with pytest.raises(ValueError, match="no truth"):
        _ = fake_mpu6050.truth


@pytest.mark.fake_mpu6050(faults="nack at=1 n=2")
def test_faults_do_not_happen_or_leave_no_history(fake_mpu6050: Bench) -> None:
    with smbus2.SMBus(1) as bus:
        assert bus.read_byte_data(0x68, 0x75) == 0x68
        time.sleep(1)
        for _ in range(2):
            with pytest.raises(OSError, match="Remote I/O"):
                bus.read_byte_data(0x68, 0x75)
        assert bus.read_byte_data(0x68, 0x75) == 0x68
        fake_mpu6050.faults.now(AllOnes())
        assert bus.read_byte_data(0x68, 0x75) == 0xFF
    assert [type(it.kind) for it in fake_mpu6050.faults.history] == [NotAcknowledged, NotAcknowledged, AllOnes]


def test_a_wrong_marker_is_taken_for_a_right_one(tmp_path: Path) -> None:
    said = session(
        tmp_path,
        """
import pytest

@pytest.mark.parametrize("k", [
    pytest.param(0, marks=pytest.mark.fake_mpu6050("tilt")),
    pytest.param(1, marks=pytest.mark.fake_mpu6050(motion="tlit")),
    pytest.param(2, marks=pytest.mark.fake_mpu6050(adress=0x69)),
    pytest.param(3, marks=pytest.mark.fake_mpu6050(faults="nock")),
])
def test_it(fake_mpu6050, k):
    pass
""",
    )
    assert "takes arguments by name only, as motion='tilt'" in said
    assert re.search("SettingsError: there is no .*tlit.*: take one of .*still,", said)
    assert "unexpected keyword argument 'adress'" in said
    assert "there is no fault 'nock'" in said
    assert "4 errors" in said


# Time


def test_the_clocks_go_apart_or_wait_in_real_time(fake_mpu6050: Bench) -> None:
    clock = fake_mpu6050.clock
    begun = datetime.now().timestamp()
    assert abs(time.time() - begun) < 60  # they go on from the real time
    before = clock.now_ns(), time.time(), time.monotonic(), time.perf_counter()
    before_ns = time.time_ns(), time.monotonic_ns(), time.perf_counter_ns()
    time.sleep(1000)
    after = clock.now_ns(), time.time(), time.monotonic(), time.perf_counter()
    after_ns = time.time_ns(), time.monotonic_ns(), time.perf_counter_ns()
    assert after[0] - before[0] == pytest.approx(1000e9, abs=20e3)
    assert [b - a for a, b in zip(before[1:], after[1:], strict=True)] == pytest.approx([1000] * 3, abs=20e-6)
    assert [b - a for a, b in zip(before_ns, after_ns, strict=True)] == pytest.approx([1000e9] * 3, abs=20e3)
    assert datetime.now().timestamp() - begun < 60
    with pytest.raises(ValueError, match="non-negative"):
        time.sleep(-1)


@pytest.mark.usefixtures("fake_mpu6050")
def test_a_transfer_takes_no_time() -> None:
    with smbus2.SMBus(1) as bus:
        begun = time.monotonic_ns()
        bus.read_byte_data(0x68, 0x75)
        assert time.monotonic_ns() - begun == pytest.approx(97_500, abs=2000)  # 39 bits at 400 kHz


@pytest.mark.usefixtures("fake_mpu6050")
def test_waiting_for_a_deadline_never_ends() -> None:
    deadline = time.monotonic() + 0.1
    while time.monotonic() < deadline:
        pass


def test_a_driver_that_took_sleep_before_waits_in_real_time(monkeypatch: pytest.MonkeyPatch) -> None:
    driver = module(monkeypatch, "early_driver", "from time import sleep, monotonic, time")
    with bench() as fake:
        begun = driver.monotonic()
        driver.sleep(1e6)
        assert fake.clock.now_ns() >= 1e15
        assert driver.monotonic() - begun == pytest.approx(1e6)
    assert (driver.sleep, driver.monotonic, driver.time) == (REAL["sleep"], REAL["monotonic"], REAL["time"])


def test_a_driver_imported_meanwhile_keeps_the_clock_of_another_test(monkeypatch: pytest.MonkeyPatch) -> None:
    with bench() as first:
        driver = module(monkeypatch, "late_driver", "from time import sleep, monotonic")
        driver.sleep(1e6)
    assert driver.monotonic() == pytest.approx(time.monotonic(), abs=60)
    begun = time.monotonic()
    driver.sleep(0.02)
    assert time.monotonic() - begun >= 0.02
    stopped_ns = first.clock.now_ns()
    with bench() as second:
        driver.sleep(10)
        assert second.clock.now_ns() >= 10e9
    assert first.clock.now_ns() == stopped_ns


def test_other_threads_and_pytest_itself_live_in_virtual_time(fake_mpu6050: Bench) -> None:
    seen: list[float] = []

    def look() -> None:
        time.sleep(0)
        seen.extend((time.monotonic(), _pytest.timing.perf_counter() - time.perf_counter()))

    time.sleep(1e6)
    thread = threading.Thread(target=look)
    thread.start()
    thread.join()
    assert time.monotonic() - seen[0] == pytest.approx(1e6, abs=60)
    assert abs(seen[1]) < 60
    assert fake_mpu6050.clock.now_ns() == pytest.approx(1e15, abs=1e6)
    assert time.perf_counter() - _pytest.timing.perf_counter() == pytest.approx(1e6, abs=60)


@pytest.mark.fake_mpu6050(real_time=True, perfect=True)
def test_real_time_is_virtual(fake_mpu6050: Bench) -> None:
    assert isinstance(fake_mpu6050.clock, MonotonicClock)
    assert time.sleep is REAL["sleep"]
    begun = time.monotonic()
    fake_mpu6050.advance(0.05)
    assert time.monotonic() - begun >= 0.05
    with smbus2.SMBus(1) as bus:
        wake(bus)
        time.sleep(0.05)
        assert sensors(bus)[2] == 16384


# What is left behind


def test_something_stays_replaced_after_the_block(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delitem(sys.modules, "smbus", raising=False)
    before = smbus2.smbus2.os, smbus2.smbus2.ioctl, {name: getattr(time, name) for name in REAL}, set(sys.modules)
    with pytest.raises(KeyError), bench() as fake:
        assert isinstance(fake.clock, VirtualClock)
        assert time.sleep is not REAL["sleep"]
        module(monkeypatch, "imported_meanwhile", "")
        raise KeyError
    assert (smbus2.smbus2.os, smbus2.smbus2.ioctl, REAL) == before[:3]
    assert "imported_meanwhile" in sys.modules
    assert "smbus" not in sys.modules


def test_a_driver_of_the_module_smbus_finds_no_chip(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delitem(sys.modules, "smbus", raising=False)
    with bench():
        driver = module(monkeypatch, "smbus_driver", "import smbus\nbus = smbus.SMBus(1)")
        assert driver.bus.read_byte_data(0x68, 0x75) == 0x68
        driver.bus.close()


def test_a_driver_that_took_the_real_smbus_opens_a_real_bus(monkeypatch: pytest.MonkeyPatch) -> None:
    smbus = module(monkeypatch, "smbus", "class SMBus: ...")
    driver = module(monkeypatch, "real_smbus_driver", "import smbus\nfrom smbus import SMBus")
    with bench():
        for find in (driver.SMBus, driver.smbus.SMBus):
            with find(1) as bus:
                assert bus.read_byte_data(0x68, 0x75) == 0x68
    assert driver.SMBus is smbus.SMBus
    assert driver.SMBus is not smbus2.SMBus


def test_a_session_that_uses_nothing_of_it_notices_it(tmp_path: Path) -> None:
    said = session(
        tmp_path,
        """
import sys, time

def test_it():
    assert "hw_fakes.pytest_plugin" in sys.modules
    assert not {"smbus2", "quavelet", "hw_fakes.chip.mpu6050"} & set(sys.modules)
    assert time.sleep.__module__ == "time"
""",
    )
    assert "1 passed" in said, said
    assert "warning" not in said


def test_the_marker_is_not_explained(tmp_path: Path) -> None:
    assert "@pytest.mark.fake_mpu6050(motion='still', perfect=False" in session(tmp_path, "", "--markers")
