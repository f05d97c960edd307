"""The hub: every output on a thread of its own, so that a slow or broken one never stops the loop.

A publisher at real-time priority must not wait for a lock that an ordinary thread holds, for that thread may
be kept from the processor by any other. So each subscriber has a `SimpleQueue`, whose put takes no lock but the
interpreter's own; no Python code runs under a lock shared with the publisher.
"""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum
from queue import Empty, SimpleQueue
from typing import Generic, Protocol, Self, TypeVar

from quavelet.core.errors import ImuError, SettingsError

_log = logging.getLogger(__name__)

T = TypeVar("T")
Item = TypeVar("Item", contravariant=True)


class ItemSink(Protocol[Item]):
    """Where items go; both methods run on the subscriber's thread and may raise ImuError or OSError."""

    def write(self, item: Item, /) -> None:
        """Put the item out; may take as long as it needs."""
        ...

    def close(self) -> None:
        """Finish what is begun; called once, also after `write` raised."""
        ...


class Policy(Enum):
    """What a full queue means to the publisher."""

    LOSE_OLDEST = "lose_oldest"
    """The oldest item waiting is dropped and counted: for a loop in real time."""
    WAIT = "wait"
    """The publisher waits for room: for replay and virtual time, where nothing is late."""


@dataclass(frozen=True, slots=True)
class SubscriberStats:
    """What became of the items published since `subscribe`.

    delivered  items `write` returned from
    lost       items that never will be: dropped from a full queue or, once the subscriber has ended, all the rest
    failed     why it ended, None while it has not failed
    """

    name: str
    delivered: int
    lost: int
    failed: str | None


class Hub(Generic[T]):
    """Hands each published item to every subscriber.

    One thread publishes; all other methods may be called from any thread.
    """

    def __init__(self) -> None:
        self._subscribers: tuple[_Subscriber[T], ...] = ()
        self._leaving: tuple[_Subscriber[T], ...] = ()
        self._lock = threading.Lock()
        self._closed = False

    def subscribe(self, name: str, sink: ItemSink[T], *, depth: int = 64, policy: Policy = Policy.LOSE_OLDEST) -> None:
        """Let `sink` have every item from now on; up to `depth` >= 1 items wait for it.

        The hub closes the sink. Raises SettingsError for a name taken, a depth below 1, or a closed hub.
        """
        if depth < 1:
            raise SettingsError(f"output {name}: the queue's depth must be at least 1, not {depth}")
        with self._lock:
            if self._closed:
                raise SettingsError(f"output {name}: the hub is closed")
            if any(s.name == name for s in self._subscribers):
                raise SettingsError(f"output {name}: there is one of that name already, give it another")
            subscriber = _Subscriber(name, sink, depth, policy)
            # A new tuple each time: the publisher goes through it without the lock.
            self._subscribers = (*self._subscribers, subscriber)
            subscriber.thread.start()

    def unsubscribe(self, name: str) -> None:
        """Let the sink write what is queued and close, and have nothing more; its name is free again.

        Returns at once; what is left of it at `close` is waited for then. Raises SettingsError where there is none of
        that name.
        """
        with self._lock:
            found = next((s for s in self._subscribers if s.name == name), None)
            if found is None:
                raise SettingsError(f"output {name}: there is none of that name")
            self._subscribers = tuple(s for s in self._subscribers if s is not found)
            self._leaving = (*(s for s in self._leaving if s.thread.is_alive()), found)
            found.finish()

    def publish(self, item: T) -> None:
        """Queue the item for every subscriber; waits only for those with `Policy.WAIT`. Ignored after `close`."""
        for subscriber in self._subscribers:
            subscriber.put(item)

    def failures(self) -> dict[str, BaseException]:
        """Why subscribers ended before their time, by name.

        BrokenPipeError is a reader that has gone; TimeoutError a sink that `close` gave up waiting for.
        """
        return {s.name: s.failure for s in self._subscribers if s.failure is not None}

    def stats(self) -> tuple[SubscriberStats, ...]:
        """One entry a subscriber, in the order they came."""
        return tuple(s.stats() for s in self._subscribers)

    def close(self, timeout_s: float = 2.0) -> None:
        """Let each sink write what is queued and close, all within `timeout_s`; give up on those that do not."""
        with self._lock:
            self._closed = True
            ending = (*self._subscribers, *self._leaving)
        for subscriber in ending:
            subscriber.finish()
        deadline_s = time.monotonic() + timeout_s
        for subscriber in ending:
            subscriber.thread.join(max(0.0, deadline_s - time.monotonic()))
            if subscriber.thread.is_alive():
                subscriber.give_up(TimeoutError(f"did not finish within {timeout_s:g} s"))

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()


