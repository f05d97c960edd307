"""HTTP and the websocket, with aiohttp: requests to a fixed table, and what is refused, counted by its reason.

Every answer has the headers of `access.HEADERS`; nothing is changed but by a frame of the websocket and by /login.
"""

from __future__ import annotations

import asyncio
import logging
import socket
from collections.abc import Mapping
from typing import TYPE_CHECKING

import msgspec
from aiohttp import WSMsgType, web

from quavelet.sinks.listener import Listener, tcp_sockets
from quavelet.web.access import HEADERS, Access
from quavelet.web.assets import INDEX, LOGIN, Asset
from quavelet.web.viewers import Viewer

if TYPE_CHECKING:
    from quavelet.web.page import WebPage

log = logging.getLogger(__name__)
_NO_LOG = logging.Logger("nobody", logging.CRITICAL)
"""Who asks for what is not written down."""

MOST_CONNECTIONS = 64
LONGEST_FRAME_BYTES = 4096
"""Of what a viewer says."""
LONGEST_LOGIN_BYTES = 2048
KERNEL_BYTES = 65_536
"""What the kernel keeps for one viewer; more would be shown late."""
IDLE_S = 10.0
"""A connection that asks nothing for so long is closed."""
ANSWER_S = 30.0
"""An answer that is not taken in that time is given up."""
HEARTBEAT_S = 10.0
"""A viewer that says nothing for so long is pinged, and is gone if it does not answer in half of it."""
CLOSE_S = 0.5
_CLOSED_FOR = {1006: "silent", 1007: "malformed", 1009: "oversized"}


