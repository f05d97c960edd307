"""Datagrams to one address, to all of a network (broadcast), or to who has joined a group (multicast)."""

from __future__ import annotations

import asyncio
import socket

from quavelet.sinks.plan import OutputPlan
from quavelet.sinks.transport import TransportStats

HOPS = 1
"""Multicast stays within the local network."""


class UdpTransport:
    """One payload is one datagram. A network that is away is no failure: the datagram is lost and counted."""

    def __init__(self, plan: OutputPlan) -> None:
        destination = plan.settings.destination
        self._to = plan.settings.to.removeprefix("udp:")
        self._host, self._port = destination.host, destination.port
        self._socket: socket.socket | None = None
        self._address: tuple[str | int | bytes, ...] = ()
        self._trouble = ""
        self._sent = 0
        self._lost = 0
        self._bytes = 0

    async def open(self) -> None:
        loop = asyncio.get_running_loop()
        found = await loop.getaddrinfo(self._host, self._port, type=socket.SOCK_DGRAM)
        family, _, _, _, self._address = found[0]
        sock = socket.socket(family, socket.SOCK_DGRAM)
        sock.setblocking(False)
        if family == socket.AF_INET6:
            sock.setsockopt(socket.IPPROTO_IPV6, socket.IPV6_MULTICAST_HOPS, HOPS)
        else:
            sock.setsockopt(socket.SOL_SOCKET, socket.SO_BROADCAST, 1)
            sock.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_TTL, HOPS)
        self._socket = sock

    def send(self, payload: bytes) -> None:
        if self._socket is None:
            return
        try:
            self._socket.sendto(payload, self._address)
        except OSError as error:
            self._lost += 1
            self._trouble = error.strerror or str(error)
        else:
            self._sent += 1
            self._bytes += len(payload)
            self._trouble = ""

    async def close(self) -> None:
        if self._socket is not None:
            self._socket.close()
            self._socket = None

    def stats(self) -> TransportStats:
        state = "closed" if self._socket is None else f"sending to {self._to}"
        if self._socket is not None and self._trouble:
            state = f"cannot send to {self._to}: {self._trouble}"
        return TransportStats(state=state, sent=self._sent, lost=self._lost, bytes=self._bytes)
