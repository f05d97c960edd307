"""What listens: one connection at a time however many come, and a system that has no files left is waited for."""

from __future__ import annotations

import asyncio
import errno
import logging
import os
import resource
import socket
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

import pytest
from mosquitto_broker import soon
from network_rig import message, no_status, plan

from quavelet.sinks import listener
from quavelet.sinks.control import ControlSocket
from quavelet.sinks.listener import QUEUE, tcp_sockets
from quavelet.sinks.metrics import MetricsEndpoint
from quavelet.sinks.network import Part
from quavelet.sinks.output import Output
from quavelet.sinks.outputs import make_output

FLOOD = 20
"""Connections at once: less than the kernel's queue holds."""
Held = Callable[[], int]


def place(kind: str, folder: Path) -> tuple[Part, Callable[[], str | tuple[str, int]], Held]:
    """What listens, where, and how many connections it has."""
    path = str(folder / "x.sock")
    if kind == "metrics":
        metrics = MetricsEndpoint("127.0.0.1", 0, status=no_status)
        return metrics, lambda: ("127.0.0.1", metrics.port), lambda: metrics.waiting + metrics.answers.total()
    if kind == "control":
        control = ControlSocket(Path(path), status=no_status)
        return control, lambda: path, lambda: control.stats().readers + control.stats().sent
    output = make_output(plan("tcp:127.0.0.1:0" if kind == "tcp" else f"unix:{path}"))
    return output, lambda: path if kind == "unix" else address(output), lambda: held(output)


def address(output: Output) -> tuple[str, int]:
    return "127.0.0.1", int(output.status().state.rpartition(":")[2])


def held(output: Output) -> int:
    return output.status().readers + output.status().refused


def connected(where: str | tuple[str, int]) -> socket.socket:
    """A connection, which is one as soon as it is in the kernel's queue."""
    sock = socket.socket(socket.AF_UNIX if isinstance(where, str) else socket.AF_INET)
    sock.connect(where)
    return sock


@pytest.mark.parametrize("kind", ["unix", "tcp", "control", "metrics"])
def test_a_flood_is_taken_one_by_one_with_a_rest_after_each(
    kind: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert FLOOD < QUEUE

    async def scenario() -> None:
        part, where, taken = place(kind, tmp_path)
        await part.open()
        with ExitStack() as stack:
            monkeypatch.setattr(listener, "REST_S", 3600.0)
            for _ in range(FLOOD):
                stack.enter_context(connected(where()))
            assert await soon(lambda: taken() == 1)
            for _ in range(50):
                await asyncio.sleep(0.001)
            assert taken() == 1
        await part.close()

    asyncio.run(scenario())


@pytest.mark.parametrize("kind", ["unix", "tcp", "control", "metrics"])
def test_everybody_in_the_queue_has_his_turn(kind: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(listener, "REST_S", 0.001)

    async def scenario() -> None:
        part, where, taken = place(kind, tmp_path)
        await part.open()
        with ExitStack() as stack:
            for _ in range(FLOOD):
                stack.enter_context(connected(where()))
            assert await soon(lambda: taken() == FLOOD)
        await part.close()

    asyncio.run(scenario())


def test_one_who_stays_is_let_in_among_many_who_have_gone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(listener, "REST_S", 0.005)

    async def scenario() -> None:
        output = make_output(plan(f"unix:{tmp_path}/x.sock"))
        await output.open()
        for _ in range(FLOOD):
            connected(f"{tmp_path}/x.sock").close()
        with connected(f"{tmp_path}/x.sock") as stays:
            stays.setblocking(False)

            def is_served() -> bool:
                output.write(message(0))
                try:
                    return stays.recv(65_536).startswith(b"{")
                except BlockingIOError:
                    return False

            assert await soon(is_served)
            assert output.status().refused == 0
        await output.close()

    asyncio.run(scenario())


@contextmanager
def no_file_left() -> Iterator[None]:
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    highest = max(int(one.name) for one in Path("/proc/self/fd").iterdir())
    resource.setrlimit(resource.RLIMIT_NOFILE, (highest, hard))
    fillers: list[int] = []
    try:
        with pytest.raises(OSError, match=os.strerror(errno.EMFILE)):
            while True:
                fillers.append(os.dup(0))
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_NOFILE, (soft, hard))
        for one in fillers:
            os.close(one)


def test_without_files_for_a_connection_it_is_told_once_waited_for_and_then_taken(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr(listener, "LONG_REST_S", 0.02)
    path = f"{tmp_path}/x.sock"

    async def scenario() -> None:
        output = make_output(plan(f"unix:{path}"))
        await output.open()
        with connected(path):
            with no_file_left():
                assert await soon(lambda: output.status().state.startswith("nobody can connect"))
                await asyncio.sleep(0.1)
                assert output.status().state == f"nobody can connect to {path}: {os.strerror(errno.EMFILE)}"
            assert await soon(lambda: output.status().readers == 1)
            assert output.status().state == f"listening on {path}"
        await output.close()

    with caplog.at_level(logging.WARNING):
        asyncio.run(scenario())
    assert len(caplog.messages) == 1


def test_a_name_of_several_addresses_listens_on_those_that_are_here(monkeypatch: pytest.MonkeyPatch) -> None:
    async def scenario() -> None:
        loop = asyncio.get_running_loop()
        hosts = ["192.0.2.1", "127.0.0.1"]

        async def found(*_: object, **__: object) -> list[tuple[object, ...]]:
            return [(socket.AF_INET, socket.SOCK_STREAM, 6, "", (host, 0)) for host in hosts]

        monkeypatch.setattr(loop, "getaddrinfo", found)
        (only,) = await tcp_sockets("boat", 0)
        assert only.getsockname()[0] == "127.0.0.1"
        only.close()
        hosts.pop()
        with pytest.raises(OSError, match=r"192\.0\.2\.1"):
            await tcp_sockets("boat", 0)

    asyncio.run(scenario())
