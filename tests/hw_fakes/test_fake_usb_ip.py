"""The fake plugged into a kernel by USB/IP; the kernel's end is played here, packet by packet."""

from __future__ import annotations

import errno
import os
import socket
import struct
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest

from hw_fakes import PERFECT, FakeMpu6050
from hw_fakes.ways import usb_ip
from hw_fakes.ways.tiny_usb import TinyUsb
from hw_fakes.ways.usb_ip import attached_usbip, bus_id, free_port, serve
from hw_fakes.wire.adapter import Adapter
from quavelet.core.clock import VirtualClock
from quavelet.core.errors import SettingsError

# As Linux 6.1 has it, with a device plugged into the first port and one just being plugged into the second.
STATUS = """hub port sta spd dev      sockfd local_busid
hs  0000 006 002 00010001 000003 1-1
hs  0001 005 002 00010001 000004 0-0
hs  0002 004 000 00000000 000000 0-0
ss  0003 004 000 00000000 000000 0-0
"""


class Kernel:
    """The other end of the connection, in the words of usbip_protocol.rst."""

    def __init__(self, end: socket.socket) -> None:
        self.end = end
        self.number = 0

    def send(self, command: int, direction: int, endpoint: int, rest: bytes, data: bytes = b"") -> None:
        self.number += 1
        self.end.sendall(struct.pack(">5I", command, self.number, 0x10001, direction, endpoint) + rest + data)

    def receive(self, n: int) -> bytes:
        got = b""
        while len(got) < n:
            part = self.end.recv(n - len(got))
            assert part, "the connection is closed"
            got += part
        return got

    def submit(
        self, kind: int, request: int, value: int, index: int, n: int, *, data: bytes | None = None, endpoint: int = 0
    ) -> tuple[int, bytes]:
        """Status and data of a transfer; it writes `data` or reads up to `n` bytes."""
        setup = struct.pack("<BBHHH", kind, request, value, index, n)
        rest = struct.pack(">5I", 0, n, 0, 0, 0) + setup
        self.send(1, 0 if data is not None else 1, endpoint, rest, data or b"")
        head = self.receive(48)
        command, number, devid, direction, ep, status, actual = struct.unpack_from(">5Iii", head)
        assert (command, number, devid, direction, ep) == (3, self.number, 0, 0, 0)
        if data is not None:
            assert actual == (len(data) if status == 0 else 0)
            return status, b""
        return status, self.receive(actual)


@pytest.fixture
def kernel() -> Iterator[Kernel]:
    adapter = Adapter({0x68: FakeMpu6050(VirtualClock(), imperfections=PERFECT)})
    ours, theirs = socket.socketpair()
    with ours, theirs:
        theirs.settimeout(10)
        thread = threading.Thread(target=serve, args=(ours, TinyUsb(adapter)))
        thread.start()
        yield Kernel(theirs)
        theirs.close()
        thread.join(10)
        assert not thread.is_alive()


def test_the_kernel_reads_another_register_than_it_wrote(kernel: Kernel) -> None:
    assert kernel.submit(0x41, 4 | 3, 0, 0x68, 2, data=b"\x6b\x01") == (0, b"")
    assert kernel.submit(0x41, 4 | 3, 0, 0x68, 4, data=b"\x19\x04\x03\x18") == (0, b"")
    assert kernel.submit(0x41, 4 | 1, 0, 0x68, 1, data=b"\x19") == (0, b"")
    assert kernel.submit(0xC1, 4 | 2, 1, 0x68, 3) == (0, b"\x04\x03\x18")
    assert kernel.submit(0xC1, 3, 0, 0, 1) == (0, b"\x01")


def test_more_comes_than_there_is(kernel: Kernel) -> None:
    assert kernel.submit(0x80, 6, 0x0100, 0, 64)[1][:2] == b"\x12\x01"
    assert len(kernel.submit(0x80, 6, 0x0100, 0, 64)[1]) == 18
    assert len(kernel.submit(0x80, 6, 0x0100, 0, 8)[1]) == 8


def test_a_stall_is_another_error(kernel: Kernel) -> None:
    assert kernel.submit(0x80, 6, 0x0600, 0, 10) == (-errno.EPIPE, b"")
    assert kernel.submit(0x41, 4, 1, 0x68, 1, data=b"\x19") == (-errno.EPIPE, b"")
    assert kernel.submit(0xC1, 1, 0, 0, 4, endpoint=1) == (-errno.EPIPE, b"")
    assert kernel.submit(0xC1, 1, 0, 0, 4) == (0, (0x0EFF0001).to_bytes(4, "little"))


