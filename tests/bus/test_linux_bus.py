"""What the Linux bus asks of the kernel, and what it makes of the kernel's refusals."""

from __future__ import annotations

import errno
import os
from collections.abc import Iterator

import pytest
from i2c_dev import access_modes, kernel_with

from hw_fakes import FakeMpu6050
from hw_fakes.ways.i2c_dev import I2C_FUNCS, I2C_RDWR, I2C_SLAVE
from hw_fakes.ways.in_process import PatchedKernel
from hw_fakes.wire.adapter import Adapter
from quavelet.bus.linux import LinuxI2CBus, open_linux
from quavelet.core.clock import VirtualClock
from quavelet.core.errors import BusBusy, BusError, BusPermission, DeviceMissing, SettingsError


class Target:
    """Remembers what a device at the end of the wire sees."""

    def __init__(self) -> None:
        self.seen: list[object] = []

    def write(self, data: bytes) -> None:
        self.seen.append(data)

    def read(self, n: int) -> bytes:
        self.seen.append(n)
        return bytes(k % 256 for k in range(n))

    def stop(self) -> None:
        self.seen.append("stop")


@pytest.fixture
def target() -> Target:
    return Target()


@pytest.fixture
def kernel(target: Target) -> Iterator[PatchedKernel]:
    with kernel_with({"/dev/i2c-1": Adapter({0x68: target})}) as kernel:
        yield kernel


@pytest.fixture
def bus(kernel: PatchedKernel) -> Iterator[LinuxI2CBus]:
    with open_linux("1", clock=VirtualClock()) as bus:
        assert kernel.ioctls == [I2C_FUNCS]
        assert access_modes(kernel) == {os.O_RDWR}
        kernel.ioctls.clear()
        yield bus


@pytest.mark.parametrize("n", [1, 2, 14, 32, 33, 1024, 8192])
def test_a_combined_read_is_one_system_call_of_two_messages_with_a_repeated_start(
    kernel: PatchedKernel, bus: LinuxI2CBus, target: Target, n: int
) -> None:
    answer = bus.write_read(0x68, b"\x74", n)
    assert kernel.ioctls == [I2C_SLAVE, I2C_RDWR]
    assert kernel.transactions == [[(0x68, "write", 1), (0x68, "read", n)]]
    assert target.seen == [b"\x74", n, "stop"]
    assert answer == bytes(k % 256 for k in range(n))


@pytest.mark.parametrize("n", [1, 2, 33, 1025])
def test_a_write_is_one_system_call_of_one_message(
    kernel: PatchedKernel, bus: LinuxI2CBus, target: Target, n: int
) -> None:
    data = bytes(k % 256 for k in range(n))
    bus.write(0x68, data)
    assert kernel.ioctls == [I2C_SLAVE, I2C_RDWR]
    assert kernel.transactions == [[(0x68, "write", n)]]
    assert target.seen == [data, "stop"]


@pytest.mark.parametrize("n", [8193, 65536, 65536 + 14])
def test_a_read_too_long_for_the_kernel_is_refused_and_never_silently_short(
    kernel: PatchedKernel, bus: LinuxI2CBus, n: int
) -> None:
    with pytest.raises(ValueError, match=f"cannot read {n} bytes: .* at most 8192"):
        bus.write_read(0x68, b"\x74", n)
    with pytest.raises(ValueError, match=f"cannot write {n} bytes"):
        bus.write(0x68, bytes(n))
    assert kernel.transactions == []


@pytest.mark.parametrize(
    ("number", "kind"),
    [
        (errno.EREMOTEIO, DeviceMissing),
        (errno.ENXIO, DeviceMissing),
        (errno.EBUSY, BusBusy),
        (errno.EACCES, BusPermission),
        (errno.EPERM, BusPermission),
        (errno.ENOENT, DeviceMissing),
        (errno.ENODEV, DeviceMissing),
        (errno.ETIMEDOUT, BusError),
        (errno.EIO, BusError),
        (errno.EOPNOTSUPP, BusError),
    ],
)
def test_a_failed_transfer_is_typed_and_the_bus_is_of_use_afterwards(
    kernel: PatchedKernel, bus: LinuxI2CBus, number: int, kind: type[BusError]
) -> None:
    kernel.fail_with = number
    for transfer in (lambda: bus.write(0x68, b"\x6b\x01"), lambda: bus.write_read(0x68, b"\x6b", 1)):
        with pytest.raises(BusError, match="linux:1") as caught:
            transfer()
        assert type(caught.value) is kind
        assert (caught.value.errno, caught.value.address, caught.value.register) == (number, 0x68, 0x6B)
        assert isinstance(caught.value.__cause__, OSError)
    kernel.fail_with = None
    assert bus.write_read(0x68, b"\x75", 2) == b"\x00\x01"


def test_a_chip_that_a_kernel_driver_holds_is_never_written_to(kernel: PatchedKernel, bus: LinuxI2CBus) -> None:
    """A clock chip at 0x68 with its driver loaded: I2C_RDWR alone would go past the driver."""
    kernel.held = {0x68}
    for _ in range(2):
        with pytest.raises(BusBusy, match="held by a kernel driver"):
            bus.write(0x68, b"\x6b\x80")
    assert kernel.transactions == []


@pytest.mark.parametrize(
    ("number", "kind", "hint"),
    [
        (errno.ENOENT, DeviceMissing, "no bus /dev/i2c-5: enable I2C"),
        (errno.EACCES, BusPermission, "no permission for /dev/i2c-5: add this user to the group i2c"),
        (errno.EPERM, BusPermission, "no permission for /dev/i2c-5"),
        (errno.ENXIO, DeviceMissing, "/dev/i2c-5"),
    ],
)
def test_a_bus_that_cannot_be_opened_says_which_and_why(number: int, kind: type[BusError], hint: str) -> None:
    with kernel_with({"/dev/i2c-5": number}), pytest.raises(BusError) as caught:
        open_linux("5", clock=VirtualClock())
    assert type(caught.value) is kind
    assert (caught.value.errno, caught.value.address) == (number, None)
    assert hint in str(caught.value)


def test_a_device_that_is_no_bus_is_refused_and_not_left_open() -> None:
    with kernel_with({"/dev/i2c-1": None}) as kernel:
        with pytest.raises(BusError, match="/dev/i2c-1 failed \\(ENOTTY\\)"):
            open_linux("1", clock=VirtualClock())
        assert kernel.open_files == {}


def test_the_bus_opened_is_the_one_asked_for() -> None:
    clock = VirtualClock()
    adapters = {f"/dev/i2c-{k}": Adapter({0x68 + k % 2: FakeMpu6050(clock)}) for k in (0, 1, 22)}
    with kernel_with(adapters) as kernel:
        for which, address in (("0", 0x68), ("1", 0x69), ("22", 0x68)):
            with open_linux(which, clock=clock) as bus:
                assert list(kernel.open_files.values()) == [f"/dev/i2c-{which}"]
                assert bus.name == f"linux:{which}"
                assert bus.write_read(address, b"\x75", 1) == b"\x68"
            assert kernel.open_files == {}


@pytest.mark.parametrize("which", ["", "x", "-1", "1.0", " 1", "1\n", "+1", "1_0", "1000", "٣", "/dev/i2c-1", "1:2"])
def test_a_bus_that_is_not_a_number_is_refused_before_anything_is_opened(kernel: PatchedKernel, which: str) -> None:
    with pytest.raises(SettingsError, match="write linux:N"):
        open_linux(which, clock=VirtualClock())
    assert kernel.ioctls == []
