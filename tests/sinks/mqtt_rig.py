"""An output to a broker of the test's own, with short pauses between its tries."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Coroutine
from contextlib import asynccontextmanager
from typing import Any

from mosquitto_broker import Broker, soon
from output_plans import Service, mqtt_plan

from quavelet.sinks.plan import OutputPlan
from quavelet.sinks.transports.backoff import Backoff
from quavelet.sinks.transports.mqtt import MqttTransport


def run(scenario: Coroutine[Any, Any, None]) -> None:
    asyncio.run(asyncio.wait_for(scenario, 40.0))


@asynccontextmanager
async def opened(plan: OutputPlan) -> AsyncIterator[MqttTransport]:
    transport = MqttTransport(plan, backoff=Backoff(first_s=0.05, most_s=0.2))
    await transport.open()
    try:
        yield transport
    finally:
        await transport.close()


def plan_for(
    broker: Broker, *, service: Service | None = None, to: str = "mqtt:127.0.0.1", **mqtt: object
) -> OutputPlan:
    return mqtt_plan(f"{to}:{broker.port}", service=service, topic="t", **mqtt)


def state_of(transport: MqttTransport) -> str:
    return transport.stats().state


async def connected(transport: MqttTransport) -> None:
    assert await soon(lambda: state_of(transport) == "connected"), state_of(transport)


async def payloads(transport: MqttTransport, first: int, last: int) -> None:
    for number in range(first, last):
        transport.send(f"{number}\n".encode())
        await asyncio.sleep(0.002)
