"""The service's figures as Prometheus reads them (text format 0.0.4), and the place where it asks for them.

    [service]
    metrics = "127.0.0.1:9650"

It answers `GET /metrics` and nothing else, one request a connection. What asks wrongly, slowly or at too great length
is told so by its status code, or cut off, and is counted by that code.
"""

from __future__ import annotations

import asyncio
import logging
from collections import Counter
from collections.abc import Callable

from quavelet.sinks.message import Message
from quavelet.sinks.metrics_text import metrics_text
from quavelet.sinks.status import Status

log = logging.getLogger(__name__)

LONGEST_REQUEST_BYTES = 8192
MOST_CONNECTIONS = 16
PATIENCE_S = 5.0
"""For the whole request, and again for the whole answer to be taken."""
_REASONS = {
    "200": "OK",
    "400": "Bad Request",
    "404": "Not Found",
    "405": "Method Not Allowed",
    "408": "Request Timeout",
    "431": "Request Header Fields Too Large",
    "500": "Internal Server Error",
    "503": "Service Unavailable",
}
_PLAIN = "text/plain; charset=utf-8"
_METRICS = "text/plain; version=0.0.4; charset=utf-8"


class MetricsEndpoint:
    """Listens on `host` and `port` (0: any free one) while it is open; runs on the network's thread.

    status       the service as it is at this moment
    patience_s   how long a request may take to come, and the answer to be taken
    answers      how many of each status code; "none" where the other side went before it had asked
    """

    name = "metrics"

    def __init__(self, host: str, port: int, *, status: Callable[[], Status], patience_s: float = PATIENCE_S) -> None:
        self.answers: Counter[str] = Counter()
        self._host, self._port = host, port
        self._status = status
        self._patience_s = patience_s
        self._server: asyncio.Server | None = None
        self._tasks: set[asyncio.Task[None]] = set()

    @property
    def port(self) -> int:
        """Where it listens, once it is open."""
        return int(self._server.sockets[0].getsockname()[1]) if self._server and self._server.sockets else self._port

    @property
    def waiting(self) -> int:
        """Connections that are open."""
        return len(self._tasks)

    async def open(self) -> None:
        """Begin to listen. Raises OSError where the address is taken or not ours."""
        self._server = await asyncio.start_server(self._accept, self._host, self._port, limit=LONGEST_REQUEST_BYTES)

    def write(self, message: Message) -> bool:
        """Figures are asked for: a message by itself sends none."""
        del message
        return False

    async def close(self) -> None:
        """Stop listening and cut off whoever is connected."""
        if self._server is not None:
            self._server.close()
            self._server = None
        tasks = tuple(self._tasks)
        for task in tasks:
            task.cancel()
        if tasks:
            await asyncio.wait(tasks)

    def _accept(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        task = asyncio.get_running_loop().create_task(self._serve(reader, writer))
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)

    async def _serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        # Nothing stays behind: drain returns when all of the answer is the kernel's.
        writer.transport.set_write_buffer_limits(0)
        try:
            code = "503" if len(self._tasks) > MOST_CONNECTIONS else await self._code(reader)
            self.answers[code] += 1
            if code != "none":
                writer.write(_answer(*self._body(code)))
                async with asyncio.timeout(self._patience_s):
                    await writer.drain()
            writer.close()
        except (OSError, TimeoutError):
            pass  # Whoever asked has gone, or does not take the answer.
        finally:
            if not writer.is_closing():
                writer.transport.abort()

    async def _code(self, reader: asyncio.StreamReader) -> str:
        try:
            async with asyncio.timeout(self._patience_s):
                head = await reader.readuntil(b"\r\n\r\n")
        except TimeoutError:
            return "408"
        except asyncio.LimitOverrunError:
            return "431"
        except (asyncio.IncompleteReadError, OSError):
            return "none"
        return code_of(head)

    def _body(self, code: str) -> tuple[str, str]:
        if code != "200":
            return code, f"{code} {_REASONS[code]}: ask with GET /metrics\n"
        try:
            return code, metrics_text(self._status(), answers=self.answers)
        except Exception:
            log.exception("the service's figures could not be given")
            self.answers["500"] += 1
            return "500", "500 the log says why\n"


def code_of(head: bytes) -> str:
    """The status code that answers a request beginning so."""
    words = head.split(b"\r\n", 1)[0].split(b" ")
    if len(words) != 3 or not words[2].startswith(b"HTTP/1.") or not words[1].startswith(b"/"):
        return "400"
    if words[1].partition(b"?")[0] != b"/metrics":
        return "404"
    return "200" if words[0] == b"GET" else "405"


def _answer(code: str, body: str) -> bytes:
    data = body.encode("utf-8", "replace")
    lines = [
        f"HTTP/1.1 {code} {_REASONS[code]}",
        f"Content-Type: {_METRICS if code == '200' else _PLAIN}",
        f"Content-Length: {len(data)}",
        *(["Allow: GET"] if code == "405" else []),
        "Connection: close",
    ]
    return "\r\n".join((*lines, "", "")).encode("ascii") + data
