"""Drivers that were not written here read the truth from the fake as /dev/i2c-1, in a process of their own.

Where a driver is itself at fault the test says so, and the difference is exactly its fault. A driver's client is in
the folder clients and goes through every range in real time.
"""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
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

from hw_fakes import FakeMpu6050
from hw_fakes.ways.preload import served_device
from hw_fakes.wire.adapter import Adapter
from quavelet.core.clock import MonotonicClock

pytestmark = pytest.mark.skipif(
    not any(map(shutil.which, ("cc", "gcc", "clang"))), reason="no C compiler: apt install gcc libc6-dev"
)

CLIENTS = Path(__file__).with_name("clients")
SMBUS = ("smbus==1.1.post2",)
BLINKA = (
    "Adafruit-Blinka==10.0.0",
    "Adafruit-PlatformDetect==3.89.1",
    "Adafruit-PureIO==1.1.12",
    "adafruit-circuitpython-busdevice==5.2.17",
    "adafruit-circuitpython-register==1.13.0",
    "adafruit-circuitpython-typing==1.13.0",
    "adafruit-extended-bus==1.0.2",
)
DRIVERS = {
    "mpu6050-raspberrypi": ("mpu6050_raspberrypi", ("mpu6050-raspberrypi==1.2", *SMBUS)),
    "mpu6050-PI": ("mpu6050_pi", ("mpu6050-PI==0.0.2", *SMBUS)),
    "adafruit": ("adafruit", ("adafruit-circuitpython-mpu6050==1.3.9", *BLINKA)),
    "adafruit 1.3.8": ("adafruit", ("adafruit-circuitpython-mpu6050==1.3.8", *BLINKA)),
    "py-imu-mpu6050": ("py_imu_mpu6050", ("py-imu-mpu6050==0.3", *BLINKA)),
}
# mpu6050-PI finds no other address than 0x68, see its test.
ADDRESS = dict.fromkeys(DRIVERS, 0x69) | {"mpu6050-PI": 0x68}
PERIOD_ERRORS = {"pll_error": 0.01, "internal_error": -0.03}

the_others = pytest.mark.parametrize("driver", ["mpu6050-raspberrypi", "adafruit", "adafruit 1.3.8", "py-imu-mpu6050"])
every_driver = pytest.mark.parametrize("driver", DRIVERS)
at_each_accel_range = pytest.mark.parametrize("range_g", ACCEL_LSB_M_S2)
at_each_gyro_range = pytest.mark.parametrize("range_dps", GYRO_LSB_PER_DEG_S)


@dataclass(frozen=True, slots=True)
class Visit:
    """What a client told, and the chip it left behind."""

    told: dict[str, Any]
    chip: FakeMpu6050

    def accel_error_lsb(self, range_g: int) -> list[float]:
        read = self.told["accel"][str(range_g)]
        return [(a - b) / ACCEL_LSB_M_S2[range_g] for a, b in zip(read, FORCE_M_S2, strict=True)]

    def gyro_error_lsb(self, range_dps: int) -> list[float]:
        read = self.told["gyro"][str(range_dps)]
        return [(a - b) * GYRO_LSB_PER_DEG_S[range_dps] for a, b in zip(read, RATE_DEG_S, strict=True)]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Path]:
    """Where a driver is installed."""
    have: dict[str, Path] = {}

    def folder_of(driver: str) -> Path:
        if driver not in have:
            have[driver] = installed(tmp_path_factory.mktemp("driver"), *DRIVERS[driver][1])
        return have[driver]

    return folder_of


Client = Callable[..., "tuple[subprocess.CompletedProcess[str], FakeMpu6050]"]


