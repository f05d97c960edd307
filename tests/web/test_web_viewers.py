"""Viewers over real sockets: each gets what it can take, and whatever one does, the others go on."""

from __future__ import annotations

import asyncio
import contextlib
import gc
import logging
import socket
import tracemalloc
from pathlib import Path

import aiohttp
import pytest
from web_rig import Bad, Noting, Rig, eventually, run

from quavelet.core.errors import BusError
from quavelet.sinks.status import Status
from quavelet.web import server
from quavelet.web.frames import message_frame, text_frame

HELLO = b"GET /live HTTP/1.1\r\nHost: 127.0.0.1:%d\r\nOrigin: http://127.0.0.1:%d\r\nUpgrade: websocket\r\n"
HELLO += b"Connection: Upgrade\r\nSec-WebSocket-Version: 13\r\nSec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n\r\n"


async def deaf(rig: Rig) -> socket.socket:
    """A viewer that shook hands and never reads."""
    loop = asyncio.get_running_loop()
    other = socket.socket()
    other.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
    other.setblocking(False)
    await loop.sock_connect(other, ("127.0.0.1", rig.page.port))
    before = len(rig.page.viewers)
    await loop.sock_sendall(other, HELLO % (rig.page.port, rig.page.port))
    assert await eventually(lambda: len(rig.page.viewers) > before)
    return other


def test_who_comes_late_gets_hello_history_state_status_and_the_latest_message_at_once():
    async def scenario(rig: Rig) -> None:
        sent = [rig.message() for _ in range(300)]
        async with rig.viewer() as viewer:
            latest = await viewer.until("message")
        assert [frame["is"] for frame in viewer.got] == ["hello", "history", "ability", "status", "message"]
        hello, history, ability, status, _ = viewer.got
        assert (hello["v"], hello["src"], hello["fake"], hello["name"]) == (1, "fake:tilt", True, "imu")
        assert hello["abilities"] == {"note": {"what": ["note"]}}
        assert len(history["t_ns"]) == 30
        assert (ability["name"], ability["state"]) == ("note", {"done": 0})
        assert status["s"]["state"] == "running" and status["viewers"]["now"] == 1
        # 30 a second of 100: the latest that went, no older than one of the others' periods.
        assert 0 <= sent[-1].t_ns - latest["m"]["t_ns"] < 34_000_000

    run(scenario, abilities=(Noting(),))


def test_all_viewers_get_thirty_messages_a_second_of_a_hundred_and_the_flags_of_those_between():
    async def scenario(rig: Rig) -> None:
        async with rig.viewer() as one, rig.viewer() as other:
            await one.until("status")
            await other.until("status")
            for i in range(1000):
                rig.message(flags=["gap"] if i == 501 else [], gap_ns=7 if i == 501 else 0)
            await one.live.send_str('{"ping":1}')
            await other.live.send_str('{"ping":2}')
            for viewer in (one, other):
                await viewer.until("pong")
                messages = [frame["m"] for frame in viewer.got if frame["is"] == "message"]
                assert 295 <= len(messages) <= 305
                assert [m["gap_ns"] for m in messages if m["flags"]] == [7]

    run(scenario)


def test_a_message_is_made_into_json_once_for_all(monkeypatch):
    made: list[int] = []

    def counted(message, *, now_ns: int) -> bytes:
        made.append(message.t_ns)
        return message_frame(message, now_ns=now_ns)

    async def scenario(rig: Rig) -> None:
        async with rig.viewer() as one, rig.viewer() as two, rig.viewer() as three:
            for viewer in (one, two, three):
                await viewer.until("status")
            made.clear()
            rig.message()
            for viewer in (one, two, three):
                await viewer.until("message")
            assert len(made) == 1

    monkeypatch.setattr("quavelet.web.page.message_frame", counted)
    run(scenario)


