"""UDP: one payload is one datagram, to one, to all or to a group; a network that is away is counted, not fatal."""

import socket
import struct

import pytest
from network_rig import BOUND_S, network, until

from quavelet.sinks.message import Message
from quavelet.sinks.outputs import ENCODINGS

IP_RECVTTL = 12
"""Of linux/in.h; Python has no name for it."""


def receiver(family: socket.AddressFamily, host: str) -> socket.socket:
    sock = socket.socket(family, socket.SOCK_DGRAM)
    sock.settimeout(BOUND_S)
    sock.bind((host, 0))
    return sock


@pytest.mark.parametrize(
    ("family", "host"), [(socket.AF_INET, "127.0.0.1"), (socket.AF_INET6, "::1")], ids=["IPv4", "IPv6"]
)
def test_each_message_is_one_datagram(family: socket.AddressFamily, host: str) -> None:
    with receiver(family, host) as sock, network() as rig:
        where = f"[{host}]" if ":" in host else host
        output = rig.output(f"udp:{where}:{sock.getsockname()[1]}")
        rig.send(0, 10)
        lines = [sock.recv(65_536) for _ in range(10)]
        assert all(line.count(b"\n") == 1 and line.endswith(b"}\n") for line in lines)
        until(lambda: rig.status(output).sent == 10)
        assert rig.status(output).lost == 0


def test_a_broadcast_goes_to_all() -> None:
    with receiver(socket.AF_INET, "") as sock, network() as rig:
        rig.output(f"udp:127.255.255.255:{sock.getsockname()[1]}")
        rig.send(0, 1)
        assert sock.recv(65_536).startswith(b'{"v":1')


def test_a_group_gets_it_and_no_router_passes_it_on() -> None:
    group = "239.255.68.68"
    with receiver(socket.AF_INET, "") as sock, network() as rig:
        # Joined where the route goes, and heard there by this machine too.
        member = struct.pack("=4s4s", socket.inet_aton(group), socket.inet_aton("0.0.0.0"))
        try:
            sock.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, member)
        except OSError as error:
            pytest.skip(f"this machine has no route for multicast: {error}")
        sock.setsockopt(socket.IPPROTO_IP, IP_RECVTTL, 1)
        rig.output(f"udp:{group}:{sock.getsockname()[1]}")
        rig.send(0, 1)
        data, said, _, _ = sock.recvmsg(65_536, 64)
        assert data.startswith(b'{"v":1')
        assert [struct.unpack("i", value)[0] for _, kind, value in said if kind == socket.IP_TTL] == [1]


def test_a_datagram_that_the_kernel_does_not_take_is_counted_and_nothing_else(monkeypatch: pytest.MonkeyPatch) -> None:
    class Huge:
        def encode(self, message: Message) -> bytes:
            del message
            return bytes(70_000)

    monkeypatch.setitem(ENCODINGS, "nmea", lambda _: Huge())
    with network() as rig:
        output = rig.output("udp:127.0.0.1:9", encoding="nmea")
        rig.send(0, 5)
        until(lambda: rig.status(output).lost == 5)
        assert rig.status(output).state == "cannot send to 127.0.0.1:9: Message too long"
        assert rig.said == []
