"""The adapter under all ways in: what goes over the wires for each call of the kernel's, and what comes back."""

from __future__ import annotations

import errno
from pathlib import Path

import pytest

import hw_fakes
from hw_fakes import PERFECT, FakeMpu6050, Nack
from hw_fakes.ways.i2c_dev import I2C_FUNCS, I2C_PEC, I2C_SLAVE, I2C_TIMEOUT, OpenDevice
from hw_fakes.wire.adapter import READ, Adapter, Size, union_length
from quavelet.core.clock import VirtualClock


class Listener:
    """Answers with 1, 2, 3... and keeps what it was told."""

    def __init__(self) -> None:
        self.heard: list[str] = []

    def write(self, data: bytes) -> None:
        self.heard.append("w " + data.hex())

    def read(self, n: int) -> bytes:
        self.heard.append(f"r {n}")
        return bytes(i % 256 for i in range(1, n + 1))

    def stop(self) -> None:
        self.heard.append("stop")


class Silent(Listener):
    def read(self, n: int) -> bytes:
        raise Nack(n)


@pytest.mark.parametrize(
    ("read", "size", "data", "heard", "answer"),
    [
        (False, Size.QUICK, b"", ["w "], b""),
        (True, Size.QUICK, b"", ["r 0"], b""),
        (False, Size.BYTE, b"", ["w 6b"], b""),
        (True, Size.BYTE, b"\0", ["r 1"], b"\1"),
        (False, Size.BYTE_DATA, b"\x80", ["w 6b80"], b""),
        (True, Size.BYTE_DATA, b"\0", ["w 6b", "r 1"], b"\1"),
        (False, Size.WORD_DATA, b"\x34\x12", ["w 6b3412"], b""),
        (True, Size.WORD_DATA, b"\0\0", ["w 6b", "r 2"], b"\1\2"),
        (False, Size.PROC_CALL, b"\x34\x12", ["w 6b3412", "r 2"], b"\1\2"),
        (False, Size.BLOCK_DATA, b"\2\xaa\xbb" + bytes(31), ["w 6b02aabb"], b""),
        (False, Size.I2C_BLOCK_DATA, b"\2\xaa\xbb" + bytes(31), ["w 6baabb"], b""),
        (True, Size.I2C_BLOCK_DATA, b"\3" + bytes(33), ["w 6b", "r 3"], b"\3\1\2\3"),
        (True, Size.I2C_BLOCK_BROKEN, b"\3" + bytes(33), ["w 6b", "r 32"], b"\x20" + bytes(range(1, 33))),
    ],
)
def test_an_smbus_call_is_other_messages_than_the_kernels(
    read: bool, size: Size, data: bytes, heard: list[str], answer: bytes
) -> None:
    chip = Listener()
    adapter = Adapter({0x68: chip})
    assert len(data) == union_length(read=read, size=size)
    assert adapter.smbus(0x68, read=read, command=0x6B, size=size, data=data) == answer
    assert chip.heard == [*heard, "stop"]


@pytest.mark.parametrize(
    ("read", "size", "length", "code"),
    [
        (True, Size.I2C_BLOCK_DATA, 33, errno.EINVAL),
        (False, Size.I2C_BLOCK_DATA, 33, errno.EINVAL),
        (False, Size.BLOCK_DATA, 33, errno.EINVAL),
        (True, Size.BLOCK_DATA, 1, errno.EOPNOTSUPP),
        (False, Size.BLOCK_PROC_CALL, 1, errno.EOPNOTSUPP),
        (True, 9, 1, errno.EINVAL),
    ],
)
def test_a_call_the_kernel_refuses_reaches_the_chip(read: bool, size: int, length: int, code: int) -> None:
    chip = Listener()
    with pytest.raises(OSError) as refused:
        Adapter({0x68: chip}).smbus(0x68, read=read, command=0, size=size, data=bytes([length]) + bytes(33))
    assert refused.value.errno == code
    assert chip.heard == []


