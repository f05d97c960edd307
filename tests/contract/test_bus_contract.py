"""Every bus there is passes the contract."""

from __future__ import annotations

import errno
from collections.abc import Iterator

import pytest
from bus_contract import HERE, BusContract, Counter
from i2c_dev import kernel_with

from hw_fakes import FakeBus, FakeMpu6050, ScriptedBus, Write
from hw_fakes.ways.in_process import PatchedKernel
from hw_fakes.wire.adapter import Adapter
from quavelet.bus.faults import bus_error
from quavelet.bus.linux import LinuxI2CBus
from quavelet.bus.open import open_bus
from quavelet.bus.protocol import I2CBus
from quavelet.core.clock import VirtualClock
from quavelet.core.errors import DeviceMissing


class TestLinux(BusContract):
    """smbus2 and its structures, with the kernel in this process."""

    NAME = "linux:1"
    NACK = errno.EREMOTEIO

    @pytest.fixture
    def kernel(self) -> Iterator[PatchedKernel]:
        adapter = Adapter({HERE: FakeMpu6050(VirtualClock())}, nack_errno=self.NACK)
        with kernel_with({"/dev/i2c-1": adapter}) as kernel:
            yield kernel

    @pytest.fixture
    def bus(self, kernel: PatchedKernel) -> Iterator[I2CBus]:
        with open_bus("linux:1", clock=VirtualClock()) as bus:
            assert isinstance(bus, LinuxI2CBus)
            assert len(kernel.open_files) == 1
            yield bus

    @pytest.fixture
    def transactions(self, kernel: PatchedKernel) -> Counter:
        return lambda: len(kernel.transactions)


class TestLinuxOnAnotherAdapter(TestLinux):
    """A missing acknowledge told as most adapters but the Raspberry Pi's tell it."""

    NACK = errno.ENXIO


class TestFake(BusContract):
    NAME = "fake:one"

    @pytest.fixture
    def bus(self) -> I2CBus:
        clock = VirtualClock()
        return FakeBus({HERE: FakeMpu6050(clock)}, clock=clock, name="fake:one")

    @pytest.fixture
    def transactions(self, bus: FakeBus) -> Counter:
        return lambda: bus.transactions


class TestFakeByName(TestFake):
    NAME = "fake:tilt"

    @pytest.fixture
    def bus(self) -> I2CBus:
        return open_bus("fake:tilt", clock=VirtualClock())


def test_a_script_tells_a_failure_as_the_other_buses_and_may_be_closed_twice() -> None:
    error = bus_error(errno.EREMOTEIO, bus="fake:script", address=0x69, register=0x6B)
    with ScriptedBus([Write(0x69, b"\x6b\x01", error=error)]) as bus:
        with pytest.raises(DeviceMissing, match="0x69 on fake:script"):
            bus.write(0x69, b"\x6b\x01")
        bus.close()
        bus.close()
