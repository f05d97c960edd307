"""A TCP port that programs anywhere read from: whoever reaches it may read."""

from __future__ import annotations

import asyncio
import socket

from quavelet.sinks.plan import OutputPlan
from quavelet.sinks.transport import TransportStats
from quavelet.sinks.transports.readers import KERNEL_BYTES, Reader, Readers, stop

GONE_MS = 60_000
"""A reader that has taken nothing for so long, or does not answer, is taken to be gone: its place is another's."""


class TcpTransport:
    """Listens on an address of this machine; "0.0.0.0" is all of IPv4, "::" all of both."""

    def __init__(self, plan: OutputPlan) -> None:
        destination = plan.settings.destination
        self._host, self._port = destination.host, destination.port
        self._readers = Readers(plan.settings.readers)
        self._server: asyncio.Server | None = None
        self._state = "closed"

    async def open(self) -> None:
        self._readers.open()
        loop = asyncio.get_running_loop()
        if self._host == "::":
            # asyncio would leave IPv4 out.
            both = socket.create_server(("::", self._port), family=socket.AF_INET6, dualstack_ipv6=True)
            self._server = await loop.create_server(self._reader, sock=both)
        else:
            self._server = await loop.create_server(self._reader, self._host, self._port)
        for sock in self._server.sockets:
            # What is accepted has these from the socket that listens.
            sock.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, KERNEL_BYTES)
            sock.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
            sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_KEEPIDLE, GONE_MS // 2000)
            sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT, GONE_MS)
        self._state = "listening on " + ", ".join(_shown(sock.getsockname()) for sock in self._server.sockets)

    def send(self, payload: bytes) -> None:
        self._readers.send(payload)

    async def close(self) -> None:
        if self._server is not None:
            server, self._server = self._server, None
            await stop(server)
        self._state = "closed"
        await self._readers.close()

    def stats(self) -> TransportStats:
        return self._readers.stats(self._state)

    def _reader(self) -> Reader:
        return Reader(self._readers)


def _shown(address: tuple[str, int]) -> str:
    host, port = address[:2]
    return f"[{host}]:{port}" if ":" in host else f"{host}:{port}"
