"""The network's thread: one asyncio loop for all sockets, brokers and questions, apart from the loop in real time.

A message comes here from the hub's thread, waits among at most `depth` others, and is handed to each part in turn. No
part may wait; one that raises ends alone, is told of, and is opened again later.
"""

from __future__ import annotations

import asyncio
import logging
import threading
from collections import deque
from collections.abc import Callable, Coroutine, Iterable
from concurrent.futures import TimeoutError as FutureTimeoutError
from contextlib import suppress
from typing import Protocol

from quavelet.core.clock import Clock
from quavelet.core.errors import ImuError
from quavelet.loop.histogram import Histogram
from quavelet.sinks.message import Message

log = logging.getLogger(__name__)

DEPTH = 256
LONGEST_PAUSE_S = 60.0
CLOSE_S = 1.0
"""All parts together may take so long to finish what is begun."""


class Part(Protocol):
    """Something that lives on the network's thread: an output, or a socket that answers questions."""

    @property
    def name(self) -> str:
        """What it is called when it is told of."""
        ...

    async def open(self) -> None:
        """Be ready. Raises OSError, or ImuError with what to do."""
        ...

    def write(self, message: Message) -> bool:
        """Take a message, at once; whether anything of it went out."""
        ...

    async def close(self) -> None:
        """Give back all that is open; also after `open` raised."""
        ...


