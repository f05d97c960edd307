"""The place where Prometheus asks, over real sockets: whatever asks, it answers, and nothing of it stays behind."""

from __future__ import annotations

import asyncio
import gc
import logging
import socket
import tracemalloc
from collections.abc import Awaitable, Callable
from contextlib import suppress

import pytest
from hypothesis import given
from hypothesis import strategies as st
from sink_status import status

from quavelet.sinks.metrics import LONGEST_REQUEST_BYTES, MOST_CONNECTIONS, MetricsEndpoint, code_of
from quavelet.sinks.status import Status

GOOD = b"GET /metrics HTTP/1.1\r\nHost: localhost\r\n\r\n"
SHORT_S = 0.3
"""The patience where it is to end; elsewhere it outlasts a machine that is busy with other things."""


def run(
    scenario: Callable[[MetricsEndpoint], Awaitable[None]],
    *,
    of: Callable[[], Status] = status,
    patience_s: float = 20.0,
) -> MetricsEndpoint:
    """The scenario with an open endpoint; afterwards nothing of it may be left."""

    async def whole() -> MetricsEndpoint:
        endpoint = MetricsEndpoint("127.0.0.1", 0, status=of, patience_s=patience_s)
        await endpoint.open()
        try:
            async with asyncio.timeout(60):
                await scenario(endpoint)
        finally:
            await endpoint.close()
        assert asyncio.all_tasks() == {asyncio.current_task()}
        return endpoint

    return asyncio.run(whole())


async def ask(endpoint: MetricsEndpoint, request: bytes = GOOD) -> bytes:
    """What comes back until the other side closes; b"" where it cut the connection off."""
    reader, writer = await asyncio.open_connection("127.0.0.1", endpoint.port)
    try:
        writer.write(request)
        return await reader.read()
    except ConnectionError:
        return b""
    finally:
        writer.close()


def code(answer: bytes) -> str:
    return answer.split(b" ", 2)[1].decode() if answer else "cut off"


def test_get_metrics_is_answered_whole_and_as_prometheus_text():
    async def scenario(endpoint: MetricsEndpoint) -> None:
        head, _, body = (await ask(endpoint)).partition(b"\r\n\r\n")
        assert head.startswith(b"HTTP/1.1 200 OK\r\n")
        assert b"Content-Type: text/plain; version=0.0.4; charset=utf-8" in head
        assert b"Content-Length: %d" % len(body) in head
        assert b'quavelet_samples_total{name="imu0",src="linux:1"} 2500\n' in body
        assert b'quavelet_metrics_requests_total{name="imu0",src="linux:1",code="200"} 1\n' in body

    assert run(scenario).answers == {"200": 1}


@pytest.mark.parametrize(
    ("request_", "expected"),
    [
        (b"GET / HTTP/1.0\r\n\r\n", "404"),
        (b"GET /metrics/../../etc/passwd HTTP/1.0\r\n\r\n", "404"),
        (b"GET /metrics?a=b HTTP/1.0\r\n\r\n", "200"),
        (b"HEAD /metrics HTTP/1.0\r\n\r\n", "200"),
        (b"HEAD / HTTP/1.0\r\n\r\n", "404"),
        (b"POST /metrics HTTP/1.0\r\nContent-Length: 3\r\n\r\nabc", "405"),
        (b"OPTIONS /metrics HTTP/1.0\r\n\r\n", "405"),
        (b"GET  /metrics HTTP/1.0\r\n\r\n", "400"),
        (b"GET /metrics\r\n\r\n", "400"),
        (b"GET http://elsewhere/metrics HTTP/1.0\r\n\r\n", "400"),
        (b"GET /metrics HTTP/1.1\r\n\r\n", "400"),
        (b"GET /metrics HTTP/1.1\r\nHost: localhost\r\nHost: localhost\r\n\r\n", "400"),
        (b"GET /metrics HTTP/1.1\r\nHost: localhost/x\r\n\r\n", "400"),
        (b"GET /metrics HTTP/1.1\r\nHost: \xff\r\n\r\n", "400"),
        (b"GET /metrics HTTP/1.0\r\nHost: evil.example\r\n\r\n", "421"),
        (b"PRI * HTTP/2.0\r\n\r\n", "400"),
        (b"\x16\x03\x01\x02\x00\x01\x00\r\n\r\n", "400"),
        (b"\r\n\r\n", "400"),
    ],
)
def test_anything_else_is_told_so(request_, expected):
    async def scenario(endpoint: MetricsEndpoint) -> None:
        assert code(await ask(endpoint, request_)) == expected

    assert run(scenario).answers == {expected: 1}


