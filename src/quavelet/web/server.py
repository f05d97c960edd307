"""HTTP and the websocket, with aiohttp: requests to a fixed table, and what is refused, counted by its reason.

Every answer has the headers of `access.HEADERS`; nothing is changed but by a frame of the websocket and by /login.
"""

from __future__ import annotations

import asyncio
import logging
import socket
from collections import deque
from collections.abc import Mapping
from contextlib import suppress
from typing import TYPE_CHECKING
from urllib.parse import quote, unquote

import msgspec
from aiohttp import WebSocketError, WSCloseCode, WSMsgType, web

from quavelet.sinks.listener import Listener, tcp_sockets
from quavelet.web.access import ALONE, HEADERS, Access
from quavelet.web.assets import INDEX, LOGIN, Asset
from quavelet.web.viewers import Viewer

if TYPE_CHECKING:
    from quavelet.web.page import WebPage

log = logging.getLogger(__name__)
_NO_LOG = logging.Logger("nobody", logging.CRITICAL)
"""Who asks for what is not written down."""

MOST_CONNECTIONS = 64
MOST_DOWNLOADS = 4
LONGEST_FRAME_BYTES = 4096
"""Of what a viewer says."""
MOST_FRAMES, FRAMES_S = 100, 5.0
"""A viewer that says more in that time is no page of ours."""
LONGEST_LOGIN_BYTES = 2048
KERNEL_BYTES = 65_536
"""What the kernel keeps for one viewer; more would be shown late."""
CHUNK_BYTES = 262_144
CLOSE_S = 0.5


