"""Who looks on: each gets every frame that it can take, and none keeps anybody waiting.

A message that finds older ones still on their way waits alone: the next takes its place, with what both say of flags
and gaps. All else waits in line. Who takes nothing for five seconds, or lets too much wait, is dropped.
"""

from __future__ import annotations

import asyncio
from collections import Counter
from collections.abc import Callable

from quavelet.sinks.message import Message, together
from quavelet.sinks.status import PageStatus

STALLED_S = 5.0
MESSAGES_WAIT_BYTES = 4096
"""With more than that on its way, a message would come late."""
MOST_WAITING_BYTES = 2_000_000
"""Ten minutes of history and all else that may wait in the program for one viewer."""


class Viewer:
    """One websocket, of which only the transport is written to; `is_open` ends before it is closed."""

    def __init__(self, transport: asyncio.Transport, is_open: Callable[[], bool], *, now_s: float) -> None:
        self.transport = transport
        self.lost = 0
        """Messages that another took the place of."""
        self._is_open = is_open
        self._slot: Message | None = None
        self._written = 0
        self._taken = 0
        self._taken_s = now_s

    @property
    def waiting_bytes(self) -> int:
        """What is on its way in the program."""
        return self.transport.get_write_buffer_size()

    def send(self, frame: bytes) -> bool:
        """Let it go, in line; whether it does."""
        if not self._is_open() or self.transport.is_closing():
            return False
        self.transport.write(frame)
        self._written += len(frame)
        return True

    def offer(self, message: Message, frame: bytes, frame_of: Callable[[Message], bytes]) -> bool:
        """Let a message go at once, or wait; `frame` is the message alone, frame_of makes one with what waited."""
        if self._slot is not None:
            self.lost += 1
            message = together(self._slot, message)
        if self.waiting_bytes > MESSAGES_WAIT_BYTES:
            self._slot = message
            return False
        if self._slot is not None:
            self._slot, frame = None, frame_of(message)
        return self.send(frame)

    def is_stalled(self, now_s: float, stalled_s: float) -> bool:
        """Whether it has taken nothing for so long, though there was something, or far too much waits."""
        waiting = self.waiting_bytes
        if waiting > MOST_WAITING_BYTES:
            return True
        taken = self._written - waiting
        if taken != self._taken or not waiting:
            self._taken, self._taken_s = taken, now_s
        return now_s - self._taken_s > stalled_s


class Viewers:
    """At most `most`. refused and dropped say why, and how often; lost counts messages over all."""

    def __init__(self, most: int, *, stalled_s: float = STALLED_S) -> None:
        self.refused: Counter[str] = Counter()
        self.dropped: Counter[str] = Counter()
        self._most = most
        self._stalled_s = stalled_s
        self._viewers: dict[Viewer, None] = {}
        self._lost = 0

    def __len__(self) -> int:
        return len(self._viewers)

    @property
    def is_full(self) -> bool:
        return len(self._viewers) >= self._most

    @property
    def lost(self) -> int:
        return self._lost + sum(viewer.lost for viewer in tuple(self._viewers))

    def join(self, viewer: Viewer) -> None:
        self._viewers[viewer] = None

    def leave(self, viewer: Viewer) -> bool:
        """Whether it was still one."""
        if viewer not in self._viewers:
            return False
        del self._viewers[viewer]
        self._lost += viewer.lost
        return True

    def send(self, frame: bytes) -> None:
        """To all."""
        for viewer in self._viewers:
            viewer.send(frame)

    def offer(self, message: Message, frame_of: Callable[[Message], bytes]) -> bool:
        """A message to all; whether it went to any."""
        if not self._viewers:
            return False
        frame, went = frame_of(message), False
        for viewer in self._viewers:
            went |= viewer.offer(message, frame, frame_of)
        return went

    def drop_stalled(self, now_s: float) -> None:
        for viewer in tuple(self._viewers):
            if viewer.is_stalled(now_s, self._stalled_s):
                self.drop(viewer, "stalled")

    def drop(self, viewer: Viewer, why: str) -> None:
        """Cut it off, for a reason that is counted."""
        if self.leave(viewer):
            self.dropped[why] += 1
            viewer.transport.abort()

    def status(self) -> PageStatus:
        """May be asked for on any thread."""
        return PageStatus(now=len(self), lost=self.lost, refused=dict(self.refused), dropped=dict(self.dropped))