def test_an_ability_is_asked_answers_and_its_changed_state_goes_to_all():
    noting = Noting()

    async def scenario(rig: Rig) -> None:
        async with rig.viewer() as one, rig.viewer() as other:
            await one.live.send_str('{"n":7,"ability":"note","what":"look","values":{"a":[1,null]}}')
            assert (await one.until("answer"))["text"] == "look is noted"
            await other.until("ability", state={"done": 1})
            await one.live.send_str('{"n":8,"ability":"note","what":"refuse"}')
            answer = await one.until("answer", n=8)
            assert (answer["ok"], answer["text"]) == (False, "that cannot be: ask for another")
            await one.live.send_str('{"n":9,"ability":"nothing"}')
            assert (await one.until("answer", n=9))["ok"] is False

    run(scenario, abilities=(noting,))
    assert noting.done == [("look", {"a": [1, None]})]
    assert noting.closed == 0


@pytest.mark.parametrize("error", [RuntimeError("x"), KeyError("y"), RecursionError(), MemoryError(), OSError(5, "z")])
def test_an_ability_with_mistakes_ends_nothing_and_is_logged_once(error, caplog):
    async def scenario(rig: Rig) -> None:
        for _ in range(20):
            rig.message()
        async with rig.viewer() as viewer:
            hello = await viewer.until("hello")
            assert hello["abilities"] == {"bad": None, "note": {"what": ["note"]}}
            await viewer.live.send_str('{"n":1,"ability":"bad","what":"x"}')
            assert (await viewer.until("answer"))["ok"] is False
            rig.message()
            await viewer.until("status")

    good = Noting()
    with caplog.at_level(logging.WARNING):
        run(scenario, abilities=(Bad(error), good))
    assert good.seen == 21
    assert [record.name for record in caplog.records] == ["quavelet.web.page"]


def test_an_ability_that_is_refused_by_the_chip_says_why():
    async def scenario(rig: Rig) -> None:
        async with rig.viewer() as viewer:
            await viewer.live.send_str('{"n":1,"ability":"bad","what":"x"}')
            assert (await viewer.until("answer"))["text"] == "the wire is cut: mend it"

    run(scenario, abilities=(Bad(BusError("the wire is cut: mend it")),))


@pytest.mark.parametrize(
    ("what", "why", "code"),
    [
        ("{", "malformed", 1007),
        ("", "malformed", 1007),
        ("[]", "malformed", 1007),
        ('{"n":"x"}', "malformed", 1007),
        ('{"values":3}', "malformed", 1007),
        ("[" * 4000, "malformed", 1007),
        ("x" * 4097, "oversized", 1009),
        ('{"ability":"' + "x" * 5000 + '"}', "oversized", 1009),
        (b"\x00\x01", "binary", 1003),
    ],
)
def test_a_viewer_that_says_what_the_page_never_says_is_closed_and_counted_and_the_others_go_on(what, why, code):
    async def scenario(rig: Rig) -> None:
        async with rig.viewer() as other, rig.viewer() as stranger:
            await other.until("status")
            await (stranger.live.send_bytes(what) if isinstance(what, bytes) else stranger.live.send_str(what))
            assert await stranger.ended() == code
            rig.message()
            await other.until("message")
            assert rig.dropped == {why: 1}

    run(scenario)


def test_broken_frames_close_the_socket_and_nothing_else():
    async def scenario(rig: Rig) -> None:
        async with rig.viewer() as other:
            for bad in (
                b"\xff\xff\xff\xff",
                b"\x81\x05hello",
                b"\x81\xfe\xff\xff",
                b"\x83\x80\x00\x00\x00\x00",
                b"\x81\xff" + b"\xff" * 8,
            ):
                stranger = await deaf(rig)
                await asyncio.get_running_loop().sock_sendall(stranger, bad)
                stranger.close()
                assert await eventually(lambda: len(rig.page.viewers) == 1)
            rig.message()
            await other.until("message")

    run(scenario)


def test_a_viewer_that_asks_without_end_is_closed():
    async def scenario(rig: Rig) -> None:
        async with rig.viewer() as viewer:
            for i in range(server.MOST_FRAMES + 1):
                await viewer.live.send_str(f'{{"ping":{i}}}')
            assert await viewer.ended() == 1008
            assert rig.dropped == {"flood": 1}

    run(scenario)


