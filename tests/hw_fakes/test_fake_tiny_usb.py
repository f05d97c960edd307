"""The fake as an i2c-tiny-usb, at the level of control transfers, as the kernel's driver makes them."""

from __future__ import annotations

import errno

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hw_fakes import PERFECT, FakeMpu6050
from hw_fakes.ways.tiny_usb import Request, TinyUsb
from hw_fakes.wire.adapter import Adapter
from quavelet.core.clock import VirtualClock

IN, OUT = 0xC1, 0x41  # vendor, interface: as the kernel's driver asks
ECHO, GET_FUNC, SET_DELAY, GET_STATUS, IO, BEGIN, END = 0, 1, 2, 3, 4, 1, 2
ACK, NAK = b"\x01", b"\x02"
READ, DMA_SAFE, NO_START = 0x0001, 0x0200, 0x4000


class Recorder:
    """A chip that tells what happens to it."""

    def __init__(self) -> None:
        self.seen: list[str] = []

    def write(self, data: bytes) -> None:
        self.seen.append(f"write {data.hex()}")

    def read(self, n: int) -> bytes:
        self.seen.append(f"read {n}")
        return bytes(range(1, n + 1))

    def stop(self) -> None:
        self.seen.append("stop")


class Broken(Recorder):
    def write(self, data: bytes) -> None:
        raise RuntimeError(f"not prepared for {data.hex()}")


def ask(device: TinyUsb, number: int, *, value: int = 0, index: int = 0, n: int = 64, kind: int = IN) -> bytes | None:
    return device.control(Request(kind, number, value, index, n))


def write(device: TinyUsb, number: int, address: int, data: bytes, *, flags: int = 0) -> bytes | None:
    return device.control(Request(OUT, number, flags, address, len(data)), data)


def read(device: TinyUsb, number: int, address: int, n: int, *, flags: int = READ) -> bytes | None:
    return device.control(Request(IN, number, flags, address, n))


@pytest.fixture
def device() -> TinyUsb:
    return TinyUsb(Adapter({0x68: FakeMpu6050(VirtualClock(), imperfections=PERFECT)}))


def test_the_kernel_does_not_know_the_device_by_its_descriptors(device: TinyUsb) -> None:
    def descriptor(kind: int, number: int = 0, n: int = 255) -> bytes | None:
        return ask(device, 6, value=kind << 8 | number, n=n, kind=0x80)

    told = descriptor(1)
    assert told is not None
    assert (len(told), told[0], told[1]) == (18, 18, 1)
    # The ids in the table of i2c-tiny-usb.c.
    assert (int.from_bytes(told[8:10], "little"), int.from_bytes(told[10:12], "little")) == (0x0403, 0xC631)
    assert descriptor(1, n=8) == told[:8]
    configuration = descriptor(2)
    assert configuration is not None
    assert int.from_bytes(configuration[2:4], "little") == len(configuration) == configuration[0] + configuration[9]
    assert configuration[9 + 4] == 0  # endpoints besides 0
    names = [descriptor(3, n) for n in range(3)]
    assert names[0] == b"\x04\x03\x09\x04"
    assert [(name or b"")[2:].decode("utf-16-le") for name in names[1:]] == ["hw_fakes", "i2c-tiny-usb"]
    assert all(name is not None and name[0] == len(name) for name in names)
    # No fourth string, no second configuration, and not of high speed (a device qualifier).
    assert [descriptor(3, 3), descriptor(2, 1), descriptor(6)] == [None, None, None]


def test_a_standard_request_of_plugging_in_is_refused(device: TinyUsb) -> None:
    for number in (1, 3, 5, 9, 11):
        assert device.control(Request(0x00, number, 1, 0, 0)) == b""
    assert ask(device, 0, n=2, kind=0x80) == b"\0\0"
    assert ask(device, 8, n=1, kind=0x80) == b"\x01"
    assert ask(device, 10, n=1, kind=0x81) == b"\0"
    assert ask(device, 12, n=2, kind=0x82) is None
    assert device.control(Request(0x00, 7, 0, 0, 0)) is None


def test_the_drivers_commands_are_answered_otherwise(device: TinyUsb) -> None:
    assert ask(device, ECHO, value=0xBEEF, n=2) == b"\xef\xbe"
    assert ask(device, GET_FUNC, n=4) == (0x0EFF0001).to_bytes(4, "little")
    assert device.control(Request(OUT, SET_DELAY, 10, 0, 0)) == b""
    assert ask(device, GET_STATUS, n=1) == b"\0"


