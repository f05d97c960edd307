"""One connection to an MQTT 5 broker on an event loop: paho's protocol, the loop's sockets and time.

aiomqtt would do the same, but it keeps the socket of a broker that never answers, takes a refused publication for one
that was taken, and asks for sockets by numbers that by then may be another's.
"""

from __future__ import annotations

import asyncio
import logging
import threading
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from typing import TYPE_CHECKING, TypeVar, cast

from quavelet.core.errors import SettingsError
from quavelet.settings.outputs import Destination, MqttSettings
from quavelet.sinks.transports.mqtt_login import read_password, tls_context
from quavelet.sinks.transports.mqtt_trouble import Trouble, of_error, of_reason

if TYPE_CHECKING:
    from paho.mqtt.client import Client, ConnectFlags, DisconnectFlags, SocketLike
    from paho.mqtt.properties import Properties
    from paho.mqtt.reasoncodes import ReasonCode

_KEEPALIVE_S = 15
_CONNECT_S = 5.0
"""For each of TCP and TLS."""
_ANSWER_S = 10.0
"""A broker that does not answer for so long is taken to be gone."""
_TICK_S = 1.0
_LARGEST_PACKET = 4096
"""Bytes that the broker may send at once (MQTT 5.0, 3.1.2.11.4): it has nothing to say but acknowledgements."""

_wire_log = logging.getLogger("quavelet.mqtt_wire")
# What goes wrong is told once, in our words; paho would tell each try.
_wire_log.setLevel(logging.CRITICAL)

T = TypeVar("T")
Answer = Callable[[str], None]
"""Called when the broker has answered a publication: with "", or with why it refuses it."""


