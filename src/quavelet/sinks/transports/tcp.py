"""A TCP port that programs anywhere read from: whoever reaches it may read."""

from __future__ import annotations

import socket

from quavelet.sinks.listener import Listener, tcp_sockets
from quavelet.sinks.plan import OutputPlan
from quavelet.sinks.transport import TransportStats
from quavelet.sinks.transports.readers import KERNEL_BYTES, Reader, Readers

GONE_MS = 60_000
"""A reader that has taken nothing for so long, or does not answer, is taken to be gone: its place is another's."""


class TcpTransport:
    """Listens on an address of this machine; "0.0.0.0" is all of IPv4, "::" all of both."""

    def __init__(self, plan: OutputPlan) -> None:
        destination = plan.settings.destination
        self._host, self._port = destination.host, destination.port
        self._readers = Readers(plan.settings.readers)
        self._listener: Listener | None = None

    async def open(self) -> None:
        self._readers.open()
        sockets = await tcp_sockets(self._host, self._port)
        for sock in sockets:
            # What is accepted has these from the socket that listens.
            sock.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, KERNEL_BYTES)
            sock.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
            sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_KEEPIDLE, GONE_MS // 2000)
            sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT, GONE_MS)
        places = ", ".join(_shown(sock.getsockname()) for sock in sockets)
        self._listener = Listener(places, sockets, lambda: Reader(self._readers))

    def send(self, payload: bytes) -> None:
        self._readers.send(payload)

    async def close(self) -> None:
        if self._listener is not None:
            listener, self._listener = self._listener, None
            await listener.close()
        await self._readers.close()

    def stats(self) -> TransportStats:
        return self._readers.stats("closed" if self._listener is None else self._listener.state)


def _shown(address: tuple[str, int]) -> str:
    host, port = address[:2]
    return f"[{host}]:{port}" if ":" in host else f"{host}:{port}"