@given(
    st.one_of(
        st.binary(), st.lists(st.sampled_from([b"GET", b"/metrics", b" ", b"HTTP/1.1", b"\r\n", b"?"])).map(b"".join)
    )
)
def test_every_beginning_of_a_request_has_a_code(head):
    assert code_of(head) in {"200", "400", "404", "405", "421"}


@pytest.mark.parametrize(
    "host",
    [
        "localhost:9650",
        "127.0.0.1:9650",
        "192.168.1.20",
        "[::1]:9650",
        "[fe80::1]",
        "boat:9650",
        "BOAT.local.:9650",
        "boat.home.arpa",
        "boat.lan",
        "pi.example.org:9650",
        "PI.Example.Org",
    ],
)
def test_a_prometheus_that_asks_by_address_or_by_a_name_of_ours_is_answered(host):
    head = b"GET /metrics HTTP/1.1\r\nhost:\t%b \r\n\r\n" % host.encode()
    assert code_of(head, own=("0.0.0.0", "pi.example.org")) == "200"


@pytest.mark.parametrize(
    "host", ["evil.example", "evil.example:9650", "pi.example.org.evil.example", "xlocal.com", "127.0.0.1.evil.example"]
)
def test_a_page_whose_name_was_made_to_mean_this_machine_reads_no_figures(host):
    async def scenario(endpoint: MetricsEndpoint) -> None:
        answer = await ask(endpoint, b"GET /metrics HTTP/1.1\r\nHost: %b\r\n\r\n" % host.encode())
        assert code(answer) == "421"
        assert b"quavelet_" not in answer and b"give this name in [service] metrics" in answer

    run(scenario)


def test_head_is_answered_with_the_lines_of_get_and_no_body():
    async def scenario(endpoint: MetricsEndpoint) -> None:
        lines, end, body = (await ask(endpoint, GOOD.replace(b"GET", b"HEAD"))).partition(b"\r\n\r\n")
        assert lines.startswith(b"HTTP/1.1 200 OK\r\n") and (end, body) == (b"\r\n\r\n", b"")
        length = int(lines.partition(b"Content-Length: ")[2].split(b"\r\n")[0])
        assert length > 1000

    run(scenario)


def test_a_request_that_does_not_end_is_given_up():
    async def scenario(endpoint: MetricsEndpoint) -> None:
        assert code(await ask(endpoint, GOOD[:-2])) == "408"

    assert run(scenario, patience_s=SHORT_S).answers == {"408": 1}


def test_a_request_that_comes_a_byte_at_a_time_has_no_more_time_than_another():
    async def scenario(endpoint: MetricsEndpoint) -> None:
        reader, writer = await asyncio.open_connection("127.0.0.1", endpoint.port)
        for byte in range(1000):
            writer.write(b"GET /metrics HTTP/1.1\r\nX: aaaa"[byte : byte + 1] or b"a")
            await asyncio.sleep(SHORT_S / 10)
            if endpoint.answers:
                break
        assert byte < 30
        # A byte that comes after the answer was written makes the system cut the connection off.
        with suppress(ConnectionError):
            assert code(await reader.read()) == "408"
        writer.close()

    assert run(scenario, patience_s=SHORT_S).answers == {"408": 1}


def test_ten_megabytes_of_request_take_no_memory_and_are_cut_off():
    async def scenario(endpoint: MetricsEndpoint) -> None:
        gc.collect()
        tracemalloc.start()
        _, writer = await asyncio.open_connection("127.0.0.1", endpoint.port)
        try:
            for _ in range(10_000):
                writer.write(b"GET /metrics HTTP/1.1 " + b"x" * 1002)
                await writer.drain()
        except ConnectionError:
            pass
        _, peak = tracemalloc.get_traced_memory()
        tracemalloc.stop()
        writer.close()
        assert peak < 20 * LONGEST_REQUEST_BYTES + 200_000
        assert code(await ask(endpoint)) == "200"

    assert run(scenario).answers == {"431": 1, "200": 1}


