"""Looking at quavelet touches no bus: neither smbus2 nor the fake is loaded before a bus is opened by name."""

from __future__ import annotations

import json
import subprocess
import sys

import pytest

WATCH = """
import importlib, json, os, pkgutil, sys
opened = []
sys.addaudithook(lambda event, args: opened.append(str(args[0])) if event == "open" else None)
{what}
report = {{
    "modules": sorted({{name.partition(".")[0] for name in sys.modules}}),
    "devices": [path for path in opened if path.startswith("/dev/")],
}}
os.close(os.open("/dev/null", os.O_RDONLY))
report["hook"] = opened[-1]
print(json.dumps(report))
"""
ALL_BUT_LINUX = """
import quavelet
for module in pkgutil.walk_packages(quavelet.__path__, "quavelet."):
    if module.name != "quavelet.bus.linux":
        importlib.import_module(module.name)
"""


def watched(what: str) -> dict[str, list[str]]:
    """What a fresh interpreter has loaded and opened after `what`."""
    run = subprocess.run(
        [sys.executable, "-c", WATCH.format(what=what)], capture_output=True, text=True, timeout=120, check=False
    )
    assert run.returncode == 0, run.stderr
    report: dict[str, list[str]] = json.loads(run.stdout)
    assert report["hook"] == "/dev/null"  # the hook sees what it should see
    return report


@pytest.mark.parametrize(
    "what",
    [
        "import quavelet",
        "import quavelet.bus, quavelet.bus.open, quavelet.bus.faults, quavelet.bus.protocol",
        ALL_BUT_LINUX,
    ],
    ids=["quavelet", "quavelet.bus", "everything but bus.linux"],
)
def test_importing_loads_no_bus_and_opens_no_device(what: str) -> None:
    report = watched(what)
    assert "quavelet" in report["modules"]
    assert not {"smbus2", "hw_fakes"} & set(report["modules"])
    assert report["devices"] == []


def open_in_fresh_interpreter(name: str) -> str:
    return f"""
from quavelet.bus.open import open_bus
from quavelet.core.clock import VirtualClock
from quavelet.core.errors import ImuError
try:
    open_bus("{name}", clock=VirtualClock()).close()
except ImuError:
    pass
"""


def test_a_linux_bus_opens_its_device_and_loads_no_fake() -> None:
    report = watched(open_in_fresh_interpreter("linux:255"))
    assert report["devices"] == ["/dev/i2c-255"]
    assert "smbus2" in report["modules"]
    assert "hw_fakes" not in report["modules"]


def test_the_fake_opens_no_device_and_loads_no_smbus2() -> None:
    report = watched(open_in_fresh_interpreter("fake:tilt"))
    assert report["devices"] == []
    assert "hw_fakes" in report["modules"]
    assert "smbus2" not in report["modules"]


def test_a_name_that_is_no_bus_loads_neither() -> None:
    report = watched(open_in_fresh_interpreter("nonsense:1"))
    assert not {"smbus2", "hw_fakes"} & set(report["modules"])
    assert report["devices"] == []
