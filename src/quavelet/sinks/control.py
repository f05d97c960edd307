"""The local socket that `quavelet status` and `quavelet watch` ask, and any program: one line is the question.

    status        the `Status` as one line of JSON; closed
    watch [HZ]    messages in JSON, at most HZ a second, the latest at once, until closed

Anything else gets {"error": "..."}; closed. What is not taken in time is lost to whoever does not take it.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from math import isfinite
from pathlib import Path

import msgspec

from quavelet.sinks.message import Message
from quavelet.sinks.status import Status
from quavelet.sinks.thinning import Thinning
from quavelet.sinks.transport import TransportStats
from quavelet.sinks.transports.readers import Reader, Readers
from quavelet.sinks.transports.unix import UnixListener, listen

LONGEST_QUESTION_BYTES = 1024
MOST_ASKERS = 8
PATIENCE_S = 5.0
"""For the question, and again for the whole answer to be taken."""
FASTEST_HZ = 1000.0
USAGE = "ask with a line `status` or `watch [HZ]`"


class ControlSocket:
    """A part of the network (see `Part`) that listens on `path`."""

    name = "service.socket"

    def __init__(self, path: Path, *, status: Callable[[], Status], patience_s: float = PATIENCE_S) -> None:
        self.path = path
        self.status = status
        self.patience_s = patience_s
        self.readers = Readers(MOST_ASKERS)
        self.watchers: dict[Reader, Thinning] = {}
        self._listener: UnixListener | None = None
        self._latest: Message | None = None
        self._encoder = msgspec.json.Encoder()

    async def open(self) -> None:
        self.readers.open()
        self._listener = await listen(self.path, lambda: _Asker(self))

    def write(self, message: Message) -> bool:
        self._latest = message
        line, went = b"", False
        for reader, thinning in tuple(self.watchers.items()):
            taken = thinning.take(message)
            if taken is message:
                line = line or self._line(message)
                went |= self.readers.send_to(reader, line)
            elif taken is not None:
                went |= self.readers.send_to(reader, self._line(taken))
        return went

    async def close(self) -> None:
        if self._listener is not None:
            listener, self._listener = self._listener, None
            await listener.close()
        await self.readers.close()

    def stats(self) -> TransportStats:
        return self.readers.stats("closed" if self._listener is None else self._listener.state)

    def answer(self, asker: Reader, question: bytes) -> bytes:
        """The whole answer to a line; b"" where `asker` has become a watcher."""
        words = question.decode("utf-8", "replace").split()
        if words == ["status"]:
            return self._line(self.status())
        hz = _rate(words)
        if hz is None:
            return self.refusal(USAGE)
        self.watchers[asker] = Thinning(rate_hz=hz)
        if self._latest is not None:
            self.readers.send_to(asker, self._line(self._latest))
        return b""

    def refusal(self, why: str) -> bytes:
        return self._line({"error": why})

    def _line(self, value: object) -> bytes:
        return self._encoder.encode(value) + b"\n"


class _Asker(Reader):
    """One connection: a question, then its answer or the messages."""

    def __init__(self, control: ControlSocket) -> None:
        super().__init__(control.readers)
        self._control = control
        self._question = b""
        self._asked = False
        self._patience: asyncio.TimerHandle | None = None

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        super().connection_made(transport)
        if not self._asked:
            self._wait(self._give_up)

    def turned_away(self) -> None:
        self._end(self._control.refusal(f"{MOST_ASKERS} others ask already: try again later"))

    @property
    def may_leave(self) -> bool:
        """Who says nothing must not keep out who asks."""
        return self.half_closed or not self._asked

    def make_room(self) -> None:
        if self._asked:
            self.abort()
        else:
            self._end(self._control.refusal(f"others ask, and no question came: {USAGE}"))

    def heard(self, data: bytes) -> None:
        if self._asked:
            return
        self._question += data
        line, newline, _ = self._question.partition(b"\n")
        if len(line) > LONGEST_QUESTION_BYTES:
            self._end(self._control.refusal(f"the question is longer than {LONGEST_QUESTION_BYTES} bytes: {USAGE}"))
        elif newline:
            self._answer(line)

    def eof_received(self) -> bool:
        if not self._asked:
            self._answer(self._question)
        return super().eof_received()

    def connection_lost(self, error: Exception | None) -> None:
        self._control.watchers.pop(self, None)
        self._cancel()
        super().connection_lost(error)

    def _give_up(self) -> None:
        self._end(self._control.refusal(f"no question came within {self._control.patience_s:g} s: {USAGE}"))

    def _answer(self, question: bytes) -> None:
        self._asked = True
        self._cancel()
        answer = self._control.answer(self, question)
        if answer:
            self._end(answer)

    def _end(self, last_words: bytes) -> None:
        self._asked = True
        self._control.readers.send_to(self, last_words)
        self._wait(self.abort)
        self.finish()

    def _wait(self, step: Callable[[], None]) -> None:
        self._cancel()
        self._patience = asyncio.get_running_loop().call_later(self._control.patience_s, step)

    def _cancel(self) -> None:
        if self._patience is not None:
            self._patience.cancel()
            self._patience = None


def _rate(words: list[str]) -> float | None:
    """Messages a second that `watch [HZ]` asks for, 0 for all; None where it is something else."""
    if words == ["watch"]:
        return 0.0
    if len(words) != 2 or words[0] != "watch":
        return None
    try:
        hz = float(words[1])
    except ValueError:
        return None
    return hz if isfinite(hz) and 0.0 < hz <= FASTEST_HZ else None