class Network:
    """A sink of the hub. Its parts are added and removed from any thread, between `start` and `close`.

    talk says one sentence to the person; clock is that of the loop, for the latency.
    wait_for_room is for virtual time: nothing is lost, whoever writes waits.
    """

    def __init__(
        self,
        *,
        talk: Callable[[str], None],
        clock: Clock,
        wait_for_room: bool = False,
        depth: int = DEPTH,
        first_pause_s: float = 1.0,
    ) -> None:
        self.latency = Histogram()
        """From the end of a drain to the moment its message was handed to the kernel, for each output."""
        self.lost = 0
        """Messages that no part got, since too many were waiting."""
        self._talk = talk
        self._clock = clock
        self._depth = depth
        self._first_pause_s = first_pause_s
        self._room = threading.Semaphore(depth) if wait_for_room else None
        # Each is counted by one thread only: given by the hub's, taken by ours.
        self._given = 0
        self._taken = 0
        self._drained: deque[tuple[int, int]] = deque(maxlen=4 * depth)
        self._loop = asyncio.new_event_loop()
        self._thread = threading.Thread(target=self._run, name="network", daemon=True)
        self._runs: dict[Part, asyncio.Task[None]] = {}
        self._open: dict[Part, asyncio.Future[str]] = {}
        self._failures: dict[Part, str] = {}
        self._told: set[Part] = set()
        self._tasks: set[asyncio.Task[None]] = set()
        self._mistaken: set[str] = set()
        self._failed = 0
        self._closed = False

    def start(self) -> None:
        """Begin the thread."""
        self._thread.start()

    def add(self, part: Part) -> None:
        """Open a part, and again later should it fail."""
        self._call(self._add, part)

    def replace(self, old: Iterable[Part], new: Iterable[Part]) -> None:
        """Close parts, then open others, which may be in their places; returns at once."""
        self._call(lambda: self._hold(self._replace(tuple(old), tuple(new))))

    def remove(self, part: Part, timeout_s: float = CLOSE_S) -> None:
        """Close a part; returns when it is closed, or after `timeout_s`."""
        with suppress(FutureTimeoutError):
            asyncio.run_coroutine_threadsafe(self._remove(part), self._loop).result(timeout_s)

    def drained(self, t_ns: int, read_ns: int) -> None:
        """The message with the time `t_ns` is of a drain whose last byte was read at the clock's `read_ns`."""
        self._drained.append((t_ns, read_ns))

    def write(self, message: Message) -> None:
        """Hand a message over; one that finds no room is lost and counted."""
        if self._closed:
            return
        if self._room is not None:
            self._room.acquire()
        elif self._given - self._taken >= self._depth:
            self.lost += 1
            return
        self._given += 1
        self._call(self._take, message)

    def failure(self, part: Part) -> str:
        """Why a part does not work at this moment, "" where it does."""
        return self._failures.get(part, "")

    @property
    def failures(self) -> int:
        """How often parts have failed so far."""
        return self._failed

    def close(self) -> None:
        """Close all parts and end the thread; may be called twice."""
        if self._closed:
            return
        self._closed = True
        if self._thread.is_alive():
            self._loop.call_soon_threadsafe(lambda: self._hold(self._finish()))
            self._thread.join(2 * CLOSE_S)
        else:
            self._loop.close()

    def _call(self, step: Callable[..., object], *values: object) -> None:
        # RuntimeError: the loop is closed, at the end of the program.
        with suppress(RuntimeError):
            self._loop.call_soon_threadsafe(step, *values)

    def _run(self) -> None:
        asyncio.set_event_loop(self._loop)
        try:
            self._loop.run_forever()
        finally:
            self._loop.close()

    def _take(self, message: Message) -> None:
        self._taken += 1
        if self._room is not None:
            self._room.release()
        read_ns = self._read_ns(message.t_ns)
        for part in tuple(self._open):
            try:
                went = part.write(message)
            except (ImuError, OSError) as error:
                self._fail(part, _why(error))
            except Exception as error:  # noqa: BLE001
                self._fail(part, self._mistake(part, error))
            else:
                if went and read_ns is not None:
                    self.latency.add(self._clock.now_ns() - read_ns)

    def _read_ns(self, t_ns: int) -> int | None:
        """When the drain of this message was read; those of messages that were lost before it are forgotten."""
        while self._drained and self._drained[0][0] <= t_ns:
            at_ns, read_ns = self._drained.popleft()
            if at_ns == t_ns:
                return read_ns
        return None

    def _fail(self, part: Part, why: str) -> None:
        failed = self._open.pop(part, None)
        if failed is not None and not failed.done():
            failed.set_result(why)

    def _mistake(self, part: Part, error: Exception) -> str:
        """In words; where it is, the first time only."""
        if part.name not in self._mistaken:
            self._mistaken.add(part.name)
            log.error("%s has a mistake in its code", part.name, exc_info=error)
        return f"{type(error).__name__}: {error}"

    def _add(self, part: Part) -> None:
        if part not in self._runs:
            self._runs[part] = self._loop.create_task(self._keep_open(part))

    async def _replace(self, old: tuple[Part, ...], new: tuple[Part, ...]) -> None:
        await asyncio.gather(*(self._remove(part) for part in old))
        for part in new:
            self._add(part)

    def _hold(self, work: Coroutine[None, None, None]) -> None:
        """Begin it; the loop itself holds a task only weakly."""
        task = self._loop.create_task(work)
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)

    async def _remove(self, part: Part) -> None:
        run = self._runs.pop(part, None)
        if run is not None:
            run.cancel()
            await asyncio.wait([run])

    async def _keep_open(self, part: Part) -> None:
        pause_s, told = self._first_pause_s, ""
        try:
            while True:
                began_s = self._loop.time()
                why = await self._open_until_it_fails(part)
                self._failed += 1
                self._failures[part] = why
                if self._loop.time() - began_s > LONGEST_PAUSE_S:
                    pause_s, told = self._first_pause_s, ""
                if why != told:
                    self._talk(f"{part.name}: {why}; it is tried again, the others go on")
                    told = why
                    self._told.add(part)
                await self._close(part)
                await asyncio.sleep(pause_s)
                pause_s = min(2.0 * pause_s, LONGEST_PAUSE_S)
        finally:
            self._open.pop(part, None)
            self._failures.pop(part, None)
            self._told.discard(part)
            await self._close(part)

    async def _close(self, part: Part) -> None:
        try:
            await part.close()
        except (ImuError, OSError) as error:
            log.warning("%s: %s", part.name, error)
        except Exception as error:  # noqa: BLE001
            self._mistake(part, error)

    async def _open_until_it_fails(self, part: Part) -> str:
        try:
            await part.open()
        except (ImuError, OSError) as error:
            return _why(error)
        except Exception as error:  # noqa: BLE001
            return self._mistake(part, error)
        self._failures.pop(part, None)
        if part in self._told:
            # Once for each failure that was told: one that comes and goes does not fill the journal.
            self._told.discard(part)
            self._talk(f"{part.name}: works again")
        failed: asyncio.Future[str] = self._loop.create_future()
        self._open[part] = failed
        return await failed

    async def _finish(self) -> None:
        runs = list(self._runs.values())
        for run in runs:
            run.cancel()
        if runs:
            await asyncio.wait(runs, timeout=CLOSE_S)
        # What a part left behind must not be told of as destroyed while pending.
        rest = asyncio.all_tasks() - {asyncio.current_task()}
        for task in rest:
            task.cancel()
        if rest:
            await asyncio.wait(rest, timeout=0.2)
        # asyncio closes a connection two rounds after it was told to.
        for _ in range(3):
            await asyncio.sleep(0)
        self._loop.stop()


def _why(error: BaseException) -> str:
    """In words, without the number of an error of the system, and with its file."""
    system = error.strerror if isinstance(error, OSError) and not isinstance(error, ImuError) else None
    if system and isinstance(error, OSError) and error.filename:
        return f"{error.filename}: {system}"
    return system or str(error) or type(error).__name__
