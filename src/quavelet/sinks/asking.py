"""The other side of the local socket: finding it and asking it."""

from __future__ import annotations

import socket
import struct
import time
from collections.abc import Iterator, Mapping
from contextlib import suppress
from pathlib import Path

import msgspec

from quavelet.core.errors import ImuError
from quavelet.sinks.status import Status

PATIENCE_S = 5.0
SYSTEM_FOLDER = Path("/run/quavelet")
LONGEST_ANSWER_BYTES = 1_000_000
TRIES, PAUSE_S = 10, 0.03


class AskError(ImuError):
    """No service could be asked, or its answer is none."""


def find_socket(which: str | None, *, environ: Mapping[str, str], system: Path = SYSTEM_FOLDER) -> Path:
    """The socket of the service called `which`, or at that path where there is a "/" in it; None: of the only one.

    Raises AskError where there is none, or more than one.
    """
    if which and "/" in which:
        return Path(which)
    folders = [system]
    if environ.get("XDG_RUNTIME_DIR"):
        folders.append(Path(environ["XDG_RUNTIME_DIR"]) / "quavelet")
    found = [path for folder in folders for path in sorted(folder.glob("*.sock")) if which in (None, path.stem)]
    if len(found) == 1:
        return found[0]
    if found:
        raise AskError(f"there are several: give one of {', '.join(str(path) for path in found)}")
    name = which or "NAME"
    raise AskError(
        f"no service {f'{which} ' if which else ''}is found in {' or '.join(str(folder) for folder in folders)}: "
        f"start it with `systemctl start quavelet@{name}`, or give its socket's path"
    )


def ask_status(path: Path) -> bytes:
    """The answer to `status`, one line of JSON. Raises AskError."""
    answer = next(_lines(path, "status"), b"")
    if not answer.endswith(b"\n"):
        raise AskError(f"{path}: the service ended before it had answered: ask again")
    return _not_refused(path, answer)


def decode_status(path: Path, answer: bytes) -> Status:
    """The `Status` of an answer. Raises AskError."""
    try:
        return msgspec.json.decode(answer, type=Status)
    except msgspec.DecodeError as error:
        raise AskError(f"{path}: the answer is not that of a service: {error}") from error


def watch(path: Path, *, hz: float | None = None) -> Iterator[bytes]:
    """The messages as lines of JSON, the latest at once, for as long as the service runs. Raises AskError."""
    for line in _lines(path, "watch" if hz is None else f"watch {hz:g}"):
        yield _not_refused(path, line)


def _lines(path: Path, question: str) -> Iterator[bytes]:
    """What comes back, line by line; it may take its time, but not for the first connection."""
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as sock:
        # The kernel lets who finds many before him wait, but not where Python has the timeout.
        sock.setsockopt(socket.SOL_SOCKET, socket.SO_SNDTIMEO, struct.pack("@ll", int(PATIENCE_S), 0))
        try:
            _connect(sock, path)
            sock.settimeout(PATIENCE_S)
            # Who has no place for us says so and closes, without hearing what we want.
            with suppress(BrokenPipeError, ConnectionResetError):
                sock.sendall(question.encode() + b"\n")
            # A service whose chip is gone has nothing to tell for long.
            sock.settimeout(PATIENCE_S if question == "status" else None)
            with sock.makefile("rb") as stream:
                while line := stream.readline(LONGEST_ANSWER_BYTES):
                    yield line
        except FileNotFoundError as error:
            raise AskError(f"{path} is not there: start the service, or give its name or its socket's path") from error
        except ConnectionRefusedError as error:
            raise AskError(f"{path}: its service has ended without taking it away: start it again") from error
        except PermissionError as error:
            raise AskError(
                f"{path} may not be asked by this user: use sudo, or join the group that `ls -l` names"
            ) from error
        except (TimeoutError, BlockingIOError) as error:
            raise AskError(f"{path}: no answer within {PATIENCE_S:g} s: see its journal") from error
        except ConnectionResetError:
            return
        except OSError as error:
            raise AskError(f"{path} cannot be asked: {error.strerror or error}") from error


def _connect(sock: socket.socket, path: Path) -> None:
    """A service that is just beginning has its file there a moment before it listens. Raises OSError."""
    for _ in range(TRIES - 1):
        with suppress(ConnectionRefusedError):
            sock.connect(str(path))
            return
        time.sleep(PAUSE_S)
    sock.connect(str(path))


def _not_refused(path: Path, line: bytes) -> bytes:
    if line.startswith(b'{"error":'):
        try:
            raise AskError(f"{path}: {msgspec.json.decode(line, type=dict[str, str])['error']}")
        except msgspec.DecodeError as error:
            raise AskError(f"{path}: the answer is not that of a service: {error}") from error
    return line