class Server:
    """Listens while it is open, on the running loop."""

    def __init__(self, page: WebPage, access: Access, assets: Mapping[str, Asset]) -> None:
        self._page = page
        self._access = access
        self._assets = assets
        self._listener: Listener | None = None
        self._http = web.Server(self._handle)

    @property
    def port(self) -> int:
        assert self._listener is not None
        return int(self._listener.sockets[0].getsockname()[1])

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
        if len(self._http.connections) >= MOST_CONNECTIONS:
            self._page.viewers.refused["connections"] += 1
            return _TurnedAway()
        return _Connection(
            self._http,
            loop=asyncio.get_running_loop(),
            access_log=_NO_LOG,
            logger=log,
            keepalive_timeout=IDLE_S,
        )

    async def _handle(self, request: web.BaseRequest) -> web.StreamResponse:
        refused = self._page.viewers.refused
        why = self._access.refusal_of_host(request.headers.getall("Host", []))
        if why:
            refused["host"] += 1
            return _answer(403, why)
        path = request.raw_path.partition("?")[0]
        if path == "/login":
            return await self._login(request)
        if request.method not in ("GET", "HEAD"):
            refused["method"] += 1
            return _answer(405, "ask with GET", Allow="POST" if path == "/login" else "GET, HEAD")
        is_known = self._access.is_known(request.cookies)
        if path == "/":
            return self._asset(request, INDEX if is_known else LOGIN)
        if path.startswith("/assets/"):
            return self._asset(request, path.removeprefix("/assets/"))
        if path == "/live":
            return await self._live(request, is_known)
        return _answer(404, "there is nothing here")

    def _asset(self, request: web.BaseRequest, name: str) -> web.StreamResponse:
        asset = self._assets.get(name)
        is_page = name in (INDEX, LOGIN)
        if asset is None:
            return _answer(404, "there is nothing here")
        headers = {"Cache-Control": "no-store" if is_page else "no-cache", "ETag": asset.etag}
        if not is_page and request.headers.get("If-None-Match") == asset.etag:
            return web.Response(status=304, headers={**HEADERS, **headers})
        headers["Content-Type"] = asset.content_type
        return web.Response(body=asset.body, headers={**HEADERS, **headers})

    async def _login(self, request: web.BaseRequest) -> web.StreamResponse:
        refused = self._page.viewers.refused
        if request.method != "POST":
            refused["method"] += 1
            return _answer(405, "ask with POST", Allow="POST")
        if not self._is_of_this_page(request):
            refused["origin"] += 1
            return _answer(403, "only the page itself may do that")
        body = await _body(request)
        if body is None or not self._access.is_token(_token_in(body)):
            refused["token"] += 1
            return _answer(403, "that is not the token")
        return web.Response(status=204, headers={**HEADERS, "Set-Cookie": self._access.set_cookie})

    def _is_of_this_page(self, request: web.BaseRequest) -> bool:
        return self._access.is_of_this_page(request.headers.getall("Origin", []), request.headers["Host"])

    async def _live(self, request: web.BaseRequest, is_known: bool) -> web.StreamResponse:
        page = self._page
        if not is_known:
            page.viewers.refused["token"] += 1
            return _answer(401, "give the token first")
        if not self._is_of_this_page(request):
            page.viewers.refused["origin"] += 1
            return _answer(403, "only the page itself may look on")
        if page.viewers.is_full:
            page.viewers.refused["viewers"] += 1
            return _answer(503, "too many look on already: close the page elsewhere, or raise web.viewers")
        socket_ = web.WebSocketResponse(
            heartbeat=HEARTBEAT_S, max_msg_size=LONGEST_FRAME_BYTES, compress=False, timeout=CLOSE_S
        )
        if "Sec-WebSocket-Protocol" in request.headers or not socket_.can_prepare(request).ok:
            page.viewers.refused["handshake"] += 1
            return _answer(400, "this is a websocket of version 13")
        socket_.headers.update(HEADERS)
        await socket_.prepare(request)
        transport = request.transport
        if transport is not None:
            await self._look_on(socket_, transport)
        return socket_

    async def _look_on(self, socket_: web.WebSocketResponse, transport: asyncio.Transport) -> None:
        page = self._page
        viewer = Viewer(transport, lambda: not socket_.closed, now_s=asyncio.get_running_loop().time())
        page.greet(viewer)
        try:
            why, code = await self._listen(socket_, viewer)
            if page.viewers.leave(viewer) and why:
                page.viewers.dropped[why] += 1
            if code:
                await socket_.close(code=code)
        finally:
            page.viewers.leave(viewer)
            if transport.get_write_buffer_size():
                # It would be held open until the other side took what it does not take.
                transport.abort()

    async def _listen(self, socket_: web.WebSocketResponse, viewer: Viewer) -> tuple[str, int]:
        """Until it ends: why, "" where it simply left, and with which code it is still to be closed."""
        async for said in socket_:
            if said.type is WSMsgType.BINARY:
                return "binary", 1003
            if said.type is not WSMsgType.TEXT:
                # aiohttp has closed it already, with the code that says why.
                return _CLOSED_FOR.get(socket_.close_code or 0, "broken"), 0
            try:
                self._page.heard(viewer, said.data)
            except ValueError:
                return "malformed", 1007
        return "", 0


class _Connection(web.RequestHandler):
    """One that says what is wrong in our words only, and with our headers."""

    __slots__ = ()

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
        answer = _answer(status, "that is no request" if status < 500 else "the log says why")
        answer.force_close()
        return answer


class _TurnedAway(asyncio.Protocol):
    """A connection too many."""

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        assert isinstance(transport, asyncio.Transport)
        transport.write(b"HTTP/1.1 503 Service Unavailable\r\nConnection: close\r\nContent-Length: 0\r\n\r\n")
        transport.close()


def _answer(status: int, text: str, **headers: str) -> web.Response:
    return web.Response(status=status, text=f"{text}\n", headers={**HEADERS, "Cache-Control": "no-store", **headers})


async def _body(request: web.BaseRequest) -> bytes | None:
    """None where it is too long, or does not come."""
    try:
        async with asyncio.timeout(ANSWER_S):
            body = b""
            while chunk := await request.content.readany():
                body += chunk
                if len(body) > LONGEST_LOGIN_BYTES:
                    return None
            return body
    except TimeoutError:
        return None


def _token_in(body: bytes) -> str:
    """Of {"token": ...}; "" where there is none."""
    try:
        return msgspec.json.decode(body, type=dict[str, str]).get("token", "")
    except (msgspec.DecodeError, RecursionError):
        return ""