@pytest.fixture(scope="module")
def client(folder: Callable[[str], Path]) -> Client:
    """Runs a driver's client on a chip of its own; the driver is told the chip's address."""

    def run(driver: str, *, address: int, temp_degc: float = TEMP_DEGC) -> Any:
        place = folder(driver)
        chip = FakeMpu6050(MonotonicClock(), motion=Oblique(), imperfections=at_temperature(temp_degc), **PERIOD_ERRORS)
        with served_device(Adapter({address: chip})) as environment:
            done = subprocess.run(
                [sys.executable, CLIENTS / f"{DRIVERS[driver][0]}.py", str(address)],
                env={**os.environ, **environment, "PYTHONPATH": str(place)},
                capture_output=True,
                text=True,
                timeout=60,
                check=False,
            )
        return done, chip

    return run


@pytest.fixture(scope="module")
def visit(client: Client) -> Iterator[Callable[[str], Visit]]:
    """One run of each driver, which many tests look at."""
    had: dict[str, Visit] = {}

    def visit_of(driver: str) -> Visit:
        if driver not in had:
            done, chip = client(driver, address=ADDRESS[driver])
            assert done.returncode == 0, done.stderr
            had[driver] = Visit(json.loads(done.stdout), chip)
        return had[driver]

    yield visit_of
    for driver, seen in had.items():
        worst = {f"{g} g": max(map(abs, seen.accel_error_lsb(g))) for g in ACCEL_LSB_M_S2}
        worst |= {f"{dps} deg/s": max(map(abs, seen.gyro_error_lsb(dps))) for dps in GYRO_LSB_PER_DEG_S}
        worst["temperature"] = abs(float(seen.told["temp"]) - TEMP_DEGC) / TEMP_LSB_DEGC
        print(f"{driver}, worst error in LSB: " + ", ".join(f"{name} {lsb:.2f}" for name, lsb in worst.items()))


@every_driver
@at_each_accel_range
def test_a_driver_reads_another_acceleration(visit: Callable[[str], Visit], driver: str, range_g: int) -> None:
    assert visit(driver).accel_error_lsb(range_g) == pytest.approx([0, 0, 0], abs=2)


@the_others
@at_each_gyro_range
def test_a_driver_reads_another_rate(visit: Callable[[str], Visit], driver: str, range_dps: int) -> None:
    assert visit(driver).gyro_error_lsb(range_dps) == pytest.approx([0, 0, 0], abs=2)


@every_driver
def test_a_driver_reads_another_temperature(visit: Callable[[str], Visit], driver: str) -> None:
    read = float(visit(driver).told["temp"])
    assert read == pytest.approx(TEMP_DEGC, abs=2 * TEMP_LSB_DEGC)


# Faults of mpu6050-PI 0.0.2


@at_each_gyro_range
def test_mpu6050_pi_divides_by_the_range_and_not_by_the_sensitivity(
    visit: Callable[[str], Visit], range_dps: int
) -> None:
    """It takes 32768 counts for the whole range; PS 6.1 has 131, 65.5, 32.8 and 16.4 LSB per deg/s."""
    read = visit("mpu6050-PI").told["gyro"][str(range_dps)]
    lsb = 1 / GYRO_LSB_PER_DEG_S[range_dps]
    put_right = [rate * 32768 / range_dps * lsb for rate in read]
    assert put_right == pytest.approx(RATE_DEG_S, abs=lsb)
    assert abs(read[2] - RATE_DEG_S[2]) > 3 * lsb


def test_mpu6050_pi_samples_at_an_eighth_of_the_rate_it_is_asked_for(visit: Callable[[str], Visit]) -> None:
    """It asks for 1000 Hz and counts from 8 kHz, though the low-pass filter it has switched on makes that 1 kHz."""
    chip = visit("mpu6050-PI").chip
    assert (0x19, 7) in chip.written
    assert chip.true_rate_hz() == pytest.approx(1000 / 8 * 1.01)


def test_mpu6050_pi_finds_nothing_at_the_address_it_is_given(client: Client) -> None:
    """It always writes to 0x68."""
    done, chip = client("mpu6050-PI", address=0x69)
    assert done.returncode == 1
    assert "Remote I/O error" in done.stderr
    assert chip.written == []