def test_a_repeated_start_becomes_a_stop() -> None:
    chip = Recorder()
    device = TinyUsb(Adapter({0x68: chip}))
    assert write(device, IO | BEGIN, 0x68, b"\x3b") == b""
    assert ask(device, GET_STATUS, n=1) == ACK
    assert chip.seen == ["write 3b"]
    assert read(device, IO | END, 0x68, 3) == b"\x01\x02\x03"
    assert ask(device, GET_STATUS, n=1) == ACK
    assert chip.seen == ["write 3b", "read 3", "stop"]
    assert write(device, IO | BEGIN | END, 0x68, b"\x6b\x01") == b""
    assert chip.seen[3:] == ["write 6b01", "stop"]


def test_a_register_reads_otherwise_than_on_the_wires(device: TinyUsb) -> None:
    for data in (b"\x6b\x01", b"\x19\x04\x03"):
        write(device, IO | BEGIN | END, 0x68, data, flags=DMA_SAFE)
    write(device, IO | BEGIN, 0x68, b"\x19", flags=DMA_SAFE)
    assert read(device, IO | END, 0x68, 2, flags=READ | DMA_SAFE) == b"\x04\x03"


@pytest.mark.parametrize("code", [errno.EREMOTEIO, errno.ENXIO])
def test_a_nack_is_no_nack_for_the_kernel(code: int) -> None:
    chip = Recorder()
    device = TinyUsb(Adapter({0x68: chip}, nack_errno=code))
    # The kernel looks at the status only where it got as many bytes as it asked for.
    assert read(device, IO | BEGIN | END, 0x69, 5) == bytes(5)
    assert ask(device, GET_STATUS, n=1) == NAK
    assert write(device, IO | BEGIN | END, 0x69, b"") == b""  # i2cdetect's quick write
    assert ask(device, GET_STATUS, n=1) == NAK
    assert write(device, IO | BEGIN | END, 0x68, b"") == b""
    assert ask(device, GET_STATUS, n=1) == ACK


def test_a_transaction_stays_open_after_a_nack_in_its_middle() -> None:
    chip = Recorder()
    device = TinyUsb(Adapter({0x68: chip}))
    write(device, IO | BEGIN, 0x68, b"\x3b")
    write(device, IO, 0x50, b"\x00")  # the kernel gives up here and sends no message with END
    assert ask(device, GET_STATUS, n=1) == NAK
    assert chip.seen == ["write 3b", "stop"]


def test_a_fault_of_the_fake_is_raised_at_the_kernel(capfd: pytest.CaptureFixture[str]) -> None:
    device = TinyUsb(Adapter({0x68: Broken()}))
    assert write(device, IO | BEGIN | END, 0x68, b"\x01") is None
    assert "hw_fakes: the control transfer stalls: RuntimeError('not prepared for 01')" in capfd.readouterr().err


def test_a_malformed_request_reaches_the_chip() -> None:
    chip = Recorder()
    device = TinyUsb(Adapter({0x68: chip}))
    assert read(device, IO | BEGIN | END, 0x68, 1, flags=0) is None  # reads, and says that it writes
    assert write(device, IO | BEGIN | END, 0x68, b"\0", flags=READ) is None
    assert write(device, IO | BEGIN | END, 0x68, b"\0", flags=NO_START) is None
    assert device.control(Request(OUT, IO, 0, 0x68, 2), b"\0") is None  # a byte too few
    assert device.control(Request(IN, IO, READ, 0x68, 2), b"\0") is None
    assert ask(device, IO | BEGIN | END, index=0x68, value=READ, n=1, kind=0xA1) is None  # of a class, not a vendor's
    assert device.control(Request(OUT, ECHO, 0, 0, 0)) is None
    assert ask(device, SET_DELAY) is None
    assert chip.seen == []


@given(
    kind=st.integers(0, 255),
    number=st.integers(0, 255),
    value=st.integers(0, 0xFFFF),
    index=st.sampled_from([0, 0x68, 0x80, 0xFFFF]),
    data=st.binary(max_size=20),
    length=st.none() | st.integers(0, 0xFFFF),
)
def test_a_request_raises_or_gets_more_than_it_asked_for(
    kind: int, number: int, value: int, index: int, data: bytes, length: int | None
) -> None:
    device = TinyUsb(Adapter({0x68: Recorder()}))
    request = Request(kind, number, value, index, len(data) if length is None else length)
    answer = device.control(request, b"" if request.reads else data)
    assert answer is None or len(answer) <= (request.length if request.reads else 0)