class Server:
    """Listens while it is open, on the running loop.

    patience_s    a connection that asks nothing for so long, or does not take what it asked for, is cut off
    heartbeat_s   a viewer that says nothing for so long is pinged, and is gone if it does not answer in half of it
    """

    def __init__(
        self, page: WebPage, access: Access, assets: Mapping[str, Asset], *, patience_s: float, heartbeat_s: float
    ) -> None:
        self._page = page
        self._access = access
        self._assets = assets
        self._patience_s = patience_s
        self._heartbeat_s = heartbeat_s
        self._refused = page.viewers.refused
        self._listener: Listener | None = None
        self._downloads = 0
        self._http = web.Server(self._handle)

    @property
    def port(self) -> int:
        assert self._listener is not None
        return self._listener.port

    @property
    def connections(self) -> int:
        """That are open."""
        return len(self._http.connections)

    async def open(self, host: str, port: int) -> None:
        """Raises OSError."""
        sockets = await tcp_sockets(host, port)
        for sock in sockets:
            # What is accepted has it from the socket that listens.
            sock.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, KERNEL_BYTES)
        self._listener = Listener(f"the page on {host}:{port}", sockets, self._connection)

    async def close(self) -> None:
        if self._listener is not None:
            listener, self._listener = self._listener, None
            await listener.close()
        await self._http.shutdown(CLOSE_S)

    def _connection(self) -> asyncio.Protocol:
        if self.connections >= MOST_CONNECTIONS:
            self._refused["connections"] += 1
            return _TurnedAway()
        return _Connection(self._http, patience_s=self._patience_s)

    async def _handle(self, request: web.BaseRequest) -> web.StreamResponse:
        """Answer, and see to it that the answer is taken: what waits for it holds a place."""
        transport = request.transport
        if isinstance(request.protocol, _Connection):
            request.protocol.asked()
        answer = await self._answer(request)
        if isinstance(answer, web.Response):
            if not self._access.token:
                answer.headers.add(*ALONE)
            try:
                async with asyncio.timeout(self._patience_s):
                    await answer.prepare(request)
                    await answer.write_eof()
            except TimeoutError:
                self._page.viewers.dropped["slow"] += 1
                if transport is not None:
                    transport.abort()
        return answer

    async def _answer(self, request: web.BaseRequest) -> web.StreamResponse:
        why = self._access.refusal_of_host(request.headers.getall("Host", []))
        if why:
            return self._refuse("host", 403, why)
        path = request.raw_path.partition("?")[0]
        if path == "/login":
            return await self._login(request)
        if request.method not in ("GET", "HEAD"):
            return self._refuse("method", 405, "ask with GET", Allow="GET, HEAD")
        if path == "/":
            return self._asset(request, INDEX if self._is_known(request) else LOGIN)
        if path.startswith("/assets/"):
            return self._asset(request, path.removeprefix("/assets/"))
        if path == "/live":
            return await self._live(request)
        if path.startswith("/recordings/"):
            return await self._download(request, unquote(path.removeprefix("/recordings/")))
        return _text(404, "there is nothing here")

    def _refuse(self, reason: str, status: int, text: str, **headers: str) -> web.Response:
        self._refused[reason] += 1
        return _text(status, text, **headers)

    def _is_known(self, request: web.BaseRequest) -> bool:
        return self._access.is_known(request.cookies)

    def _is_of_this_page(self, request: web.BaseRequest) -> bool:
        return self._access.is_of_this_page(request.headers.getall("Origin", []), request.headers["Host"])

    def _asset(self, request: web.BaseRequest, name: str) -> web.Response:
        asset = self._assets.get(name)
        if asset is None:
            return _text(404, "there is nothing here")
        is_page = name in (INDEX, LOGIN)
        headers = {**HEADERS, "Cache-Control": "no-store" if is_page else "no-cache", "ETag": asset.etag}
        if not is_page and request.headers.get("If-None-Match") == asset.etag:
            return web.Response(status=304, headers=headers)
        headers |= {"Content-Type": asset.content_type, "Vary": "Accept-Encoding"}
        if asset.gzipped and "gzip" in request.headers.get("Accept-Encoding", ""):
            return web.Response(body=asset.gzipped, headers={**headers, "Content-Encoding": "gzip"})
        return web.Response(body=asset.body, headers=headers)

    async def _login(self, request: web.BaseRequest) -> web.Response:
        if request.method != "POST":
            return self._refuse("method", 405, "ask with POST", Allow="POST")
        if not self._is_of_this_page(request):
            return self._refuse("origin", 403, "only the page itself may do that")
        body = await self._body(request)
        if body is None or not self._access.is_token(_token_in(body)):
            return self._refuse("token", 403, "That is not the token.")
        return web.Response(status=204, headers={**HEADERS, "Set-Cookie": self._access.set_cookie})

    async def _body(self, request: web.BaseRequest) -> bytes | None:
        """None where it is too long, or does not come."""
        body = b""
        with suppress(TimeoutError):
            async with asyncio.timeout(self._patience_s):
                while chunk := await request.content.readany():
                    body += chunk
                    if len(body) > LONGEST_LOGIN_BYTES:
                        return None
                return body
        return None

    async def _download(self, request: web.BaseRequest, name: str) -> web.StreamResponse:
        """A file as long as it is at this moment; the disk is waited for on a thread of its own."""
        if not self._is_known(request):
            return self._refuse("token", 401, "give the token first")
        path = self._page.file(name)
        if path is None:
            return _text(404, "there is no such recording")
        if self._downloads >= MOST_DOWNLOADS:
            return self._refuse("downloads", 503, "others download already: try again later")
        self._downloads += 1
        try:
            file = await asyncio.to_thread(path.open, "rb")
            with file:
                size = await asyncio.to_thread(file.seek, 0, 2)
                await asyncio.to_thread(file.seek, 0)
                answer = web.StreamResponse(headers=_headers_of_download(name))
                answer.content_length = size
                await answer.prepare(request)
                while request.method == "GET" and size > 0:
                    chunk = await asyncio.to_thread(file.read, min(size, CHUNK_BYTES))
                    if not chunk:
                        break
                    size -= len(chunk)
                    async with asyncio.timeout(self._patience_s):
                        await answer.write(chunk)
                if size and request.method == "GET":
                    answer.force_close()
                return answer
        except FileNotFoundError:
            return _text(404, "there is no such recording")
        except TimeoutError:
            self._page.viewers.dropped["slow"] += 1
            if request.transport is not None:
                request.transport.abort()
            raise ConnectionResetError("it does not take what it asked for") from None
        finally:
            self._downloads -= 1

    async def _live(self, request: web.BaseRequest) -> web.StreamResponse:
        if not self._is_known(request):
            return self._refuse("token", 401, "give the token first")
        is_asked = "Upgrade" in request.headers
        if is_asked and not self._is_of_this_page(request):
            return self._refuse("origin", 403, "only the page itself may look on")
        if self._page.viewers.is_full:
            return self._refuse(
                "viewers", 503, "Too many look on already: close the page elsewhere, or raise web.viewers."
            )
        said = web.WebSocketResponse(
            heartbeat=self._heartbeat_s, max_msg_size=LONGEST_FRAME_BYTES, compress=False, timeout=CLOSE_S
        )
        # A subprotocol that we do not speak would be a line in the log for each who asks.
        if "Sec-WebSocket-Protocol" in request.headers or not said.can_prepare(request).ok:
            return self._refuse("handshake", 426, "this is a websocket of version 13", Upgrade="websocket")
        said.headers.update(HEADERS)
        await said.prepare(request)
        if request.transport is not None:
            await self._look_on(said, request.transport)
        return said

    async def _look_on(self, said: web.WebSocketResponse, transport: asyncio.Transport) -> None:
        viewers = self._page.viewers
        if viewers.is_full:
            # Others came while hands were shaken.
            self._refused["viewers"] += 1
            await said.close(code=WSCloseCode.TRY_AGAIN_LATER)
            return
        viewer = Viewer(transport, lambda: not said.closed, now_s=asyncio.get_running_loop().time())
        viewers.join(viewer)
        try:
            self._page.greet(viewer)
            why, code = await self._hear(said, viewer)
            if viewers.leave(viewer) and why:
                viewers.dropped[why] += 1
            if code:
                await said.close(code=code)
        finally:
            viewers.leave(viewer)
            if transport.get_write_buffer_size():
                # It would be held open until the other side took what it does not take.
                transport.abort()

    async def _hear(self, said: web.WebSocketResponse, viewer: Viewer) -> tuple[str, int]:
        """Until it ends: why, "" where it simply left, and with which code it is still to be closed."""
        loop = asyncio.get_running_loop()
        times_s: deque[float] = deque(maxlen=MOST_FRAMES)
        async for frame in said:
            if frame.type is WSMsgType.BINARY:
                return "binary", 1003
            if frame.type is not WSMsgType.TEXT:
                # aiohttp has closed it already.
                return _why(frame.data), 0
            if len(times_s) == MOST_FRAMES and loop.time() - times_s[0] < FRAMES_S:
                return "flood", 1008
            times_s.append(loop.time())
            try:
                self._page.heard(viewer, frame.data)
            except ValueError:
                return "malformed", 1007
        return ("", 0) if said.exception() is None else (_why(said.exception()), 0)