def test_mpu6050_pi_fails_every_sensor_in_its_self_test(visit: Callable[[str], Visit]) -> None:
    """It compares m/s^2 and deg/s with counts, so that of a perfect response hardly anything is left: about -100 %."""
    for sensor in visit("mpu6050-PI").told["self_test"]:
        assert list(sensor.values()) == pytest.approx([-1, -1, -1], abs=0.03)


def test_mpu6050_pi_gives_the_temperature_as_a_rounded_text(visit: Callable[[str], Visit]) -> None:
    """Two decimals, where a count is 0.003 degC."""
    assert visit("mpu6050-PI").told["temp"] == "31.50"


# Faults of adafruit-circuitpython-mpu6050


@pytest.mark.parametrize("driver", ["adafruit", "adafruit 1.3.8"])
def test_adafruit_sets_ranges_while_the_chip_sleeps(visit: Callable[[str], Visit], driver: str) -> None:
    """It asks for 500 deg/s before it wakes the chip, which loses the write and stays at 250."""
    seen = visit(driver)
    assert seen.chip.written.index((0x1B, 0x08)) < seen.chip.written.index((0x6B, 0x01))
    assert seen.told["gyro_range_at_start"] == 0


def test_adafruit_resets_no_signal_path(visit: Callable[[str], Visit]) -> None:
    """Its three bits go to 5:3 of register 104; the signal paths' are 2:0 (RM register 104)."""
    assert [value for register, value in visit("adafruit").chip.written if register == 0x68] == [0x38]


def test_adafruit_up_to_1_3_8_puts_the_filter_into_the_bits_of_fsync(visit: Callable[[str], Visit]) -> None:
    """All seven bandwidths leave DLPF_CFG at 0, the widest; what they set is EXT_SYNC_SET (RM register 26)."""

    def asked(driver: str) -> list[int]:
        return [value for register, value in visit(driver).chip.written if register == 0x1A][-7:]

    assert asked("adafruit 1.3.8") == [bandwidth << 3 for bandwidth in range(7)]
    assert asked("adafruit") == list(range(7))
    assert visit("adafruit 1.3.8").chip.true_rate_hz() == pytest.approx(8000 * 1.01)
    assert visit("adafruit").chip.true_rate_hz() == pytest.approx(1000 * 1.01)


def test_a_scan_of_blinka_finds_another_chip(visit: Callable[[str], Visit]) -> None:
    assert visit("adafruit").told["found"] == [0x69]


# Faults of py-imu-mpu6050 0.3


def test_py_imu_mpu6050_cannot_set_a_range_but_the_smallest(visit: Callable[[str], Visit]) -> None:
    """An `or` is missing at the end of a line: it calls a bool. Its client sets the register and the scale itself."""
    assert visit("py-imu-mpu6050").told["refused"] == [4, 8, 16, 500, 1000, 2000]


def test_py_imu_mpu6050_reads_a_temperature_low_where_bit_7_is_set(client: Client) -> None:
    """It takes the low byte for a signed one: 256 counts or 0.75 degC too low for half of all temperatures."""
    done, _ = client("py-imu-mpu6050", address=0x68, temp_degc=25.0)
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)["temp"] == pytest.approx(25.0 - 256 / 340, abs=2 * TEMP_LSB_DEGC)


# Faults of more than one


@pytest.mark.parametrize(("driver", "nominal_hz"), [("mpu6050-raspberrypi", 8000), ("py-imu-mpu6050", 1000)])
def test_a_driver_leaves_the_chip_on_its_internal_oscillator(
    visit: Callable[[str], Visit], driver: str, nominal_hz: int
) -> None:
    """CLKSEL 0: its rate is off by the 3 % of the internal oscillator, not the 1 % of the PLL (RM register 107)."""
    assert visit(driver).chip.true_rate_hz() == pytest.approx(nominal_hz * 0.97)
