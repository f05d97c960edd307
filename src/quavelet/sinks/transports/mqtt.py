"""An MQTT 5 broker: one task that connects, publishes and connects again, whatever the broker does.

    TOPIC/status       "online", or "offline" by our last will; retained
    TOPIC/identity     who this is and what its times mean; retained
    TOPIC/attitude     the messages, in the output's encoding
    TOPIC/diagnostics  every 30 s and when the state changes, JSON

Nothing is subscribed to, so that no topic can reach the service.
"""

from __future__ import annotations

import asyncio
import logging
import socket
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from typing import NamedTuple

import msgspec

from quavelet.core.errors import SettingsError
from quavelet.sinks.home_assistant import DIAGNOSTICS_S, diagnostics_of, discovery, discovery_topic
from quavelet.sinks.identity import Identity, client_id_of, identity_of, topic_of
from quavelet.sinks.plan import OutputPlan
from quavelet.sinks.spans import span_in_words
from quavelet.sinks.transport import TransportStats
from quavelet.sinks.transports.backoff import Backoff
from quavelet.sinks.transports.mqtt_connection import MqttConnection
from quavelet.sinks.transports.mqtt_trouble import Trouble

_log = logging.getLogger(__name__)

_WAITING = 256
"""Payloads that wait for the broker, at most: its restart loses nothing, and its absence costs no memory."""
_STALE_S = 60.0
"""What has waited longer is not sent: where messages are few, 256 of them are hours, and an old one would be taken for
one of the moment it comes. Between two tries no more time goes by."""
_TOLD_S = 60.0
"""The end of an outage is told where it was as long; that of a short one would only be noise."""
_IN_FLIGHT = 8
"""Sent and not acknowledged. A broker may allow few (MQTT 5.0, 3.2.2.3.3 Receive Maximum); one well known takes 10."""
_HELD_S = 10.0
"""A connection that holds so long counts as one: before, waits go on growing, or two of one client_id would take
turns without end."""
_CLOSE_S = 0.9
"""A little less than the network gives all of its parts."""
_LOOK_S = 2.0
"""Time between two looks at the service: for a chip that is lost, a clock that is set, yaw that has found north."""
_CLOCK_MOVED_NS = 1_000_000
"""The identity is published anew when the clock's offset has moved so far."""


class _Payload(NamedTuple):
    """What is to be sent, and when it came, s of the event loop."""

    since_s: float
    data: bytes


class _Away(NamedTuple):
    """There is no broker: since when, s of the event loop, and how many payloads had been lost by then."""

    since_s: float
    lost: int


