"""Sockets that listen, and the one rule for all of them: after each connection they rest.

A flood of connections, however great, costs what 50 a second cost. Who comes meanwhile waits in the kernel's queue, and
as that is short, so is the wait; where it is full a Unix socket's `connect` waits, and TCP tries again by itself.
"""

from __future__ import annotations

import asyncio
import errno
import logging
import socket
from collections.abc import Callable, Iterable

log = logging.getLogger(__name__)

REST_S = 0.02
"""After a connection: 50 a second at most."""
LONG_REST_S = 1.0
"""After the system has refused one, for want of files or memory."""
QUEUE = 32
"""Connections that wait in the kernel: the last of them for 0.7 s."""
_GONE = (errno.EAGAIN, errno.ECONNABORTED, errno.EINTR)
"""The other side did not wait."""
_NOT_HERE = (errno.EADDRNOTAVAIL, errno.EAFNOSUPPORT)


class Listener:
    """Takes connections on sockets that listen already, and closes them in the end.

    place      where that is, in words
    protocol   makes the asyncio protocol of each connection
    state      in words: "listening on ...", or why nobody can connect
    """

    def __init__(
        self, place: str, sockets: Iterable[socket.socket], protocol: Callable[[], asyncio.BaseProtocol]
    ) -> None:
        self.sockets = tuple(sockets)
        self.state = self._well = f"listening on {place}"
        self._place = place
        self._protocol = protocol
        self._loop = asyncio.get_running_loop()
        self._told: set[str] = set()
        self._rests: dict[socket.socket, asyncio.TimerHandle] = {}
        self._taking: set[asyncio.Task[None]] = set()
        for sock in self.sockets:
            sock.setblocking(False)
            self._listen(sock)

    @property
    def port(self) -> int:
        """Of TCP: where it listens."""
        return int(self.sockets[0].getsockname()[1])

    async def close(self) -> None:
        """Take no more connections; those that were taken belong to their protocols."""
        for sock in self.sockets:
            self._loop.remove_reader(sock)
            if sock in self._rests:
                self._rests.pop(sock).cancel()
            sock.close()
        if self._taking:
            await asyncio.wait(self._taking)

    def _listen(self, sock: socket.socket) -> None:
        self._rests.pop(sock, None)
        self._loop.add_reader(sock, self._accept, sock)

    def _accept(self, sock: socket.socket) -> None:
        rest_s = REST_S
        try:
            connection, _ = sock.accept()
        except OSError as error:
            if error.errno not in _GONE:
                rest_s = LONG_REST_S
                self._tell(error.strerror or str(error))
        else:
            self.state = self._well
            task = self._loop.create_task(self._take(connection))
            self._taking.add(task)
            task.add_done_callback(self._taking.discard)
        self._loop.remove_reader(sock)
        self._rests[sock] = self._loop.call_later(rest_s, self._listen, sock)

    async def _take(self, connection: socket.socket) -> None:
        try:
            await self._loop.connect_accepted_socket(self._protocol, connection)
        except OSError:
            connection.close()

    def _tell(self, why: str) -> None:
        self.state = f"nobody can connect to {self._place}: {why}"
        if why not in self._told:
            # Once: what comes and goes does not fill the journal.
            self._told.add(why)
            log.warning("%s", self.state)


async def tcp_sockets(host: str, port: int) -> list[socket.socket]:
    """Sockets that listen on each address of `host`; "::" is all of both IPv4 and IPv6. Raises OSError."""
    if host == "::":
        # A socket of IPv6 alone would leave IPv4 out.
        return [socket.create_server((host, port), family=socket.AF_INET6, backlog=QUEUE, dualstack_ipv6=True)]
    loop = asyncio.get_running_loop()
    found = await loop.getaddrinfo(host, port, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE)
    sockets: list[socket.socket] = []
    missing: OSError | None = None
    for family, address in dict.fromkeys((family, address) for family, _, _, _, address in found):
        try:
            sockets.append(socket.create_server(address, family=family, backlog=QUEUE))
        except OSError as error:
            # "localhost" may have an address of a family that this machine has turned off.
            if error.errno not in _NOT_HERE:
                for sock in sockets:
                    sock.close()
                raise
            missing = error
    if missing is not None and not sockets:
        raise missing
    return sockets