@pytest.mark.parametrize("code", [errno.EREMOTEIO, errno.ENXIO])
def test_a_missing_acknowledge_is_told_by_another_errno(code: int) -> None:
    chip = Silent()
    adapter = Adapter({0x68: chip}, nack_errno=code)
    for messages in ([(0x69, 0, b"\0")], [(0x68, 0, b"\0"), (0x68, READ, 1)]):
        with pytest.raises(OSError) as missing:
            adapter.transfer(messages)
        assert missing.value.errno == code
    assert chip.heard == ["w 00", "stop"]


def test_chips_answer_for_each_other() -> None:
    one, other = Listener(), Listener()
    adapter = Adapter({0x68: one, 0x69: other})
    assert adapter.transfer([(0x68, 0, b"\x10"), (0x69, READ, 2), (0x68, READ, 1)]) == [b"", b"\1\2", b"\1"]
    assert (one.heard, other.heard) == (["w 10", "r 1", "stop"], ["r 2", "stop"])


def test_two_chips_at_one_address_go_unnoticed() -> None:
    adapter = Adapter({0x68: Listener()})
    with pytest.raises(ValueError, match="two chips at 0x68: pull AD0"):
        adapter.attach(0x68, Listener())
    with pytest.raises(ValueError, match="0x03 is no address"):
        adapter.attach(0x03, Listener())


def test_a_flag_that_is_not_modelled_is_passed_over() -> None:
    with pytest.raises(OSError) as refused:
        Adapter({0x68: Listener()}).transfer([(0x68, READ | 0x4000, 1)])
    assert refused.value.errno == errno.EOPNOTSUPP


def test_a_virtual_clock_stands_still_on_the_wire() -> None:
    clock = VirtualClock()
    adapter = Adapter({0x68: FakeMpu6050(clock, imperfections=PERFECT)}, clock=clock, speed_hz=100_000)
    assert adapter.smbus(0x68, read=True, command=0x75, size=Size.BYTE_DATA, data=b"\0") == b"\x68"
    assert clock.now_ns() == (1 + 9 + 9 + 1 + 9 + 9 + 1) * 10_000


def test_an_open_device_forgets_its_address() -> None:
    chip = Listener()
    device = OpenDevice(Adapter({0x68: chip}))
    device.control(I2C_SLAVE, 0x68)
    assert device.write(b"\x3b") == 1
    assert device.read(2) == b"\1\2"
    assert chip.heard == ["w 3b", "stop", "r 2", "stop"]
    assert device.control(I2C_FUNCS, 0) == 0x0EFF0001
    assert device.control(I2C_TIMEOUT, 10) == 0


@pytest.mark.parametrize(
    ("request_", "argument", "code"),
    [(I2C_SLAVE, 0x80, errno.EINVAL), (I2C_PEC, 1, errno.EOPNOTSUPP), (0x5401, 0, errno.ENOTTY)],
)
def test_a_control_the_kernel_refuses_is_taken(request_: int, argument: int, code: int) -> None:
    with pytest.raises(OSError) as refused:
        OpenDevice(Adapter()).control(request_, argument)
    assert refused.value.errno == code


def test_more_messages_or_bytes_than_the_kernel_takes_go_through() -> None:
    device = OpenDevice(Adapter({0x68: Listener()}))
    device.transfer([(0x68, READ, 8192)] * 42)
    for messages in ([], [(0x68, READ, 1)] * 43, [(0x68, READ, 8193)]):
        with pytest.raises(OSError) as refused:
            device.transfer(messages)
        assert refused.value.errno == errno.EINVAL


def test_the_pages_example_under_smbus2_fails() -> None:
    page = Path(hw_fakes.__file__).with_name("README.md").read_text(encoding="utf-8")
    (example,) = [part for part in page.split("```python\n")[1:] if "patched_smbus2" in part.split("```")[0]]
    exec(example.split("```")[0], {})
