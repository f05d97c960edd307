"""A broker that is away for an hour of the event loop's time: what waited is not taken for new when it is back."""

from __future__ import annotations

import asyncio
import logging
import re
import time
from collections.abc import Callable
from pathlib import Path

import pytest
from driven_loop import DrivenLoop
from mosquitto_broker import Broker, Listener, needs_mosquitto
from mqtt_rig import plan_for, state_of

from quavelet.core.clock import VirtualClock
from quavelet.core.units import NS_PER_S
from quavelet.sinks.transports.mqtt import MqttTransport

pytestmark = needs_mosquitto

EVERY_S, HOUR_S = 15, 3600
"""A board that lies still, with a dead band: 240 messages an hour, and all of them find room to wait."""


async def really(what: Callable[[], bool]) -> bool:
    """`soon`, while the loop's own time stands."""
    deadline_s = time.monotonic() + 10.0
    while not what() and time.monotonic() < deadline_s:
        await asyncio.to_thread(time.sleep, 0.005)
    return what()


def test_after_an_hour_the_last_minute_is_sent_and_what_is_older_is_lost_and_counted(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    clock = VirtualClock()

    async def scenario(broker: Broker) -> None:
        transport = MqttTransport(plan_for(broker))
        await transport.open()
        assert await really(lambda: state_of(transport) == "connected")
        broker.kill()
        assert await really(lambda: state_of(transport) != "connected")
        for number in range(HOUR_S // EVERY_S):
            transport.send(str(number).encode())
            for _ in range(EVERY_S):
                clock.advance_ns(NS_PER_S)
                await asyncio.sleep(0)
        state = state_of(transport)
        assert re.fullmatch(r"waiting for the broker: 127.0.0.1:\d+.* \(for 1 h 0 min\)", state), state
        broker.start()
        with Listener(broker) as listener:
            assert listener.is_ready()
            tries_s = 0
            while state_of(transport) != "connected" and tries_s < 100:
                clock.advance_ns(NS_PER_S)
                tries_s += 1
                await asyncio.to_thread(time.sleep, 0.005)
            # The longest wait between two tries.
            assert tries_s <= 62
            transport.send(b"new")
            assert await really(lambda: listener.newest("t/attitude") == "new")
            assert await really(lambda: listener.newest("t/status") == "online")
            came = [int(text) for text in listener.payloads("t/attitude")[:-1]]
        last = HOUR_S // EVERY_S
        assert came == list(range(came[0], last)), "in order, none twice"
        assert (last - came[0] - 1) * EVERY_S <= 60
        # What has been heard may not have been acknowledged yet.
        assert await really(lambda: transport.stats().sent == len(came) + 1)
        assert transport.stats().lost == last - len(came)
        await transport.close()

    with (
        caplog.at_level(logging.WARNING),
        Broker(tmp_path) as broker,
        asyncio.Runner(loop_factory=lambda: DrivenLoop(clock)) as runner,
    ):
        runner.run(scenario(broker))
    away, back = caplog.messages
    assert away.startswith("output home: waiting for the broker: ")
    assert re.search(r"connected to the broker again after 1 h \d min, in which 23\d messages were lost", back), back
