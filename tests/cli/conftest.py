"""Recordings and buses for the tests of the command line."""

import os
import signal
from collections.abc import Iterator
from pathlib import Path

import pytest
from program import quavelet

ODD_BUSES = '''
import errno

from hw_fakes import FakeBus, FakeMpu6050
from quavelet.bus.faults import bus_error


class AnotherChip:
    def write(self, data): pass
    def read(self, n): return bytes([0x19]) * n
    def stop(self): pass


class Dying(FakeBus):
    """The plug is pulled after four hundred transactions."""

    def _transfer(self, messages):
        if self.transactions == 400:
            self.targets.clear()
        return super()._transfer(messages)


def open_odd(which, *, clock):
    if which == "another_chip":
        return FakeBus({0x68: AnotherChip()}, clock=clock, name="odd:another_chip")
    if which == "dying":
        return Dying({0x68: FakeMpu6050(clock)}, clock=clock, name="odd:dying")
    raise bus_error(getattr(errno, which), bus="/dev/i2c-1")
'''


@pytest.fixture(scope="session", autouse=True)
def programs_heed_ctrl_c() -> Iterator[None]:
    """A job in the background of a script has SIGINT ignored, and hands that down."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.fixture(scope="session")
def with_odd_buses(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """An environment with the buses of another package installed: odd:another_chip, odd:dying, odd:ERRNO."""
    folder = tmp_path_factory.mktemp("odd")
    (folder / "odd_buses.py").write_text(ODD_BUSES)
    info = folder / "odd_buses-0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: odd-buses\nVersion: 0\n")
    (info / "entry_points.txt").write_text("[quavelet.buses]\nodd = odd_buses:open_odd\n")
    return {**os.environ, "PYTHONPATH": str(folder)}


@pytest.fixture(scope="session")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Five seconds of the fake chip; the messages it gave live lie beside it."""
    path = tmp_path_factory.mktemp("recording") / "tilt.qrec"
    done = quavelet("run", "--bus", "fake:tilt", "--virtual-time", "--duration", 5, "--record", path)
    assert done.code == 0, done.err
    path.with_suffix(".jsonl").write_text(done.out)
    return path
