"""The control socket of a served fake: lines in, answers out, each ended by an empty line."""

from __future__ import annotations

import errno
import socket
import socketserver
import sys
import threading
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path

from hw_fakes.serve.control_words import ControlWords
from hw_fakes.wire.adapter import Adapter
from quavelet.core.errors import SettingsError

LONGEST_LINE = 4096
USER_ONLY = 0o600
NOBODY, REFUSED = 125, 1


@contextmanager
def control_socket(path: str, adapter: Adapter) -> Iterator[None]:
    """Take lines at the Unix socket `path` as long as the block lasts; see `ControlWords`.

    Only this user may connect. Raises SettingsError where there cannot be a socket.
    """
    _make_room(path)
    words = ControlWords(adapter)

    class Handler(socketserver.StreamRequestHandler):
        def handle(self) -> None:
            try:
                while line := self.rfile.readline(LONGEST_LINE):
                    answer = words.answer(line.decode(errors="replace"))
                    self.wfile.write(f"{answer}\n\n".encode())
            except ConnectionError:
                pass  # whoever asked did not wait for the answer

    with _server(path, Handler) as server:
        thread = threading.Thread(target=server.serve_forever, args=(0.05,), name="hw_fakes control", daemon=True)
        thread.start()
        try:
            yield
        finally:
            server.shutdown()
            thread.join()
            Path(path).unlink(missing_ok=True)


class _Server(socketserver.ThreadingMixIn, socketserver.UnixStreamServer):
    daemon_threads = True
    block_on_close = False  # who is still connected does not keep the fake alive

    def server_bind(self) -> None:
        super().server_bind()
        Path(str(self.server_address)).chmod(USER_ONLY)


def _server(path: str, handler: type[socketserver.StreamRequestHandler]) -> _Server:
    try:
        return _Server(path, handler)
    except OSError as error:
        raise SettingsError(f"there can be no control socket {path} ({_why(error)}): give another path") from None


def _make_room(path: str) -> None:
    """Remove a socket that nobody serves any more."""
    try:
        connect(path).close()
    except ConnectionRefusedError:
        if Path(path).is_socket():
            Path(path).unlink()
    except OSError:
        return  # none there, or what the server will be told when it wants to be there
    else:
        raise SettingsError(f"there is a fake that takes lines at {path} already: end it, or give another path")


def connect(path: str) -> socket.socket:
    """A connection to a control socket. Raises OSError."""
    connection = socket.socket(socket.AF_UNIX)
    try:
        connection.connect(path)
    except OSError:
        connection.close()
        raise
    return connection


def send(path: str, lines: Iterable[str]) -> int:
    """Send lines one by one and print each answer; 0, 1 where one is an error, 125 where nobody answers."""
    try:
        with connect(path) as connection, connection.makefile("rw", encoding="utf-8", errors="replace") as stream:
            code = 0
            for line in lines:
                if not line.strip():
                    continue
                stream.write(line.strip() + "\n")
                stream.flush()
                answer = _answer(stream)
                if not answer:
                    raise ConnectionResetError(errno.ECONNRESET, "it ended")
                print("\n".join(answer), flush=True)
                code = code if answer[0].startswith("ok") else REFUSED
            return code
    except OSError as error:
        print(
            f"hw_fakes: nobody takes lines at {path} ({_why(error)}): is the PATH that of --control?", file=sys.stderr
        )
        return NOBODY


def _answer(stream: Iterable[str]) -> list[str]:
    answer = []
    for line in stream:
        if line == "\n":
            break
        answer.append(line.rstrip("\n"))
    return answer


def _why(error: OSError) -> str:
    return error.strerror or str(error)