class MqttTransport:
    """Payloads to TOPIC/attitude of a broker that may come and go.

    While it is away the newest 256 payloads of the last minute wait; older ones are lost and counted.
    """

    def __init__(self, plan: OutputPlan, *, backoff: Backoff | None = None) -> None:
        self._plan = plan
        self._mqtt = plan.settings.mqtt
        self._to = plan.settings.destination
        self._backoff = backoff or Backoff()
        self._host = socket.gethostname()
        self._topic = topic_of(plan, host=self._host)
        self._waiting: deque[_Payload] = deque()
        self._unanswered: dict[int, _Payload] = {}
        self._taken = 0
        self._connection: MqttConnection | None = None
        self._closing = asyncio.Event()
        self._task: asyncio.Task[None] | None = None
        self._state = "not opened"
        self._time_s: Callable[[], float] = float
        self._away: _Away | None = None
        self._told: set[str] = set()
        self._sent = self._lost = self._bytes = 0
        self._retained: dict[str, bytes] = {}
        self._identity: Identity | None = None

    async def open(self) -> None:
        """Begin to connect; the broker need not be there. May be called again after `close`.

        Raises SettingsError where paho-mqtt, the password or a certificate is not there.
        """
        self._closing.clear()
        self._time_s = asyncio.get_running_loop().time
        self._new_connection().close()
        self._away = _Away(self._time_s(), self._lost)
        self._state = f"waiting for the broker: connecting to {self._to.host}:{self._to.port}"
        self._task = asyncio.create_task(self._run(), name=f"mqtt {self._plan.name}")

    def send(self, payload: bytes) -> None:
        """Let the payload go, or wait for its turn; the oldest is lost where too many wait.

        Raises what our task has ended with, if it has: that is a mistake in its code, and no broker's doing.
        """
        if self._task is not None and self._task.done() and not self._closing.is_set():
            self._task.result()
        self._waiting.append(_Payload(self._time_s(), payload))
        self._pump()
        self._lose_what_is_too_much()

    async def close(self) -> None:
        """Send what waits, say "offline" and go, all within 0.9 s; what then has not gone is lost and counted."""
        self._closing.set()
        if self._task is not None:
            if self._connection is not None:
                await asyncio.wait([self._task], timeout=_CLOSE_S)
            self._task.cancel()
            await asyncio.wait([self._task])
            self._task = None
        self._lost += len(self._waiting) + len(self._unanswered)
        self._waiting.clear()
        self._unanswered.clear()
        self._away = None
        self._state = "closed"

    def stats(self) -> TransportStats:
        """`sent` are those that the broker has taken, with qos 0 those that were written."""
        state, away = self._state, self._away
        if away is not None:
            state += f" (for {span_in_words(self._time_s() - away.since_s)})"
        return TransportStats(state=state, sent=self._sent, lost=self._lost, bytes=self._bytes)

    async def _run(self) -> None:
        loop = asyncio.get_running_loop()
        while not self._closing.is_set():
            begun_s = loop.time()
            try:
                connection = self._new_connection()
                try:
                    await connection.open()
                    begun_s = loop.time()
                    await self._serve(connection)
                finally:
                    self._connection = None
                    connection.close()
            except SettingsError as error:
                trouble = Trouble(str(error), lasting=True)
            except Trouble as error:
                trouble = error
            else:
                return
            if loop.time() - begun_s >= _HELD_S:
                self._backoff.reset()
            self._send_again()
            if self._away is None:
                self._away = _Away(self._time_s(), self._lost)
            self._state = f"waiting for the broker: {trouble}"
            self._warn(self._state, anew=trouble.lasting)
            with suppress(TimeoutError):
                await asyncio.wait_for(self._closing.wait(), self._backoff.wait_s(slow=trouble.lasting))

    async def _serve(self, connection: MqttConnection) -> None:
        """Publish until we close. Raises Trouble when the connection is lost."""
        # A broker that has come back may have forgotten all of them.
        self._retained = {}
        self._told = set()
        self._state = "connected"
        away, self._away = self._away, None
        await self._publish_retained(connection)
        await self._publish(connection, f"{self._topic}/status", b"online", retain=True)
        _log.info("output %s: connected to %s:%d", self._plan.name, self._to.host, self._to.port)
        self._connection = connection
        self._pump()
        if away is not None and self._time_s() - away.since_s >= _TOLD_S:
            self._tell_return(away)
        closing = asyncio.create_task(self._closing.wait())
        try:
            due_s, shown = 0.0, None
            while not self._closing.is_set():
                clock = (await self._publish_retained(connection)).clock
                found = diagnostics_of(self._plan.status(), lost=self._lost)
                # What is wrong, or no longer, is said when it is seen.
                show = found.state, found.problem, clock.offset_ns
                if show != shown or self._time_s() >= due_s:
                    await self._publish(connection, f"{self._topic}/diagnostics", msgspec.json.encode(found))
                    due_s, shown = self._time_s() + DIAGNOSTICS_S, show
                await connection.wait_for(closing, within_s=min(_LOOK_S, DIAGNOSTICS_S))
        finally:
            closing.cancel()
        await self._leave(connection)

    async def _leave(self, connection: MqttConnection) -> None:
        """The rest of the messages while there is time, then "offline" ourselves."""
        loop = asyncio.get_running_loop()
        deadline_s = loop.time() + 0.5 * _CLOSE_S
        while (self._waiting or self._unanswered) and loop.time() < deadline_s and not connection.lost.done():
            await asyncio.sleep(0.01)
        topic = f"{self._topic}/status"
        await connection.published(topic, b"offline", qos=self._own_qos, retain=True, within_s=0.25 * _CLOSE_S)
        await connection.disconnect(within_s=0.2 * _CLOSE_S)

    def _pump(self) -> None:
        """Keep as many on the way as the broker may be given."""
        connection = self._connection
        if connection is None or connection.lost.done():
            return
        topic = f"{self._topic}/attitude"
        while self._waiting and len(self._unanswered) < _IN_FLIGHT:
            payload = self._waiting.popleft()
            if self._time_s() - payload.since_s > _STALE_S:
                self._lost += 1
                continue
            self._taken = number = self._taken + 1
            self._unanswered[number] = payload
            answer = partial(self._on_answer, number)
            try:
                connection.publish(topic, payload.data.removesuffix(b"\n"), qos=self._mqtt.qos, answer=answer)
            except Trouble:
                # It stays with the unanswered; the task that waits for the connection's end sends them again.
                return

    def _on_answer(self, number: int, refusal: str) -> None:
        payload = self._unanswered.pop(number)
        if refusal:
            self._lost += 1
            self._refused(refusal)
        else:
            self._sent += 1
            self._bytes += len(payload.data)
        self._pump()

    def _send_again(self) -> None:
        """What the broker has not acknowledged goes first next time; MQTT allows it to come twice."""
        self._waiting.extendleft(reversed(self._unanswered.values()))
        self._unanswered = {}
        self._lose_what_is_too_much()

    def _lose_what_is_too_much(self) -> None:
        while len(self._waiting) > _WAITING:
            self._waiting.popleft()
            self._lost += 1

    async def _publish_retained(self, connection: MqttConnection) -> Identity:
        """The documents that stay, where they have changed since they were last published here."""
        status = self._plan.status()
        identity = identity_of(status, host=self._host, topic=self._topic, encoding=self._plan.settings.encoding)
        before = self._identity
        if before and abs(identity.clock.offset_ns - before.clock.offset_ns) < _CLOCK_MOVED_NS:
            clock = msgspec.structs.replace(identity.clock, offset_ns=before.clock.offset_ns)
            identity = msgspec.structs.replace(identity, clock=clock)
        self._identity = identity
        documents = {f"{self._topic}/identity": msgspec.json.encode(identity)}
        if self._mqtt.home_assistant:
            yaw = status.message.yaw if status.message else "relative"
            documents[discovery_topic(identity, mqtt=self._mqtt)] = discovery(identity, mqtt=self._mqtt, yaw=yaw)
        for topic, document in documents.items():
            if self._retained.get(topic) != document:
                await self._publish(connection, topic, document, retain=True)
                self._retained[topic] = document
        return identity

    async def _publish(self, connection: MqttConnection, topic: str, document: bytes, *, retain: bool = False) -> None:
        refusal = await connection.published(topic, document, qos=self._own_qos, retain=retain)
        if refusal:
            self._refused(f"{topic}, {refusal}")

    def _refused(self, why: str) -> None:
        self._state = f"connected, but the broker refuses what is published ({why}): see its access list"
        self._warn(self._state, anew=True)

    @property
    def _own_qos(self) -> int:
        """Of the documents: one that is lost would be missing for long."""
        return max(1, self._mqtt.qos)

    def _warn(self, text: str, *, anew: bool) -> None:
        """Once an outage, not once a try; `anew`: also a second time when it says something else than before."""
        if not self._told or (anew and text not in self._told):
            _log.warning("output %s: %s", self._plan.name, text)
        self._told.add(text)

    def _tell_return(self, away: _Away) -> None:
        lasted = span_in_words(self._time_s() - away.since_s)
        _log.warning(
            "output %s: connected to the broker again after %s, in which %d messages were lost",
            self._plan.name,
            lasted,
            self._lost - away.lost,
        )

    def _new_connection(self) -> MqttConnection:
        """Password and certificates are read anew each time, as they may have been mended."""
        device = identity_of(self._plan.status(), host=self._host, topic=self._topic, encoding="").id
        return MqttConnection(
            self._to,
            self._mqtt,
            client_id=client_id_of(self._plan, host=self._host, device=device),
            will_topic=f"{self._topic}/status",
        )
