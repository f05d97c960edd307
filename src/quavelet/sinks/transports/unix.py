"""A Unix socket that programs of this machine read from; access is that of its file."""

from __future__ import annotations

import asyncio
import errno
import fcntl
import os
import socket
import stat
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

from quavelet.core.errors import SettingsError
from quavelet.core.paths import expanded
from quavelet.settings.service import check_socket_path
from quavelet.sinks.listener import QUEUE, Listener
from quavelet.sinks.plan import OutputPlan
from quavelet.sinks.transport import TransportStats
from quavelet.sinks.transports.readers import KERNEL_BYTES, Reader, Readers

ACCESS = 0o660
LOCK_TRIES = 50
LOCK_PAUSE_S = 0.02


class UnixTransport:
    """Listens on a path; the file is there from `open` to `close`."""

    def __init__(self, plan: OutputPlan) -> None:
        self._path = expanded(plan.settings.destination.path)
        self._readers = Readers(plan.settings.readers)
        self._listener: UnixListener | None = None

    async def open(self) -> None:
        self._readers.open()
        self._listener = await listen(self._path, lambda: Reader(self._readers))

    def send(self, payload: bytes) -> None:
        self._readers.send(payload)

    async def close(self) -> None:
        if self._listener is not None:
            listener, self._listener = self._listener, None
            await listener.close()
        await self._readers.close()

    def stats(self) -> TransportStats:
        return self._readers.stats("closed" if self._listener is None else self._listener.state)


class UnixListener(Listener):
    """A listening socket and its file."""

    def __init__(
        self, path: Path, inode: int, sock: socket.socket, protocol: Callable[[], asyncio.BaseProtocol]
    ) -> None:
        super().__init__(str(path), [sock], protocol)
        self._path = path
        self._inode = inode

    async def close(self) -> None:
        """Take no more readers, and take the file away where it is still ours."""
        with suppress(OSError):
            if self._path.lstat().st_ino == self._inode:
                self._path.unlink()
        await super().close()


async def listen(path: Path, protocol: Callable[[], asyncio.BaseProtocol]) -> UnixListener:
    """Listen on `path`; a file that a dead process left there goes. Raises SettingsError where another program listens
    there, it is no socket or the path is too long, OSError where the file cannot be made."""
    check_socket_path("path", str(path))
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as sock:
        # Two programs that begin at once must not each take the other's file for a dead one's.
        folder = os.open(path.parent, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
        try:
            await _lock(folder, path)
            _remove_stale(path)
            sock.bind(str(path))
            # Nobody can connect before it listens, so nobody comes in by the access that bind gave it.
            path.chmod(ACCESS)
            sock.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, KERNEL_BYTES)
            inode = path.lstat().st_ino
            sock.listen(QUEUE)
            return UnixListener(path, inode, sock.dup(), protocol)
        finally:
            os.close(folder)


async def _lock(folder: int, path: Path) -> None:
    for _ in range(LOCK_TRIES):
        try:
            fcntl.flock(folder, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            await asyncio.sleep(LOCK_PAUSE_S)
        else:
            return
    raise SettingsError(f"{path.parent} is locked by another program: give the socket another folder")


def _remove_stale(path: Path) -> None:
    try:
        mode = path.lstat().st_mode
    except FileNotFoundError:
        return
    if not stat.S_ISSOCK(mode):
        raise SettingsError(f"{path} is there and is no socket: remove it, or give another path")
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as probe:
        probe.setblocking(False)
        try:
            probe.connect(str(path))
        except ConnectionRefusedError:
            path.unlink()
            return
        except OSError as error:
            # A queue that is full, or a socket of another kind, is somebody's.
            if error.errno not in (errno.EAGAIN, errno.EPROTOTYPE):
                raise
    raise SettingsError(f"another program listens on {path}: stop it, or give another path")