def test_a_viewer_that_never_reads_is_dropped_and_the_others_go_on():
    async def scenario(rig: Rig) -> None:
        stalled = await deaf(rig)
        long = ["x" * 2000]
        async with rig.viewer() as other:
            await other.until("status")
            began_s = asyncio.get_running_loop().time()
            while not rig.dropped:
                rig.message(flags=long)
                await other.until("message")
                rig.t_ms += 30
                assert asyncio.get_running_loop().time() - began_s < 30
            assert rig.dropped == {"stalled": 1} and len(rig.page.viewers) == 1
            assert rig.page.viewers.lost > 0
            assert not [frame for frame in other.got if frame["is"] == "history"][1:]
        stalled.close()

    run(scenario, waits={"stalled_s": 0.5})


def test_a_viewer_that_answers_no_ping_is_gone():
    async def scenario(rig: Rig) -> None:
        silent = await deaf(rig)
        assert await eventually(lambda: not len(rig.page.viewers))
        assert rig.dropped == {"silent": 1}
        silent.close()

    run(scenario, waits={"heartbeat_s": 0.3})


def test_what_a_slow_viewer_lost_is_in_the_next_message_it_gets():
    async def scenario(rig: Rig) -> None:
        slow = await deaf(rig)
        loop = asyncio.get_running_loop()
        n = 0
        while not rig.page.viewers.lost:
            rig.message(flags=["x" * 3000])
            rig.t_ms += 30
            n += 1
            assert n < 2000
        rig.message(flags=["gap"], gap_ns=5)
        rig.t_ms += 30
        got = b""
        while b'"gap_ns":5,' not in got:
            chunk = await asyncio.wait_for(loop.sock_recv(slow, 1 << 20), 10)
            got += chunk
            if not chunk:
                raise AssertionError("it was dropped")
            rig.message()
            rig.t_ms += 30
        slow.close()

    run(scenario)


def test_the_viewer_too_many_is_told_so_and_counted():
    async def scenario(rig: Rig) -> None:
        async with rig.viewer() as one, rig.viewer():
            await one.until("status")
            with pytest.raises(aiohttp.WSServerHandshakeError) as refused:
                async with rig.viewer():
                    pass
            assert refused.value.status == 503
            assert b"raise web.viewers" in (await rig.ask("/live")).body
            assert rig.refused == {"viewers": 2}
        assert await eventually(lambda: not len(rig.page.viewers))
        async with rig.viewer() as again:
            await again.until("status")

    run(scenario, viewers=2)


def test_of_many_that_come_at_once_no_more_than_there_are_places_look_on(monkeypatch):
    monkeypatch.setattr("quavelet.sinks.listener.REST_S", 0.0)

    async def scenario(rig: Rig) -> None:
        most = 0

        async def look_on() -> None:
            nonlocal most
            with contextlib.suppress(aiohttp.WSServerHandshakeError, TypeError):
                async with rig.viewer() as viewer:
                    await viewer.until("status")
                    most = max(most, len(rig.page.viewers))
                    await asyncio.sleep(0.1)

        await asyncio.gather(*(look_on() for _ in range(12)))
        assert most == 3 and rig.refused == {"viewers": 9}

    run(scenario, viewers=3)


def test_of_two_hundred_connections_those_above_the_limit_are_turned_away_and_a_viewer_goes_on(monkeypatch):
    # In earnest the listener rests 20 ms after each: that is held elsewhere, and would take four seconds here.
    monkeypatch.setattr("quavelet.sinks.listener.REST_S", 0.001)
    monkeypatch.setattr("quavelet.sinks.listener.QUEUE", 256)

    async def scenario(rig: Rig) -> None:
        async with rig.viewer() as viewer:
            await viewer.until("status")
            others = [await asyncio.open_connection("127.0.0.1", rig.page.port) for _ in range(200)]
            assert await eventually(lambda: rig.refused["connections"] == 200 - server.MOST_CONNECTIONS + 1)
            rig.message()
            await viewer.until("message")
            for _, writer in others:
                writer.close()
            told = [await reader.read() for reader, _ in others]
            assert sum(b"503" in words for words in told) == 200 - server.MOST_CONNECTIONS + 1
        assert (await rig.ask("/")).code == 200

    run(scenario)