class _Connection(web.RequestHandler):
    """One that says what is wrong in our words only, and with our headers, and ends where nothing is asked."""

    __slots__ = ("_patience", "_patience_s")

    def __init__(self, manager: web.Server, *, patience_s: float) -> None:
        super().__init__(
            manager,
            loop=asyncio.get_running_loop(),
            access_log=_NO_LOG,
            logger=log,
            keepalive_timeout=patience_s,
            lingering_time=0.0,
        )
        self._patience_s = patience_s
        self._patience: asyncio.TimerHandle | None = None

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        super().connection_made(transport)
        # Not each aiohttp waits for the first request only so long.
        self._patience = asyncio.get_running_loop().call_later(self._patience_s, self.force_close)

    def asked(self) -> None:
        """A request is there."""
        if self._patience is not None:
            self._patience.cancel()
            self._patience = None

    def connection_lost(self, exc: BaseException | None) -> None:
        self.asked()
        super().connection_lost(exc)

    def handle_error(
        self,
        request: web.BaseRequest,
        status: int = 500,
        exc: BaseException | None = None,
        message: str | None = None,
    ) -> web.StreamResponse:
        del message
        if request.writer.output_size:
            raise ConnectionError("an answer is on its way already")
        if status >= 500:
            log.error("the page could not answer", exc_info=exc)
        answer = _text(status, "that is no request" if status < 500 else "the log says why")
        answer.force_close()
        return answer


class _TurnedAway(asyncio.Protocol):
    """A connection too many."""

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        assert isinstance(transport, asyncio.Transport)
        body = b"too many connections: try again later\n"
        head = [b"HTTP/1.1 503 Service Unavailable", b"Connection: close", b"Content-Length: %d" % len(body)]
        head += [f"{name}: {value}".encode() for name, value in HEADERS.items()]
        transport.write(b"\r\n".join((*head, b"", body)))
        transport.close()


def _text(status: int, text: str, **headers: str) -> web.Response:
    return web.Response(status=status, text=f"{text}\n", headers={**HEADERS, "Cache-Control": "no-store", **headers})


def _why(error: object) -> str:
    """For what aiohttp has closed a websocket, in a word; "" for one that is simply gone, as of a closed tab."""
    if isinstance(error, WebSocketError):
        return {WSCloseCode.MESSAGE_TOO_BIG: "oversized", WSCloseCode.INVALID_TEXT: "malformed"}.get(
            WSCloseCode(error.code), "broken"
        )
    if isinstance(error, TimeoutError):
        return "silent"
    return "" if isinstance(error, OSError) else "broken"


def _headers_of_download(name: str) -> dict[str, str]:
    return {
        **HEADERS,
        "Cache-Control": "no-store",
        "Content-Type": "application/octet-stream",
        "Content-Disposition": f"attachment; filename*=UTF-8''{quote(name, safe='')}",
    }


def _token_in(body: bytes) -> str:
    """Of {"token": ...}; "" where there is none."""
    try:
        return msgspec.json.decode(body, type=dict[str, str]).get("token", "")
    except (msgspec.DecodeError, RecursionError, UnicodeError):
        return ""
