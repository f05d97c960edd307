"""What the machine says of its buses and of who holds an address is told with the finding."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from boards import checked

from hw_fakes import FakeBus
from quavelet.bench.host import Host
from quavelet.bus.faults import bus_error
from quavelet.core.errors import BusBusy
from quavelet.settings import BusSettings, Settings


class Refusing:
    """A bus whose transfers to one address are refused as a kernel that holds it does."""

    def __init__(self, code: int) -> None:
        self.code = code

    def __call__(self, bus: FakeBus) -> None:
        transfer = bus._transfer

        def refusing(messages: Any) -> Any:
            if messages[0][0] == 0x68:
                raise bus_error(self.code, bus="linux:1", address=0x68)
            return transfer(messages)

        bus._transfer = refusing  # type: ignore[method-assign]


@pytest.mark.parametrize(
    ("device", "driver", "words"),
    [
        ("ds3231", "rtc-ds1307", "a clock chip has this address"),
        ("mpu6050", "inv-mpu6050-i2c", "modprobe -r inv_mpu6050_i2c"),
        ("", "", "wire AD0 high"),
    ],
)
def test_an_address_the_kernel_holds_is_told_with_who_holds_it(
    device: str, driver: str, words: str, tmp_path: Path
) -> None:
    if device:
        folder = tmp_path / "sys/bus/i2c/devices/1-0068"
        drivers = tmp_path / "sys/bus/i2c/drivers" / driver
        folder.mkdir(parents=True)
        drivers.mkdir(parents=True)
        (folder / "name").write_text(f"{device}\n")
        (folder / "driver").symlink_to(drivers)
    done = checked(prepare=Refusing(16), host=Host(tmp_path), settings=Settings(bus=BusSettings(name="linux:1")))
    assert done.bad == ["who answers"]
    assert isinstance(done.error, BusBusy)
    assert words in done["who answers"].advice
    assert driver in done["who answers"].found


def host_with_buses(root: Path, **adapters: str) -> Host:
    for bus, name in adapters.items():
        path = bus.replace("_", "-")
        (root / "dev").mkdir(exist_ok=True)
        (root / "dev" / path).touch()
        folder = root / "sys/bus/i2c/devices" / path
        folder.mkdir(parents=True)
        (folder / "name").write_text(f"{name}\n")
    return Host(root)


def test_the_buses_there_are_are_told_and_the_clock_asked_for(tmp_path: Path) -> None:
    host = host_with_buses(tmp_path, i2c_1="bcm2835 (i2c@7e804000)", i2c_20="fef04500.i2c")
    node = tmp_path / "sys/bus/i2c/devices/i2c-1/of_node"
    node.mkdir()
    (node / "clock-frequency").write_bytes((100_000).to_bytes(4, "big"))
    done = checked(host=host, settings=Settings(bus=BusSettings(name="linux:1")))
    assert done["bus"].found == "linux:1 (bcm2835 (i2c@7e804000)) is open; there are also linux:20 (fef04500.i2c)"
    assert "set to 100 kHz" in done["wire speed"].found


@pytest.mark.parametrize(("there", "words"), [(("i2c_1",), "--bus"), ((), "raspi-config")])
def test_a_bus_that_is_not_there_is_told_with_those_that_are(
    there: tuple[str, ...], words: str, tmp_path: Path
) -> None:
    host = host_with_buses(tmp_path, **dict.fromkeys(there, "bcm2835"))

    def missing(_bus: FakeBus) -> None:
        raise bus_error(2, bus="/dev/i2c-7")

    done = checked(prepare=missing, host=host, settings=Settings(bus=BusSettings(name="linux:7")))
    assert done.names == ["bus"]
    assert words in done["bus"].advice
    assert ("linux:1 (bcm2835)" in done["bus"].found) == bool(there)
