"""A network's thread with outputs on it, and readers of what they send."""

import socket
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import msgspec
import output_plans
from waiting import eventually

from quavelet.core.clock import VirtualClock
from quavelet.settings import OutputSettings
from quavelet.sinks.message import Message
from quavelet.sinks.network import Network
from quavelet.sinks.output import Output
from quavelet.sinks.outputs import make_output
from quavelet.sinks.plan import OutputPlan
from quavelet.sinks.status import OutputStatus, Status

BOUND_S = 20.0

MESSAGE = msgspec.structs.replace(output_plans.MESSAGE, t_ns=0, roll_deg=0.0, pitch_deg=0.0, yaw_deg=0.0)


def message(n: int) -> Message:
    """The n-th: told apart by its time."""
    return msgspec.structs.replace(MESSAGE, t_ns=n)


def no_status() -> Status:
    return output_plans.STATUS


def plan(to: str, **settings: object) -> OutputPlan:
    output = msgspec.convert({"to": to, **settings}, OutputSettings)
    return OutputPlan("x", output, "imu", no_status, int)


def until(condition: Callable[[], bool]) -> None:
    """Return as soon as it holds; fail when it does not within the bound."""
    assert eventually(condition, within_s=BOUND_S, look_s=0.001), "it never held"


class Rig:
    """A running network; what it says is in `said`."""

    def __init__(self, *, wait_for_room: bool = True) -> None:
        self.said: list[str] = []
        self.clock = VirtualClock()
        self.network = Network(
            talk=self.said.append, clock=self.clock, wait_for_room=wait_for_room, first_pause_s=0.001
        )
        self.network.start()

    def output(self, to: str, **settings: object) -> Output:
        """One that has been opened."""
        output = make_output(plan(to, **settings))
        self.network.add(output)
        until(lambda: self.status(output).state != "closed" or bool(self.network.failure(output)))
        assert not self.network.failure(output), self.said
        return output

    def status(self, output: Output) -> OutputStatus:
        return output.status(self.network.failure(output))

    def send(self, first: int, last: int) -> None:
        for n in range(first, last):
            self.network.write(message(n))


@contextmanager
def network(*, wait_for_room: bool = True) -> Iterator[Rig]:
    rig = Rig(wait_for_room=wait_for_room)
    try:
        yield rig
    finally:
        rig.network.close()


MESSAGE_DECODER = msgspec.json.Decoder(Message)
"""Made once, on one thread: msgspec looks into a type at its first use, and two threads that do so at once crash."""


class ReadingEnd:
    """A connection whose lines are taken apart."""

    def __init__(self, sock: socket.socket) -> None:
        sock.settimeout(BOUND_S)
        self.sock = sock
        self._stream = sock.makefile("rb")

    def line(self) -> bytes:
        return self._stream.readline()

    def times(self, n: int) -> list[int]:
        """Of the next n messages, which must be whole."""
        return [MESSAGE_DECODER.decode(self.line()).t_ns for _ in range(n)]

    def is_closed(self) -> bool:
        try:
            return self.sock.recv(1) == b""
        except ConnectionResetError:
            return True

    def close(self) -> None:
        self._stream.close()
        self.sock.close()


@contextmanager
def reading(address: Path | tuple[str, int]) -> Iterator[ReadingEnd]:
    """A reader of a Unix socket's path or of a TCP address."""
    if isinstance(address, Path):
        sock = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        sock.connect(str(address))
    else:
        sock = socket.create_connection(address, timeout=BOUND_S)
    end = ReadingEnd(sock)
    try:
        yield end
    finally:
        end.close()


def tcp_address(status: OutputStatus) -> tuple[str, int]:
    """Where an output on port 0 listens."""
    host, _, port = status.state.removeprefix("listening on ").rpartition(":")
    return host.strip("[]"), int(port)
