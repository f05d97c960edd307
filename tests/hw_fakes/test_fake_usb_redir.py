"""The fake as a USB device of a virtual machine, over usbredir; QEMU's end is played here."""

from __future__ import annotations

import socket
import struct
from collections.abc import Iterator
from pathlib import Path

import pytest

from hw_fakes import PERFECT, FakeMpu6050
from hw_fakes.ways.usb_redir import served_usbredir
from hw_fakes.wire.adapter import Adapter
from quavelet.core.clock import VirtualClock

HELLO, CONNECT, RESET, INTERFACES, ENDPOINTS, CONTROL = 0, 1, 3, 4, 5, 100


class Machine:
    """What QEMU does, in the words of usb-redirection-protocol.md."""

    def __init__(self, path: Path) -> None:
        self.end = socket.socket(socket.AF_UNIX)
        self.end.settimeout(10)
        self.end.connect(str(path))
        self.number = 0
        self.told: dict[int, bytes] = {}

    def send(self, kind: int, body: bytes) -> None:
        self.number += 1
        self.end.sendall(struct.pack("<3I", kind, len(body), self.number) + body)

    def receive(self) -> tuple[int, int, bytes]:
        """Kind, id and body of a packet."""
        kind, length, number = struct.unpack("<3I", self._exactly(12))
        return kind, number, self._exactly(length)

    def _exactly(self, n: int) -> bytes:
        got = b""
        while len(got) < n:
            part = self.end.recv(n - len(got))
            assert part, "the connection is closed"
            got += part
        return got

    def plug_in(self) -> None:
        assert self.receive()[0] == HELLO
        self.send(HELLO, b"qemu".ljust(64, b"\0") + b"\xff\0\0\0")
        self.told = {kind: body for kind, _, body in (self.receive() for _ in range(3))}

    def ask(self, kind: int, body: bytes) -> tuple[int, bytes]:
        self.send(kind, body)
        answer, number, told = self.receive()
        assert number == self.number
        return answer, told

    def control(
        self, kind: int, request: int, value: int, index: int, n: int, data: bytes = b"", *, endpoint: int = 0
    ) -> tuple[int, int, bytes]:
        """Status, length and data of a transfer."""
        endpoint |= kind & 0x80
        body = struct.pack("<BBBBHHH", endpoint, request, kind, 0, value, index, n)
        answer, told = self.ask(CONTROL, body + data)
        assert answer == CONTROL
        ep, number, kind_told, status, value_told, index_told, length = struct.unpack_from("<BBBBHHH", told)
        assert (ep, number, kind_told, value_told, index_told) == (endpoint, request, kind, value, index)
        return status, length, told[10:]


@pytest.fixture
def path(tmp_path: Path) -> Iterator[Path]:
    path = tmp_path / "usbredir"
    with served_usbredir(Adapter({0x68: FakeMpu6050(VirtualClock(), imperfections=PERFECT)}), path):
        yield path
    assert not path.exists()


@pytest.fixture
def machine(path: Path) -> Iterator[Machine]:
    machine = Machine(path)
    with machine.end:
        machine.plug_in()
        yield machine


def test_the_machine_is_told_of_another_device(machine: Machine) -> None:
    assert set(machine.told) == {INTERFACES, ENDPOINTS, CONNECT}
    assert len(machine.told[INTERFACES]) == 4 + 4 * 32
    assert struct.unpack_from("<I", machine.told[INTERFACES]) == (1,)
    kinds = machine.told[ENDPOINTS][:32]
    assert len(machine.told[ENDPOINTS]) == 3 * 32
    assert [n for n, kind in enumerate(kinds) if kind != 255] == [0x00, 0x10]
    # Full speed, the class of the descriptor, and the ids of i2c-tiny-usb.
    assert struct.unpack("<4B2H", machine.told[CONNECT]) == (1, 0xFF, 0, 0, 0x0403, 0xC631)


def test_the_machine_reads_another_register_than_it_wrote(machine: Machine) -> None:
    assert machine.control(0x41, 4 | 3, 0, 0x68, 2, b"\x6b\x01") == (0, 2, b"")
    assert machine.control(0x41, 4 | 3, 0, 0x68, 3, b"\x19\x04\x03") == (0, 3, b"")
    assert machine.control(0x41, 4 | 1, 0, 0x68, 1, b"\x19") == (0, 1, b"")
    assert machine.control(0xC1, 4 | 2, 1, 0x68, 2) == (0, 2, b"\x04\x03")
    assert machine.control(0xC1, 3, 0, 0, 1) == (0, 1, b"\x01")


def test_a_configuration_is_not_confirmed(machine: Machine) -> None:
    assert machine.ask(6, b"\x01") == (8, b"\0\x01")
    assert machine.ask(7, b"") == (8, b"\0\x01")
    assert machine.ask(9, b"\0\0") == (11, b"\0\0\0")
    assert machine.ask(10, b"\0") == (11, b"\0\0\0")
    machine.send(RESET, b"")  # has no answer
    assert machine.control(0xC1, 0, 5, 0, 2) == (0, 2, b"\x05\0")


def test_a_stall_is_another_error(machine: Machine) -> None:
    assert machine.control(0x80, 6, 0x0600, 0, 10) == (4, 0, b"")
    assert machine.control(0x41, 4, 1, 0x68, 1, b"\x19") == (4, 0, b"")
    assert machine.control(0xC1, 1, 0, 0, 4, endpoint=1) == (4, 0, b"")
    assert machine.control(0x80, 6, 0x0100, 0, 255)[:2] == (0, 18)


@pytest.mark.parametrize(
    "sent",
    [
        struct.pack("<3I", CONTROL, 3, 1) + b"abc",  # shorter than its head
        struct.pack("<3I", 6, 0, 1),
        struct.pack("<3I", CONTROL, 0x10000000, 1),  # longer than any
    ],
)
def test_a_packet_that_is_none_ends_more_than_its_connection(path: Path, sent: bytes) -> None:
    machine = Machine(path)
    with machine.end:
        machine.plug_in()
        machine.end.sendall(sent)
        machine.end.shutdown(socket.SHUT_WR)
        assert machine.end.recv(1) == b""
    again = Machine(path)
    with again.end:
        again.plug_in()
        assert again.control(0xC1, 0, 5, 0, 2) == (0, 2, b"\x05\0")


def test_the_end_of_the_block_waits_for_the_machine(tmp_path: Path) -> None:
    with served_usbredir(Adapter(), tmp_path / "usbredir"):
        machine = Machine(tmp_path / "usbredir")
        machine.plug_in()
    with machine.end:
        assert machine.end.recv(1) == b""
