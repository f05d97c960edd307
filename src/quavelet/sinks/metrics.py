"""The service's figures as Prometheus reads them (text format 0.0.4), and the place where it asks for them.

    [service]
    metrics = "127.0.0.1:9650"

It answers `GET` and `HEAD` of /metrics and nothing else, one request a connection. What asks wrongly, slowly or at too
great length is told so by its status code, or cut off, and is counted by that code. A page in a browser on this network
may be of a host whose name has been made to mean this machine (DNS rebinding): who asks for a name that anybody could
have registered is refused.
"""

from __future__ import annotations

import asyncio
import logging
import re
from collections import Counter
from collections.abc import Callable
from ipaddress import ip_address
from socket import gethostname

from quavelet.sinks.listener import Listener, tcp_sockets
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
    "421": "Misdirected Request",
    "431": "Request Header Fields Too Large",
    "500": "Internal Server Error",
    "503": "Service Unavailable",
}
_HOST = re.compile(rb"(\[[0-9A-Fa-f:.]+\]|[A-Za-z0-9._-]+)(?::[0-9]*)?")
_PRIVATE = (".localhost", ".local", ".internal", ".home.arpa", ".lan")
"""Nobody can register a name that ends so: RFC 6761, 6762, 8375, and what ICANN has set aside or never gave."""
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
        self._listener: Listener | None = None
        self._tasks: set[asyncio.Task[None]] = set()
        self._silent: dict[asyncio.Timeout, None] = {}
        """Those who have not asked yet, by how long they may still take; the oldest first."""

    @property
    def port(self) -> int:
        """Where it listens, once it is open."""
        return self._listener.port if self._listener else self._port

    @property
    def waiting(self) -> int:
        """Connections that are open."""
        return len(self._tasks)

    async def open(self) -> None:
        """Begin to listen. Raises OSError where the address is taken or not ours."""
        sockets = await tcp_sockets(self._host, self._port)
        self._listener = Listener(f"metrics on {self._host}:{self._port}", sockets, self._protocol)

    def write(self, message: Message) -> bool:
        """Figures are asked for: a message by itself sends none."""
        del message
        return False

    async def close(self) -> None:
        """Stop listening and cut off whoever is connected."""
        if self._listener is not None:
            listener, self._listener = self._listener, None
            await listener.close()
        tasks = tuple(self._tasks)
        for task in tasks:
            task.cancel()
        if tasks:
            await asyncio.wait(tasks)

    def _protocol(self) -> asyncio.StreamReaderProtocol:
        return asyncio.StreamReaderProtocol(asyncio.StreamReader(limit=LONGEST_REQUEST_BYTES), self._accept)

    def _accept(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        task = asyncio.get_running_loop().create_task(self._serve(reader, writer))
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)

    async def _serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        # Nothing stays behind: drain returns when all of the answer is the kernel's.
        writer.transport.set_write_buffer_limits(0)
        try:
            full = len(self._tasks) > MOST_CONNECTIONS and not self._make_room()
            code, head = ("503", b"") if full else await self._asked(reader)
            self.answers[code] += 1
            if code != "none":
                writer.write(_answer(*self._body(code), alone=head.startswith(b"HEAD ")))
                async with asyncio.timeout(self._patience_s):
                    await writer.drain()
            writer.close()
        except (OSError, TimeoutError):
            pass  # Whoever asked has gone, or does not take the answer.
        finally:
            if not writer.is_closing():
                writer.transport.abort()

    def _make_room(self) -> bool:
        """Whoever connects and says nothing must not keep out who asks: the oldest of them has had its time."""
        oldest = next(iter(self._silent), None)
        if oldest is None:
            return False
        del self._silent[oldest]
        if not oldest.expired():
            oldest.reschedule(asyncio.get_running_loop().time())
        return True

    async def _asked(self, reader: asyncio.StreamReader) -> tuple[str, bytes]:
        """The code for a request, and the request."""
        patience = asyncio.timeout(self._patience_s)
        self._silent[patience] = None
        try:
            async with patience:
                head = await reader.readuntil(b"\r\n\r\n")
        except TimeoutError:
            return "408", b""
        except asyncio.LimitOverrunError:
            return "431", b""
        except (asyncio.IncompleteReadError, OSError):
            return "none", b""
        finally:
            self._silent.pop(patience, None)
        return code_of(head, own=(self._host, gethostname())), head

    def _body(self, code: str) -> tuple[str, str]:
        if code == "421":
            return code, f"421 {_REASONS[code]}: ask by address, or give this name in [service] metrics\n"
        if code != "200":
            return code, f"{code} {_REASONS[code]}: ask with GET /metrics\n"
        try:
            return code, metrics_text(self._status(), answers=self.answers)
        except Exception:
            log.exception("the service's figures could not be given")
            self.answers["500"] += 1
            return "500", "500 the log says why\n"


def code_of(head: bytes, *, own: tuple[str, ...] = ()) -> str:
    """The status code that answers a request beginning so; `own` are names of this machine."""
    first, *fields = head.split(b"\r\n")
    words = first.split(b" ")
    if len(words) != 3 or not words[2].startswith(b"HTTP/1.") or not words[1].startswith(b"/"):
        return "400"
    named = (field.partition(b":") for field in fields)
    hosts = [value.strip() for name, _, value in named if name.strip().lower() == b"host"]
    # RFC 9112, 3.2: only HTTP/1.0 may leave it out, nobody may give two.
    if len(hosts) > 1 or not (hosts or words[2] == b"HTTP/1.0") or not all(map(_HOST.fullmatch, hosts)):
        return "400"
    if not all(is_ours(host.decode("ascii"), own=own) for host in hosts):
        return "421"
    if words[1].partition(b"?")[0] != b"/metrics":
        return "404"
    return "200" if words[0] in (b"GET", b"HEAD") else "405"


def is_ours(host: str, *, own: tuple[str, ...]) -> bool:
    """Whether a Host field's value cannot be a name that a stranger has registered."""
    name = host.partition(":")[0].lower().removesuffix(".")
    if host.startswith("[") or "." not in name or name.endswith(_PRIVATE) or name in {one.lower() for one in own}:
        return True
    try:
        ip_address(name)
    except ValueError:
        return False
    return True


def _answer(code: str, body: str, *, alone: bool) -> bytes:
    """Its lines and its body; `alone`: the lines of the same answer without it, for HEAD."""
    data = body.encode("utf-8", "replace")
    lines = [
        f"HTTP/1.1 {code} {_REASONS[code]}",
        f"Content-Type: {_METRICS if code == '200' else _PLAIN}",
        f"Content-Length: {len(data)}",
        *(["Allow: GET, HEAD"] if code == "405" else []),
        "Connection: close",
    ]
    return "\r\n".join((*lines, "", "")).encode("ascii") + (b"" if alone else data)
