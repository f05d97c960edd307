"""A page on a port of its own, its abilities, and what browsers and strangers do to it over real sockets."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import AsyncIterator, Awaitable, Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

import aiohttp
import msgspec
from output_plans import MESSAGE, STATUS

from quavelet.core.clock import VirtualClock
from quavelet.core.units import NS_PER_MS
from quavelet.settings import WebSettings
from quavelet.sinks.message import Message
from quavelet.web.ability import Ability
from quavelet.web.page import WebPage

MESSAGE_MS = 10
HERE, ANYWHERE = "127.0.0.1:0", "0.0.0.0:0"


class Noting:
    """An ability that notes what it is asked."""

    def __init__(self, name: str = "note") -> None:
        self.name = name
        self.seen = 0
        self.done: list[tuple[str, Mapping[str, object]]] = []
        self.closed = 0

    def about(self) -> object:
        return {"what": ["note"]}

    def state(self) -> object:
        return {"done": len(self.done)}

    def see(self, message: Message) -> None:
        del message
        self.seen += 1

    def do(self, what: str, values: Mapping[str, object]) -> str:
        if what == "refuse":
            raise ValueError("that cannot be: ask for another")
        self.done.append((what, values))
        return f"{what} is noted"

    def close(self) -> None:
        self.closed += 1


class Bad(Noting):
    """One with a mistake in each of its methods."""

    def __init__(self, error: Exception, name: str = "bad") -> None:
        super().__init__(name)
        self.error = error

    def about(self) -> object:
        raise self.error

    def state(self) -> object:
        raise self.error

    def see(self, message: Message) -> None:
        del message
        raise self.error

    def do(self, what: str, values: Mapping[str, object]) -> str:
        del what, values
        raise self.error


class Filing(Noting):
    """One with files."""

    def __init__(self, files: Mapping[str, Path]) -> None:
        super().__init__("record")
        self.files = files

    def open_file(self, name: str) -> Path | None:
        return self.files.get(name)


@dataclass
class Rig:
    """An open page; `t_ms` is the time of the next message."""

    page: WebPage
    said: list[str]
    t_ms: int = 1000

    @property
    def origin(self) -> str:
        return f"http://127.0.0.1:{self.page.port}"

    @property
    def refused(self) -> Mapping[str, int]:
        return self.page.viewers.refused

    @property
    def dropped(self) -> Mapping[str, int]:
        return self.page.viewers.dropped

    def message(self, **fields: object) -> Message:
        """The next one, 10 ms after the one before, through the page."""
        message = msgspec.structs.replace(MESSAGE, **{"t_ns": self.t_ms * NS_PER_MS, **fields})
        self.t_ms += MESSAGE_MS
        self.page.write(message)
        return message

    async def raw(self, request: bytes) -> bytes:
        """What comes back until the other side closes."""
        reader, writer = await asyncio.open_connection("127.0.0.1", self.page.port)
        try:
            writer.write(request)
            async with asyncio.timeout(20):
                return await reader.read()
        except ConnectionError:
            return b""
        finally:
            writer.close()

    async def ask(
        self, path: str, *, method: str = "GET", host: str | None = None, body: bytes = b"", **headers: str
    ) -> Answer:
        """One request, its path to the letter; _ in a header's name is -."""
        lines = [f"{method} {path} HTTP/1.1", f"Host: {host or self.origin.removeprefix('http://')}"]
        lines += ["Connection: close", *(f"{name.replace('_', '-')}: {value}" for name, value in headers.items())]
        if body:
            lines.append(f"Content-Length: {len(body)}")
        return answer_of(await self.raw("\r\n".join((*lines, "", "")).encode() + body))

    async def login(self, token: str, *, origin: str | None = None) -> Answer:
        body = msgspec.json.encode({"token": token})
        return await self.ask("/login", method="POST", body=body, Origin=origin or self.origin)

    async def cookie(self) -> str:
        """As a browser sends it, once the printed token was given."""
        given = await self.login(token_in(self.said))
        assert given.code == 204
        return given.headers["set-cookie"].partition(";")[0]

    @contextlib.asynccontextmanager
    async def viewer(self, *, origin: str | None = None, **headers: str) -> AsyncIterator[Watching]:
        """A browser's websocket."""
        async with (
            aiohttp.ClientSession() as session,
            session.ws_connect(f"{self.origin}/live", origin=origin or self.origin, headers=headers) as live,
        ):
            yield Watching(live)


class Watching:
    """A viewer, and what it has got."""

    def __init__(self, live: aiohttp.ClientWebSocketResponse) -> None:
        self.live = live
        self.got: list[dict[str, object]] = []

    async def until(self, kind: str, **fields: object) -> dict[str, object]:
        """The next frame of that kind with those fields."""
        async with asyncio.timeout(20):
            while True:
                frame = await self.live.receive_json()
                self.got.append(frame)
                if frame["is"] == kind and all(frame.get(key) == value for key, value in fields.items()):
                    return frame

    async def ended(self) -> int | None:
        """With which code."""
        async with asyncio.timeout(20):
            while not self.live.closed:
                await self.live.receive()
        return self.live.close_code


@dataclass(frozen=True)
class Answer:
    code: int
    headers: Mapping[str, str]
    body: bytes


def answer_of(whole: bytes) -> Answer:
    head, _, body = whole.partition(b"\r\n\r\n")
    first, *lines = head.decode().split("\r\n")
    headers = {name.lower(): value.strip() for name, _, value in (line.partition(":") for line in lines)}
    return Answer(int(first.split(" ")[1]) if first else 0, headers, body)


def token_in(said: list[str]) -> str:
    (line,) = [line for line in said if "#token=" in line]
    return line.rpartition("#token=")[2]


def run(
    scenario: Callable[[Rig], Awaitable[None]],
    *,
    abilities: tuple[Ability, ...] = (),
    environ: Mapping[str, str] | None = None,
    waits: Mapping[str, float] | None = None,
    **settings: object,
) -> Rig:
    """The scenario with an open page; afterwards nothing of it may be left."""

    async def whole() -> Rig:
        said: list[str] = []
        page = WebPage(
            msgspec.structs.replace(WebSettings(listen=HERE), **settings),
            src="fake:tilt",
            name="imu",
            status=lambda: STATUS,
            abilities=abilities,
            talk=said.append,
            clock=VirtualClock(),
            environ=environ or {},
            **(waits or {}),
        )
        await page.open()
        rig = Rig(page, said)
        try:
            async with asyncio.timeout(60):
                await scenario(rig)
        finally:
            await page.close()
        await eventually(lambda: asyncio.all_tasks() == {asyncio.current_task()})
        assert asyncio.all_tasks() == {asyncio.current_task()}
        return rig

    return asyncio.run(whole())


async def eventually(what: Callable[[], bool], *, within_s: float = 10.0) -> bool:
    """Whether it comes about."""
    deadline_s = asyncio.get_running_loop().time() + within_s
    while not what():
        if asyncio.get_running_loop().time() > deadline_s:
            return False
        await asyncio.sleep(0.02)
    return True