def test_the_kernel_waits_for_a_transfer_it_takes_back(kernel: Kernel) -> None:
    kernel.send(2, 0, 0, struct.pack(">I24x", 1))
    assert struct.unpack_from(">5Ii", kernel.receive(48)) == (4, 1, 0, 0, 0, 0)
    assert kernel.submit(0xC1, 0, 7, 0, 2) == (0, b"\x07\0")


def test_a_packet_that_is_none_is_served(kernel: Kernel, capfd: pytest.CaptureFixture[str]) -> None:
    kernel.send(9, 0, 0, bytes(28))
    kernel.end.shutdown(socket.SHUT_WR)
    assert kernel.end.recv(1) == b""
    assert "USB/IP command 9 is none" in capfd.readouterr().err


@pytest.mark.parametrize("after", [0, 20, 48])
def test_the_kernel_goes_in_the_middle_of_a_packet(kernel: Kernel, after: int) -> None:
    packet = (
        struct.pack(">5I", 1, 1, 0, 0, 0)
        + struct.pack(">5I", 0, 9, 0, 0, 0)
        + struct.pack("<BBHHH", 0x41, 7, 0, 0x68, 9)
    )
    kernel.end.sendall(packet[:after])
    kernel.end.close()  # the fixture sees that nobody waits for the rest


def test_a_port_that_is_taken_is_taken_again() -> None:
    assert free_port(STATUS) == 2
    assert free_port(STATUS.replace("0002 004", "0002 006")) is None
    assert [bus_id(STATUS, port) for port in range(3)] == ["1-1", None, None]


@pytest.fixture
def system(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A /sys of which the controller is there, free, and of which nothing ever comes."""
    controller = tmp_path / "vhci_hcd.0"
    controller.mkdir()
    (controller / "status").write_text(STATUS)
    monkeypatch.setattr(usb_ip, "CONTROLLER", controller)
    monkeypatch.setattr(usb_ip, "USB", tmp_path)
    monkeypatch.setattr(usb_ip, "WAIT_S", 0.1)
    return tmp_path


def refusal() -> str:
    with pytest.raises(SettingsError) as refused, attached_usbip(Adapter()):
        raise AssertionError("it is plugged in")
    return str(refused.value)


def test_a_kernel_without_the_module_is_not_told_of(system: Path) -> None:
    (system / "vhci_hcd.0/status").unlink()
    (system / "vhci_hcd.0").rmdir()
    assert refusal() == (
        "this kernel has no USB/IP to plug the fake into: modprobe -a vhci-hcd i2c-tiny-usb i2c-dev, as root"
    )


def test_full_ports_are_not_told_of(system: Path) -> None:
    (system / "vhci_hcd.0/status").write_text(STATUS.replace(" 004 ", " 006 "))
    assert refusal() == "all ports of vhci_hcd.0 are taken: see `usbip port`, and detach one"


@pytest.mark.usefixtures("system")
def test_a_user_who_is_not_root_sees_a_traceback(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(path: Path, _text: str) -> int:
        raise PermissionError(errno.EACCES, os.strerror(errno.EACCES), str(path))

    monkeypatch.setattr(Path, "write_text", refuse)
    assert refusal() == "only root can plug the fake into the kernel: use sudo"


def test_an_adapter_that_never_comes_is_waited_for(system: Path) -> None:
    assert refusal() == (
        "the kernel makes no /dev/i2c-N of the fake (not loaded: i2c-tiny-usb, i2c-dev): "
        "modprobe -a vhci-hcd i2c-tiny-usb i2c-dev, as root"
    )
    port, handle, device, speed = (system / "vhci_hcd.0/attach").read_text().split()
    assert (port, int(handle) > 2, device, speed) == ("2", True, "65537", "2")
    assert (system / "vhci_hcd.0/detach").read_text() == "2"


def test_the_number_is_that_of_another_adapter(system: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (system / "vhci_hcd.0/status").write_text(
        STATUS.replace("0002 004 000 00000000 000000 0-0", "0002 004 000 0 0 1-3")
    )
    for name in ("i2c-3", "i2c-12"):
        (system / name).touch()
    for place in ("devices/1-1/1-1:1.0/i2c-3", "devices/1-3/1-3:1.0/i2c-12"):
        (system / place).mkdir(parents=True)
    monkeypatch.setattr(usb_ip, "DEV", system)
    with attached_usbip(Adapter()) as number:
        assert number == 12