def test_two_hundred_silent_connections_keep_nobody_out_and_the_oldest_of_them_go(monkeypatch):
    monkeypatch.setattr("quavelet.sinks.listener.REST_S", 0.0002)

    async def scenario(endpoint: MetricsEndpoint) -> None:
        # One after the other: more at once than the kernel's queue holds would be known to the client only.
        silent = [await asyncio.open_connection("127.0.0.1", endpoint.port) for _ in range(200)]
        assert code(await ask(endpoint)) == "200"
        assert endpoint.waiting <= MOST_CONNECTIONS + 1
        for reader, _ in silent[: 200 - MOST_CONNECTIONS]:
            assert code(await reader.read()) == "408"
        for _, writer in silent:
            writer.close()

    run(scenario, patience_s=3600.0)


def test_where_all_have_asked_and_take_no_answer_another_is_told_so(monkeypatch):
    monkeypatch.setattr("quavelet.sinks.metrics.MOST_CONNECTIONS", 1)

    async def scenario(endpoint: MetricsEndpoint) -> None:
        with socket.socket() as never_reads:
            never_reads.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
            never_reads.connect(("127.0.0.1", endpoint.port))
            never_reads.sendall(GOOD)
            while not endpoint.answers:
                await asyncio.sleep(0.01)
            assert code(await ask(endpoint, b"")) == "503"

    run(scenario, of=lambda: status(src="x" * 100_000), patience_s=3600.0)


def test_one_who_asks_and_goes_leaves_nothing_behind():
    async def scenario(endpoint: MetricsEndpoint) -> None:
        for request in (GOOD[:10], GOOD, b""):
            _, writer = await asyncio.open_connection("127.0.0.1", endpoint.port)
            writer.write(request)
            await writer.drain()
            writer.transport.abort()
        assert code(await ask(endpoint)) == "200"
        while endpoint.waiting:
            await asyncio.sleep(0.01)

    run(scenario)


def test_one_who_never_reads_the_answer_is_cut_off():
    async def scenario(endpoint: MetricsEndpoint) -> None:
        never_reads = socket.socket()
        never_reads.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        with never_reads:
            never_reads.connect(("127.0.0.1", endpoint.port))
            never_reads.sendall(GOOD)
            while not endpoint.answers or endpoint.waiting:
                await asyncio.sleep(0.01)
            assert len(everything(never_reads)) < 10_000_000

    # An answer of some 15 MB is more than the kernel keeps for both ends.
    assert run(scenario, of=lambda: status(src="x" * 100_000), patience_s=SHORT_S).answers == {"200": 1}


def everything(connection: socket.socket) -> bytes:
    """What still comes of a connection whose other end is closed."""
    got = bytearray()
    with suppress(ConnectionError):
        while part := connection.recv(65536):
            got += part
    return bytes(got)


def test_closing_cuts_off_whoever_is_connected_and_frees_the_port():
    async def scenario(endpoint: MetricsEndpoint) -> None:
        reader, writer = await asyncio.open_connection("127.0.0.1", endpoint.port)
        while not endpoint.waiting:
            await asyncio.sleep(0.01)
        port = endpoint.port
        await endpoint.close()
        with pytest.raises(OSError):
            await asyncio.open_connection("127.0.0.1", port)
        assert await asyncio.wait_for(reader.read(), 5) == b""
        writer.close()
        await endpoint.open()
        assert code(await ask(endpoint)) == "200"

    run(scenario)


def test_figures_that_cannot_be_given_are_an_error_in_the_log_and_the_next_are_asked_for(caplog):
    calls = iter([ValueError("no figures"), status()])

    def of() -> Status:
        found = next(calls)
        if isinstance(found, Exception):
            raise found
        return found

    async def scenario(endpoint: MetricsEndpoint) -> None:
        with caplog.at_level(logging.ERROR):
            assert code(await ask(endpoint)) == "500"
        assert "no figures" in caplog.text
        assert code(await ask(endpoint)) == "200"

    run(scenario, of=of)


def test_a_port_that_is_taken_is_an_error_that_names_it():
    async def scenario(endpoint: MetricsEndpoint) -> None:
        other = MetricsEndpoint("127.0.0.1", endpoint.port, status=status)
        with pytest.raises(OSError, match=str(endpoint.port)):
            await other.open()
        await other.close()

    run(scenario)
