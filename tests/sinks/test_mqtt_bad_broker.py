"""What a broker may send that makes no sense: nothing crashes, nothing is left open, and the loop goes on."""

from __future__ import annotations

import asyncio
import os
import socket
import subprocess
import sys
import time
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from mosquitto_broker import soon
from output_plans import mqtt_plan

from quavelet.sinks.transports.backoff import Backoff
from quavelet.sinks.transports.mqtt import MqttTransport

# MQTT 5.0, 2.1.1 and 2.1.4: type and flags, then how many bytes follow.
CONNACK = b"\x20\x03\x00\x00\x00"
TEN_MEGABYTES = b"\x30\x84\x80\x80\x05" + b"\x00\x01a\x00" + bytes(10 * 2**20)
ANSWERS = {
    "nothing": b"",
    "another protocol": b"HTTP/1.1 400 Bad Request\r\n\r\n",
    "a length without end": b"\xff" * 1000,
    "an acceptance too short": b"\x20\x00",
    "an acceptance of MQTT 3": b"\x20\x02\x00\x00",
    "a refusal of MQTT 3": b"\x20\x02\x00\x01",
    "an acceptance with a property there is not": b"\x20\x04\x00\x00\x01\xff",
    "a refusal": b"\x20\x03\x00\x88\x00",
    "a refusal with a reason there is not": b"\x20\x03\x00\xfe\x00",
    "an acknowledgement too short": CONNACK + b"\x40\x01\x00",
    "an acknowledgement of what was never sent": CONNACK + b"\x40\x02\x7f\xff",
    "a publication shorter than its topic": CONNACK + b"\x30\x02\xff\xff",
    "a publication with a topic that is not UTF-8": CONNACK + b"\x30\x06\x00\x02\xff\xfe\x00x",
    "a publication of ten megabytes": CONNACK + TEN_MEGABYTES,
    "a farewell with a reason there is not": CONNACK + b"\xe0\x01\xff",
    "a request that only brokers get": CONNACK + b"\xc0\x00",
    "a packet there is not": CONNACK + b"\x00\x00",
}


class BadBroker:
    """Gives each connection the next of its answers; `hold`: and does not close."""

    def __init__(self, *answers: bytes, hold: bool) -> None:
        self.connections = 0
        self._answers = answers
        self._hold = hold
        self._ends: set[asyncio.StreamWriter] = set()

    async def start(self) -> int:
        self._server = await asyncio.start_server(self._serve, "127.0.0.1", 0)
        return int(self._server.sockets[0].getsockname()[1])

    async def _serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        answer = self._answers[self.connections % len(self._answers)]
        self.connections += 1
        self._ends.add(writer)
        try:
            await reader.read(10)
            writer.write(answer)
            await writer.drain()
            while self._hold and await reader.read(4096):
                pass
        except OSError:
            pass
        finally:
            writer.close()

    async def stop(self) -> None:
        self._server.close()
        for end in self._ends:
            end.close()
        await self._server.wait_closed()


async def beside(broker: BadBroker, *, connections: int, within_s: float) -> str:
    """Run an output at the broker until it has connected so often, or for so long; its last state."""
    loop = asyncio.get_running_loop()
    complaints: list[dict[str, Any]] = []
    loop.set_exception_handler(lambda _, complaint: complaints.append(complaint))
    port = await broker.start()
    transport = MqttTransport(mqtt_plan(f"mqtt:127.0.0.1:{port}"), backoff=Backoff(first_s=0.002, most_s=0.002))
    await transport.open()
    ticks = [time.monotonic()]

    def tick() -> bool:
        transport.send(b"{}")
        ticks.append(time.monotonic())
        return broker.connections >= connections

    await soon(tick, within_s=within_s)
    state = transport.stats().state
    given = len(ticks) - 1
    begun_s = time.monotonic()
    await transport.close()
    assert time.monotonic() - begun_s < 3.5
    assert transport.stats().sent + transport.stats().lost == given
    await broker.stop()
    await asyncio.sleep(0.05)
    assert not complaints
    # A tick is 20 ms; a loop that waited for a connection or an answer would be 5 or 10 s late.
    assert max(after - before for before, after in pairwise(ticks)) < 4.5
    return state


def open_files() -> int:
    return len(list(Path("/proc/self/fd").iterdir()))


@pytest.mark.parametrize("hold", [False, True], ids=["and closes", "and holds"])
@pytest.mark.parametrize("answer", ANSWERS)
def test_an_answer_that_makes_no_sense_is_tried_again_later(answer: str, hold: bool) -> None:
    before = open_files()
    state = asyncio.run(beside(BadBroker(ANSWERS[answer], hold=hold), connections=4, within_s=0.25))
    assert state.startswith(("waiting for the broker: ", "connected"))
    assert open_files() <= before + 1


@settings(max_examples=10, deadline=None, suppress_health_check=list(HealthCheck))
@given(st.lists(st.binary(max_size=300), min_size=10, max_size=30))
def test_no_bytes_of_a_broker_end_the_output(answers: list[bytes]) -> None:
    before = open_files()
    broker = BadBroker(*(CONNACK * (n % 2) + answer for n, answer in enumerate(answers)), hold=False)
    asyncio.run(beside(broker, connections=len(answers), within_s=5.0))
    assert broker.connections >= len(answers)
    assert open_files() <= before + 1


@pytest.mark.parametrize("host", ["a..b", 70 * "a", "no-such-host.invalid"])
def test_a_host_that_nobody_knows_is_told(host: str) -> None:
    async def scenario() -> None:
        transport = MqttTransport(mqtt_plan(f"mqtt:{host}"), backoff=Backoff(first_s=0.01, most_s=0.01))
        await transport.open()
        assert await soon(lambda: "no such host is known" in transport.stats().state)
        await transport.close()

    asyncio.run(scenario())


PROGRAM = """
import asyncio, sys
from output_plans import mqtt_plan
from quavelet.sinks.transports import mqtt_connection
from quavelet.sinks.transports.mqtt import MqttTransport

# The thread that connects never gives up: a program that waited for it would not end.
mqtt_connection._CONNECT_S = 3600.0

async def main():
    transport = MqttTransport(mqtt_plan(sys.argv[1]))
    await transport.open()
    await asyncio.sleep(0.2)
    await transport.close()
    print(transport.stats().state)

asyncio.run(main())
"""


def test_a_program_that_ends_does_not_wait_for_a_broker_that_does_not_answer() -> None:
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    with socket.create_server(("127.0.0.1", 0)) as silent:
        command = [sys.executable, "-c", PROGRAM, f"mqtts:127.0.0.1:{silent.getsockname()[1]}"]
        done = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=60)
    assert (done.stdout, done.stderr) == ("closed\n", "")
