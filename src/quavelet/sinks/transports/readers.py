"""Many readers of one stream: each gets whole payloads, as many as it can take, and none keeps anybody waiting."""

from __future__ import annotations

import asyncio
from contextlib import suppress

from quavelet.sinks.transport import TransportStats

MOST_WAITING_BYTES = 65_536
"""What may wait in the program for one reader, beside what the kernel keeps for it."""
KERNEL_BYTES = 65_536
HEARD_BYTES = 4096
HEARD_PAUSE_S = 0.1
FINISH_S = 0.5


class Reader(asyncio.BufferedProtocol):
    """One connection. What the other side says is read slowly and thrown away, so that it costs next to nothing."""

    def __init__(self, readers: Readers) -> None:
        self._readers = readers
        self._loop = asyncio.get_running_loop()
        self._heard = memoryview(bytearray(HEARD_BYTES))
        self._transport: asyncio.Transport | None = None
        self._resume: asyncio.TimerHandle | None = None
        self.half_closed = False
        """The other side says nothing more; it may still read, or be gone, which the next payload shows."""

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        assert isinstance(transport, asyncio.Transport)
        self._transport = transport
        # Above it `send` writes nothing more; the mark only keeps asyncio from calling pause_writing.
        transport.set_write_buffer_limits(high=2 * MOST_WAITING_BYTES)
        if not self._readers.admit(self):
            self.turned_away()

    def turned_away(self) -> None:
        """There was no place."""
        self.abort()

    @property
    def may_leave(self) -> bool:
        """Whether its place may be another's."""
        return self.half_closed

    def make_room(self) -> None:
        """Leave for another."""
        self.abort()

    def get_buffer(self, sizehint: int) -> memoryview:
        del sizehint
        return self._heard

    def buffer_updated(self, n: int) -> None:
        self.heard(bytes(self._heard[:n]))
        if self._transport is not None and not self._transport.is_closing():
            self._transport.pause_reading()
            self._resume = self._loop.call_later(HEARD_PAUSE_S, self._read_on)

    def heard(self, data: bytes) -> None:
        """What the other side said."""

    def eof_received(self) -> bool:
        self.half_closed = True
        return True

    def connection_lost(self, error: Exception | None) -> None:
        del error
        if self._resume is not None:
            self._resume.cancel()
        self._transport = None
        self._readers.gone(self)

    def send(self, payload: bytes) -> bool:
        """Whether the payload will go, whole; otherwise nothing of it does."""
        transport = self._transport
        if transport is None or transport.is_closing() or transport.get_write_buffer_size() > MOST_WAITING_BYTES:
            return False
        transport.write(payload)
        return True

    def finish(self) -> None:
        """Close once what waits has gone."""
        if self._transport is not None:
            self._transport.close()

    def abort(self) -> None:
        """Close now."""
        if self._transport is not None:
            self._transport.abort()

    def _read_on(self) -> None:
        if self._transport is not None and not self._transport.is_closing():
            self._transport.resume_reading()


class Readers:
    """At most `most` readers; one that joins gets the latest payload at once."""

    def __init__(self, most: int) -> None:
        self._most = most
        self._readers: dict[Reader, None] = {}
        """The oldest first."""
        self._empty = asyncio.Event()
        self._admits = False
        self._latest = b""
        self._sent = 0
        self._lost = 0
        self._refused = 0
        self._bytes = 0

    def open(self) -> None:
        """Let readers in from here on."""
        self._admits = True

    def admit(self, reader: Reader) -> bool:
        """Whether there is a place for it; the oldest that may leave does so for a new one."""
        if not self._admits:
            return False
        if len(self._readers) >= self._most:
            leaving = next((other for other in self._readers if other.may_leave), None)
            if leaving is None:
                self._refused += 1
                return False
            del self._readers[leaving]
            leaving.make_room()
        self._readers[reader] = None
        self._empty.clear()
        if self._latest:
            self.send_to(reader, self._latest)
        return True

    def gone(self, reader: Reader) -> None:
        self._readers.pop(reader, None)
        if not self._readers:
            self._empty.set()

    def send(self, payload: bytes) -> None:
        """To all, and to who comes before the next."""
        self._latest = payload
        for reader in tuple(self._readers):
            self.send_to(reader, payload)

    async def close(self) -> None:
        """Let what waits go, for a moment; then close all. Nobody is let in any more."""
        self._admits = False
        for reader in tuple(self._readers):
            reader.finish()
        if self._readers:
            with suppress(TimeoutError):
                await asyncio.wait_for(self._empty.wait(), FINISH_S)
        for reader in tuple(self._readers):
            reader.abort()
        if self._readers:
            await self._empty.wait()

    def stats(self, state: str) -> TransportStats:
        return TransportStats(
            state=state,
            sent=self._sent,
            lost=self._lost,
            readers=len(self._readers),
            refused=self._refused,
            bytes=self._bytes,
        )

    def send_to(self, reader: Reader, payload: bytes) -> bool:
        """To one; whether it will go."""
        went = reader.send(payload)
        if went:
            self._sent += 1
            self._bytes += len(payload)
        else:
            self._lost += 1
        return went
