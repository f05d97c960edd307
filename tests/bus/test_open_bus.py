"""A bus is opened by its name and by nothing else."""

from __future__ import annotations

import errno
import sys
from importlib.metadata import EntryPoint, EntryPoints
from pathlib import Path

import pytest
from i2c_dev import kernel_with

from hw_fakes import FakeBus, FakeDataReady, ScriptedBus
from hw_fakes.wire.adapter import Adapter
from quavelet.bus.open import GROUP, open_bus, open_line
from quavelet.core.clock import VirtualClock
from quavelet.core.errors import BusPermission, DeviceMissing, SettingsError


@pytest.mark.parametrize(
    ("name", "hint"),
    [
        ("linux:x", "write linux:N with N from /dev/i2c-N"),
        ("linux:-1", "write linux:N"),
        ("linux:", "write linux:N"),
        ("linux", "fake:..., linux:..."),
        ("nonsense", "fake:..., linux:..."),
        ("nonsense:1", "fake:..., linux:..."),
        ("", "fake:..., linux:..."),
        (":", "fake:..., linux:..."),
        ("LINUX:1", "fake:..., linux:..."),
        ("/dev/i2c-1", "fake:..., linux:..."),
        ("fake", "fake:..., linux:..."),
        ("fake:", "fake:tilt"),
        ("fake:nothing", "fake:tilt"),
    ],
)
def test_a_name_that_is_no_bus_is_quoted_and_the_right_ones_are_shown(name: str, hint: str) -> None:
    with kernel_with({"/dev/i2c-1": Adapter()}) as kernel, pytest.raises(SettingsError) as caught:
        open_bus(name, clock=VirtualClock())
    assert f"'{name}'" in str(caught.value)
    assert hint in str(caught.value)
    assert kernel.ioctls == []


@pytest.mark.parametrize(("number", "kind"), [(errno.ENOENT, DeviceMissing), (errno.EACCES, BusPermission)])
def test_a_missing_or_forbidden_bus_never_becomes_the_fake(
    number: int, kind: type[Exception], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(FakeBus, "__init__", lambda *_, **__: pytest.fail("the fake was made"))
    with kernel_with({"/dev/i2c-1": number}), pytest.raises(kind, match="/dev/i2c-1"):
        open_bus("linux:1", clock=VirtualClock())


def test_without_the_fake_installed_its_name_is_no_bus(monkeypatch: pytest.MonkeyPatch) -> None:
    only_linux = EntryPoints([EntryPoint("linux", "quavelet.bus.linux:open_linux", GROUP)])
    monkeypatch.setattr("quavelet.bus.open.entry_points", lambda group: only_linux.select(group=group))
    with pytest.raises(SettingsError, match=r"'fake:tilt' is not a bus: write one of linux:\.\.\.$"):
        open_bus("fake:tilt", clock=VirtualClock())


PLUG_IN = """
calls = []

def open_radio(which, *, clock):
    calls.append((which, clock))
    return "the bus"
"""


def test_an_installed_package_adds_a_kind_of_bus(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "radio_plug_in.py").write_text(PLUG_IN, encoding="utf-8")
    info = tmp_path / "radio_plug_in-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: radio-plug-in\nVersion: 1.0\n", encoding="utf-8")
    (info / "entry_points.txt").write_text("[quavelet.buses]\nradio = radio_plug_in:open_radio\n", encoding="utf-8")
    with pytest.raises(SettingsError, match="'radio:a:b' is not a bus"):
        open_bus("radio:a:b", clock=VirtualClock())

    monkeypatch.syspath_prepend(tmp_path)
    clock = VirtualClock()
    assert open_bus("radio:a:b", clock=clock) == "the bus"
    import radio_plug_in

    assert radio_plug_in.calls == [("a:b", clock)]
    assert radio_plug_in.calls[0][1] is clock
    assert open_bus("fake:still", clock=clock).name == "fake:still"
    with pytest.raises(SettingsError, match=r"fake:\.\.\., linux:\.\.\., radio:\.\.\."):
        open_bus("nonsense", clock=clock)


def test_no_name_is_no_line_on_any_bus() -> None:
    assert open_line("", bus=ScriptedBus([]), address=0x68) is None
    assert open_line("", bus=open_bus("fake:still", clock=VirtualClock()), address=0x68) is None


def test_a_fake_bus_gives_the_line_of_its_chip_and_no_gpio_of_this_machine() -> None:
    bus = open_bus("fake:still", clock=VirtualClock())
    assert isinstance(bus, FakeBus)
    line = open_line("fake:int", bus=bus, address=0x68)
    assert isinstance(line, FakeDataReady)
    assert (line.name, line.chip) == ("fake:int", bus.targets[0x68])
    with pytest.raises(SettingsError, match="no line 'pinctrl-rp1:17' at a fake bus: write fake:int"):
        open_line("pinctrl-rp1:17", bus=bus, address=0x68)
    with pytest.raises(SettingsError, match="no MPU-6050 with an INT pin at 0x69"):
        open_line("fake:int", bus=bus, address=0x69)


def test_a_real_bus_never_gets_the_line_of_a_fake_one(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "gpiod", None)
    monkeypatch.setattr(FakeDataReady, "__init__", lambda *_, **__: pytest.fail("the fake was made"))
    for name in ("fake:int", "pinctrl-rp1:17"):
        with pytest.raises(SettingsError, match=r"needs gpiod, which is not installed: pip install 'quavelet\[gpio\]'"):
            open_line(name, bus=ScriptedBus([]), address=0x68)