def test_a_connection_that_asks_nothing_is_closed():
    async def scenario(rig: Rig) -> None:
        for beginning in (b"", b"GET / HT", b"POST /login HTTP/1.1\r\nHost: localhost\r\nContent-Length: 50\r\n\r\nx"):
            reader, writer = await asyncio.open_connection("127.0.0.1", rig.page.port)
            writer.write(beginning)
            await asyncio.wait_for(reader.read(), 20)
            writer.close()

    run(scenario, waits={"patience_s": 0.3})


def test_a_status_that_cannot_be_given_ends_nothing(caplog):
    async def scenario(rig: Rig) -> None:
        async with rig.viewer() as viewer:
            await viewer.until("status")
            rig.page._status = broken
            assert await eventually(lambda: bool(caplog.records))
            rig.message()
            await viewer.until("message")
            await viewer.live.send_str('{"ping":1}')
            await viewer.until("pong")

    run(scenario)
    assert len(caplog.records) == 1


def broken() -> Status:
    raise RuntimeError("x")


def test_what_the_program_says_reaches_all_and_who_comes_later():
    async def scenario(rig: Rig) -> None:
        async with rig.viewer() as viewer:
            await viewer.until("status")
            await asyncio.to_thread(rig.page.tell, "the chip is gone: plug it in")
            assert (await viewer.until("talk"))["text"] == "the chip is gone: plug it in"
        async with rig.viewer() as later:
            await later.until("talk", text="the chip is gone: plug it in")

    run(scenario)


def test_when_the_page_ends_its_viewers_are_closed():
    async def scenario(rig: Rig) -> None:
        async with rig.viewer() as viewer:
            await viewer.until("status")
            await rig.page.close()
            await viewer.ended()

    run(scenario)


def open_files() -> int:
    return len(list(Path("/proc/self/fd").iterdir()))


@pytest.mark.parametrize("most", [150, pytest.param(1000, marks=pytest.mark.slow)])
def test_viewers_that_come_and_go_leave_nothing_behind(monkeypatch, most):
    monkeypatch.setattr("quavelet.sinks.listener.REST_S", 0.0)

    async def scenario(rig: Rig) -> None:
        for _ in range(100):
            rig.message()

        async def come_and_go(times: int) -> None:
            for i in range(times):
                other = socket.create_connection(("127.0.0.1", rig.page.port))
                other.setblocking(False)
                loop = asyncio.get_running_loop()
                await loop.sock_sendall(other, HELLO % (rig.page.port, rig.page.port))
                await loop.sock_recv(other, 1000)
                if i % 3 == 0:
                    await loop.sock_sendall(other, b"\x88\x80\x00\x00\x00\x00")
                other.close()
                assert await eventually(lambda: len(rig.page.viewers) < 8)
            assert await eventually(lambda: not len(rig.page.viewers) and not rig.page.connections)

        await come_and_go(50)
        gc.collect()
        files, memory = open_files(), tracemalloc.get_traced_memory()[0]
        await come_and_go(most)
        gc.collect()
        assert open_files() <= files
        assert tracemalloc.get_traced_memory()[0] - memory < 200_000

    tracemalloc.start()
    try:
        run(scenario)
    finally:
        tracemalloc.stop()


@pytest.mark.parametrize("length", [0, 125, 126, 65_535, 65_536])
def test_frames_of_any_length_are_what_the_rfc_says(length):
    async def scenario(rig: Rig) -> None:
        async with rig.viewer() as viewer:
            await viewer.until("status")
            rig.page.viewers.send(text_frame(b'"' + b"x" * length + b'"'))
            async with asyncio.timeout(10):
                assert len(await viewer.live.receive_str()) == length + 2

    run(scenario)