class MqttConnection:
    """From `open` until `lost` is done; used on one event loop, and for one connection only."""

    def __init__(self, to: Destination, mqtt: MqttSettings, *, client_id: str, will_topic: str) -> None:
        """Reads password and certificates. Raises SettingsError where they, or paho, are not there."""
        try:
            from paho.mqtt.client import Client
            from paho.mqtt.enums import CallbackAPIVersion, MQTTProtocolVersion
        except ImportError as error:
            raise SettingsError("MQTT needs paho-mqtt: pip install 'quavelet[mqtt]'") from error
        self._loop = asyncio.get_running_loop()
        self._to = to
        self._mqtt = mqtt
        self.lost: asyncio.Future[Trouble] = self._loop.create_future()
        self._accepted: asyncio.Future[None] = self._loop.create_future()
        self._answers: dict[int, Answer] = {}
        self._tick: asyncio.TimerHandle | None = None
        client = Client(
            CallbackAPIVersion.VERSION2, client_id, protocol=MQTTProtocolVersion.MQTTv5, reconnect_on_failure=False
        )
        client.connect_timeout = _CONNECT_S
        client.enable_logger(_wire_log)
        if mqtt.user:
            client.username_pw_set(mqtt.user, read_password(mqtt))
        if to.way == "mqtts":
            client.tls_set_context(tls_context(mqtt))
        client.will_set(will_topic, b"offline", qos=max(1, mqtt.qos), retain=True)
        client.on_socket_open = self._on_socket_open
        client.on_socket_close = self._on_socket_close
        client.on_socket_register_write = self._on_socket_register_write
        client.on_socket_unregister_write = self._on_socket_unregister_write
        client.on_connect = self._on_connect
        client.on_disconnect = self._on_disconnect
        client.on_publish = self._on_publish
        self._client: Client = client

    async def open(self) -> None:
        """Connect and log in. Raises Trouble."""
        connect = partial(
            self._client.connect,
            self._to.host,
            self._to.port,
            _KEEPALIVE_S,
            clean_start=True,
            properties=_connect_properties(),
        )
        error = await self._on_a_thread(connect)
        if error is not None:
            raise of_error(error, mqtt=self._mqtt, broker=self._broker) from error
        await self.wait_for(self._accepted, within_s=_ANSWER_S)
        if not self._accepted.done():
            raise Trouble(f"{self._broker} takes the connection and does not answer: is it an MQTT broker?")
        self._keep_alive()

    def publish(self, topic: str, payload: bytes, *, qos: int, answer: Answer, retain: bool = False) -> None:
        """Let it go; `answer` is not called where the connection is lost before. Raises Trouble where it is already."""
        info = self._client.publish(topic, payload, qos, retain)
        if info.rc != 0:
            raise self.lost.result() if self.lost.done() else Trouble(f"{self._broker} has ended the connection")
        self._answers[info.mid] = answer

    async def published(self, topic: str, payload: bytes, *, qos: int, retain: bool, within_s: float = 0.0) -> str:
        """Publish and wait for the broker's answer: "", or why it refuses. Raises Trouble when none comes."""
        answered: asyncio.Future[str] = self._loop.create_future()
        self.publish(topic, payload, qos=qos, retain=retain, answer=answered.set_result)
        await self.wait_for(answered, within_s=within_s or _ANSWER_S)
        if answered.done():
            return answered.result()
        raise Trouble(f"{self._broker} does not answer any more")

    async def wait_for(self, done: asyncio.Future[T], *, within_s: float) -> None:
        """Until it is done or the time is up. Raises Trouble when the connection is lost before."""
        both: set[asyncio.Future[T] | asyncio.Future[Trouble]] = {done, self.lost}
        await asyncio.wait(both, timeout=within_s, return_when=asyncio.FIRST_COMPLETED)
        if self.lost.done() and not done.done():
            raise self.lost.result()

    async def disconnect(self, *, within_s: float) -> None:
        """Say that we go, so that the last will is not published."""
        self._client.disconnect()
        await asyncio.wait([self.lost], timeout=within_s)

    def close(self) -> None:
        """Let go of the socket whatever the broker does; also while `open` waits."""
        if self._tick is not None:
            self._tick.cancel()
        self._end(Trouble("closed"))
        connection = self._client.socket()
        if connection is not None:
            self._drop(connection)

    def _on_a_thread(self, connect: Callable[[], object]) -> asyncio.Future[Exception | None]:
        """What it raised. Nobody can stop it, so it is a thread that the program's end does not wait for."""
        ended: asyncio.Future[Exception | None] = self._loop.create_future()

        def end(error: Exception | None) -> None:
            if not ended.done():
                ended.set_result(error)

        def work() -> None:
            error: Exception | None = None
            try:
                connect()
            except (OSError, ValueError) as caught:
                error = caught
            # RuntimeError: the loop is closed.
            with suppress(RuntimeError):
                self._loop.call_soon_threadsafe(end, error)

        threading.Thread(target=work, name="mqtt connect", daemon=True).start()
        return ended

    @property
    def _broker(self) -> str:
        return f"{self._to.host}:{self._to.port}"

    def _end(self, trouble: Trouble) -> None:
        """The first reason counts."""
        if not self.lost.done():
            self.lost.set_result(trouble)

    def _keep_alive(self) -> None:
        self._client.loop_misc()
        if not self.lost.done():
            self._tick = self._loop.call_later(_TICK_S, self._keep_alive)

    def _read(self) -> None:
        connection = self._client.socket()
        try:
            self._client.loop_read()
            # TLS may hold more than the system says is there.
            while getattr(self._client.socket(), "pending", int)():
                self._client.loop_read()
        except Exception as error:  # noqa: BLE001 - a packet without sense raises whatever paho stumbles over
            self._end(Trouble(f"{self._broker} does not speak MQTT 5 ({type(error).__name__})"))
            if connection is not None:
                self._drop(connection)

    def _drop(self, connection: SocketLike) -> None:
        if connection.fileno() >= 0:
            self._loop.remove_reader(connection.fileno())
            self._loop.remove_writer(connection.fileno())
            connection.close()

    def _on_socket_open(self, _client: Client, _userdata: object, connection: SocketLike) -> None:
        # On the thread that connects.
        self._loop.call_soon_threadsafe(self._attach, connection)

    def _attach(self, connection: SocketLike) -> None:
        if self.lost.done():
            self._drop(connection)
        elif connection.fileno() >= 0:
            self._loop.add_reader(connection.fileno(), self._read)

    def _on_socket_close(self, _client: Client, _userdata: object, connection: SocketLike) -> None:
        if connection.fileno() >= 0:
            self._loop.remove_reader(connection.fileno())

    def _on_socket_register_write(self, _client: Client, _userdata: object, connection: SocketLike) -> None:
        # Also on the thread that connects.
        self._loop.call_soon_threadsafe(self._attach_writer, connection)

    def _attach_writer(self, connection: SocketLike) -> None:
        # By now it may be closed, and its number another's.
        if connection.fileno() >= 0:
            self._loop.add_writer(connection.fileno(), self._client.loop_write)

    def _on_socket_unregister_write(self, _client: Client, _userdata: object, connection: SocketLike) -> None:
        if connection.fileno() >= 0:
            self._loop.remove_writer(connection.fileno())

    def _on_connect(
        self,
        _client: Client,
        _userdata: object,
        _flags: ConnectFlags,
        reason: ReasonCode,
        _properties: Properties | None,
    ) -> None:
        if reason.is_failure:
            self._end(of_reason(reason.value, str(reason), broker=self._broker))
        elif not self._accepted.done():
            self._accepted.set_result(None)

    def _on_disconnect(
        self,
        _client: Client,
        _userdata: object,
        flags: DisconnectFlags,
        reason: ReasonCode,
        _properties: Properties | None,
    ) -> None:
        if flags.is_disconnect_packet_from_server:
            self._end(of_reason(reason.value, str(reason), broker=self._broker))
        elif self._accepted.done():
            why = "did it stop, or has another client the same client_id?"
            self._end(Trouble(f"{self._broker} has ended the connection: {why}"))
        else:
            self._end(
                Trouble(f"{self._broker} ends the connection at once: is that an MQTT 5 broker, with TLS or not?")
            )

    def _on_publish(
        self, _client: Client, _userdata: object, number: int, reason: ReasonCode, _properties: Properties | None
    ) -> None:
        answer = self._answers.pop(number, None)
        if answer is not None and not self.lost.done():
            answer(str(reason).lower() if reason.is_failure else "")


def _connect_properties() -> Properties:
    from paho.mqtt.packettypes import PacketTypes
    from paho.mqtt.properties import Properties

    properties = cast("Callable[[int], Properties]", Properties)(PacketTypes.CONNECT)
    properties.MaximumPacketSize = _LARGEST_PACKET
    return properties
