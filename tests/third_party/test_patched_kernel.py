"""The kernel under smbus2: what it refuses, and what it remembers."""

from __future__ import annotations

import errno
import os
from collections.abc import Callable, Iterator

import pytest
import smbus2

from hw_fakes import PERFECT, FakeMpu6050
from hw_fakes.ways.i2c_dev import I2C_FUNCS, I2C_RDWR, I2C_SLAVE, I2C_SLAVE_FORCE, I2C_SMBUS
from hw_fakes.ways.in_process import PatchedKernel
from hw_fakes.wire.adapter import Adapter
from quavelet.core.clock import VirtualClock


@pytest.fixture
def adapter() -> Adapter:
    return Adapter({0x68: FakeMpu6050(VirtualClock(), imperfections=PERFECT)})


@pytest.fixture
def kernel(adapter: Adapter) -> Iterator[PatchedKernel]:
    devices = {"/dev/i2c-1": adapter, "/dev/i2c-2": errno.EACCES, "/dev/i2c-3": None}
    with PatchedKernel(devices).installed() as kernel:
        yield kernel


def who_am_i(bus: smbus2.SMBus) -> int:
    answer = smbus2.i2c_msg.read(0x68, 1)
    bus.i2c_rdwr(smbus2.i2c_msg.write(0x68, [0x75]), answer)
    return bytes(answer)[0]


def errno_of(call: Callable[[], object]) -> int | None:
    with pytest.raises(OSError) as caught:
        call()
    return caught.value.errno


def test_a_chip_held_by_a_driver_is_read_unless_by_force(kernel: PatchedKernel, adapter: Adapter) -> None:
    kernel.held.add(0x68)
    with smbus2.SMBus(1) as bus:
        assert errno_of(lambda: bus.read_byte_data(0x68, 0x75)) == errno.EBUSY
        assert adapter.transfers == 0
        assert bus.read_byte_data(0x68, 0x75, force=True) == 0x68
        assert who_am_i(bus) == 0x68  # I2C_RDWR goes past the driver


@pytest.mark.parametrize(("path", "code"), [(2, errno.EACCES), (3, errno.ENOTTY), (4, errno.ENOENT)])
def test_a_device_is_refused_for_another_reason(kernel: PatchedKernel, path: int, code: int) -> None:
    assert errno_of(lambda: smbus2.SMBus(path)) == code
    assert kernel.ioctls == ([I2C_FUNCS] if code == errno.ENOTTY else [])


def test_a_failing_transfer_reaches_the_chip(kernel: PatchedKernel, adapter: Adapter) -> None:
    with smbus2.SMBus(1) as bus:
        kernel.fail_with = errno.ETIMEDOUT
        assert errno_of(lambda: bus.read_byte_data(0x68, 0x75)) == errno.ETIMEDOUT
        assert errno_of(lambda: who_am_i(bus)) == errno.ETIMEDOUT
        assert adapter.transfers == 0
        kernel.fail_with = None
        assert bus.read_byte_data(0x68, 0x75) == who_am_i(bus) == 0x68


def test_what_was_asked_is_forgotten(kernel: PatchedKernel) -> None:
    with smbus2.SMBus(1) as bus:
        assert list(kernel.open_files.values()) == ["/dev/i2c-1"]
        bus.read_byte_data(0x68, 0x75)
        bus.read_byte_data(0x68, 0x75)
        bus.read_byte_data(0x68, 0x75, force=True)
        who_am_i(bus)
    assert kernel.open_files == {}
    assert kernel.ioctls == [I2C_FUNCS, I2C_SLAVE, I2C_SMBUS, I2C_SMBUS, I2C_SLAVE_FORCE, I2C_SMBUS, I2C_RDWR]
    assert kernel.transactions == [[(0x68, "write", 1), (0x68, "read", 1)]]


def test_a_file_left_open_reaches_the_chip_after_the_block(adapter: Adapter) -> None:
    with PatchedKernel({"/dev/i2c-1": adapter}).installed():
        bus = smbus2.SMBus(1)
    assert errno_of(lambda: bus.read_byte_data(0x68, 0x75)) == errno.ENOTTY  # /dev/null knows no I2C
    fd = bus.fd
    bus.close()
    assert fd is not None
    assert errno_of(lambda: os.fstat(fd)) == errno.EBADF