class _End:
    """Stands last in a queue."""


_END = _End()


class _Subscriber(Generic[T]):
    """A queue and the thread that empties it.

    Each counter is written by one thread only: `published` and `dropped` by the publisher, `delivered` by ours.
    """

    def __init__(self, name: str, sink: ItemSink[T], depth: int, policy: Policy) -> None:
        self.name = name
        self.failure: BaseException | None = None
        self.thread = threading.Thread(target=self._run, name=f"sink {name}", daemon=True)
        self._sink = sink
        self._depth = depth
        self._queue: SimpleQueue[T | _End] = SimpleQueue()
        self._room = threading.Semaphore(depth) if policy is Policy.WAIT else None
        self._published = 0
        self._dropped = 0
        self._delivered = 0
        self._finishing = False
        self._ended = False

    def put(self, item: T) -> None:
        if self._finishing:
            return
        self._published += 1
        if self._room is not None:
            self._room.acquire()
        if not self._takes_items():
            # Whoever ended it made one place to wake us; make one again for the call after this.
            self._wake_publisher()
            return
        if self._room is None and self._queue.qsize() >= self._depth:
            self._drop_oldest()
        self._queue.put(item)

    def _drop_oldest(self) -> None:
        try:
            oldest = self._queue.get_nowait()
        except Empty:
            return
        if isinstance(oldest, _End):
            self._queue.put(oldest)
        else:
            self._dropped += 1

    def finish(self) -> None:
        """Nothing comes after what is queued."""
        if not self._finishing:
            self._finishing = True
            self._queue.put(_END)
            self._wake_publisher()

    def give_up(self, error: BaseException) -> None:
        """The sink is stuck: leave its thread behind."""
        self._fail(error)
        self._ended = True
        self._wake_publisher()

    def stats(self) -> SubscriberStats:
        lost = self._published - self._delivered if self._ended else self._dropped
        failed = None if self.failure is None else str(self.failure) or type(self.failure).__name__
        return SubscriberStats(self.name, self._delivered, lost, failed)

    def _takes_items(self) -> bool:
        return not (self._ended or self._finishing)

    def _run(self) -> None:
        try:
            self._guarded(self._deliver)
        finally:
            # Before the sink is closed, which may take its time: a waiting publisher must not wait for that.
            self._ended = True
            self._wake_publisher()
            self._guarded(self._sink.close)

    def _deliver(self) -> None:
        while not self._ended:
            item = self._queue.get()
            if isinstance(item, _End):
                return
            self._sink.write(item)
            self._delivered += 1
            if self._room is not None:
                self._room.release()

    def _guarded(self, step: Callable[[], None]) -> None:
        try:
            step()
        except (ImuError, OSError) as error:
            self._fail(error)
        except BaseException as error:
            # A mistake in the sink's code: kept for the owner, and raised so that its traceback is seen.
            self._fail(error)
            raise

    def _fail(self, error: BaseException) -> None:
        """Keep the first reason; a reader that has gone is the owner's to judge, the rest is told at once."""
        if self.failure is None:
            self.failure = error
            level = logging.INFO if isinstance(error, BrokenPipeError) else logging.WARNING
            _log.log(level, "output %s ended, the others go on: %s", self.name, error)

    def _wake_publisher(self) -> None:
        if self._room is not None:
            self._room.release()
