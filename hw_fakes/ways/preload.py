"""A program with the fake as its /dev/i2c-N: a shim loaded into it, and the adapter behind a socket in this process."""

from __future__ import annotations

import errno
import os
import selectors
import shutil
import signal
import socket
import struct
import subprocess
import sys
import tempfile
import threading
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from types import FrameType

from hw_fakes.ways.i2c_dev import OpenDevice
from hw_fakes.wire.adapter import READ, Adapter, Message, os_error
from quavelet.core.errors import SettingsError

SHIM = Path(__file__).with_name("i2c_dev_shim.c")
CONTROL, SMBUS, TRANSFER, READ_FILE, WRITE_FILE = range(5)  # as in the shim
HEAD = struct.Struct("=4I")
MESSAGE_HEAD = struct.Struct("=3H")
MOST_PACKET = 1 << 17
SHELL_CANNOT_RUN, SHELL_NOT_FOUND, SHELL_SIGNAL = 126, 127, 128


def run_with_device(program: Sequence[str], *, adapter: Adapter, bus: int = 1) -> int:
    """Run `program` with `adapter` as its /dev/i2c-`bus` and return its exit code, in the words of a shell.

    Raises SettingsError where the shim cannot be built.
    """
    with served_device(adapter, bus=bus) as environment:
        return run_program(program, environment)


def run_program(program: Sequence[str], environment: Mapping[str, str]) -> int:
    """Run `program` with `environment` added to this one, pass SIGTERM on to it, and return its exit code as a shell's.

    127 where there is no such program, 126 where it cannot be run.
    """
    try:
        process = subprocess.Popen(program, env={**os.environ, **environment})
    except OSError as error:
        print(f"hw_fakes: cannot run {program[0]}: {error.strerror}", file=sys.stderr)
        return SHELL_NOT_FOUND if isinstance(error, FileNotFoundError) else SHELL_CANNOT_RUN

    def pass_on(number: int, _frame: FrameType | None) -> None:
        # A terminal has sent its Ctrl-C to the program too.
        if number != signal.SIGINT:
            process.send_signal(number)

    before = {number: signal.signal(number, pass_on) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        code = process.wait()
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
    return code if code >= 0 else SHELL_SIGNAL - code


@contextmanager
def served_device(adapter: Adapter, *, bus: int = 1) -> Iterator[dict[str, str]]:
    """The environment in which a program finds `adapter` as /dev/i2c-`bus`, as long as the block lasts."""
    with (
        tempfile.TemporaryDirectory(prefix="hw_fakes-") as name,
        socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET) as listener,
    ):
        folder = Path(name)
        shim = _built(folder)
        path = str(folder / "socket")
        listener.bind(path)
        listener.listen()
        server = _Server(adapter, listener)
        server.start()
        already = os.environ.get("LD_PRELOAD")
        try:
            yield {
                "LD_PRELOAD": f"{shim}:{already}" if already else str(shim),
                "HW_FAKES_I2C_BUS": str(bus),
                "HW_FAKES_I2C_SOCKET": path,
            }
        finally:
            server.end()


def _built(folder: Path) -> Path:
    compiler = shutil.which("cc") or shutil.which("gcc") or shutil.which("clang")
    if compiler is None:
        raise SettingsError("/dev/i2c-N needs a C compiler and there is none: apt install gcc libc6-dev")
    shim = folder / "i2c_dev_shim.so"
    command = [compiler, "-shared", "-fPIC", "-O2", "-o", str(shim), str(SHIM), "-ldl", "-pthread"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode:
        raise SettingsError(
            f"{compiler} cannot build {SHIM.name}, is libc6-dev (glibc 2.33 or newer) there? It says:\n{done.stderr}"
        )
    return shim


class _Server:
    """One thread for all connections: as on the wires, one transfer is over before the next begins."""

    def __init__(self, adapter: Adapter, listener: socket.socket) -> None:
        self._adapter = adapter
        self._listener = listener
        self._stop_asked, self._ask_stop = os.pipe()
        self._thread = threading.Thread(target=self._serve, name="hw_fakes i2c-dev", daemon=True)

    def start(self) -> None:
        self._thread.start()

    def end(self) -> None:
        os.close(self._ask_stop)
        self._thread.join()
        os.close(self._stop_asked)

    def _serve(self) -> None:
        with selectors.DefaultSelector() as selector:
            selector.register(self._listener, selectors.EVENT_READ)
            selector.register(self._stop_asked, selectors.EVENT_READ)
            open_files: dict[socket.socket, OpenDevice] = {}
            while True:
                for key, _ in selector.select():
                    if key.fileobj is self._listener:
                        client, _address = self._listener.accept()
                        open_files[client] = OpenDevice(self._adapter)
                        selector.register(client, selectors.EVENT_READ)
                    elif isinstance(key.fileobj, socket.socket):
                        client = key.fileobj
                        if not _answer(client, open_files[client]):
                            selector.unregister(client)
                            del open_files[client]
                            client.close()
                    else:
                        for client in open_files:
                            client.close()
                        return


def _answer(client: socket.socket, device: OpenDevice) -> bool:
    """Serve one request; False where the program has closed the file, or is gone."""
    try:
        request = client.recv(MOST_PACKET)
        if not request:
            return False
        try:
            result, data = _do(device, request)
        except OSError as error:
            result, data = -(error.errno or errno.EIO), b""
        except Exception as error:  # noqa: BLE001  the program must get an answer, or it would wait for ever
            print(f"hw_fakes: the transfer fails with EIO: {error!r}", file=sys.stderr)
            result, data = -errno.EIO, b""
        client.sendall(struct.pack("=i", result) + data)
    except ConnectionError:
        return False
    return True


def _do(device: OpenDevice, request: bytes) -> tuple[int, bytes]:
    operation, a, b, c = HEAD.unpack_from(request)
    data = request[HEAD.size :]
    if operation == CONTROL:
        return device.control(a, b), b""
    if operation == SMBUS:
        return 0, device.smbus(direction=a, command=b, size=c, data=data)
    if operation == TRANSFER:
        return a, b"".join(device.transfer(_messages(a, data)))
    if operation == READ_FILE:
        return 0, device.read(a)
    if operation == WRITE_FILE:
        return device.write(data), b""
    raise os_error(errno.ENOSYS)


def _messages(count: int, data: bytes) -> list[Message]:
    messages: list[Message] = []
    at = 0
    for _ in range(count):
        address, flags, length = MESSAGE_HEAD.unpack_from(data, at)
        at += MESSAGE_HEAD.size
        if flags & READ:
            messages.append((address, flags, length))
        else:
            messages.append((address, flags, data[at : at + length]))
            at += length
    return messages
