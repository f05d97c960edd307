"""A real mosquitto that comes, goes, refuses and is impersonated; waits are real, short and bounded."""

from __future__ import annotations

import asyncio
import json
import logging
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import msgspec
import pytest
from mosquitto_broker import Broker, Listener, needs_mosquitto, soon
from mqtt_rig import connected, opened, payloads, plan_for, run, state_of
from output_plans import MESSAGE, Service, mqtt_plan
from waiting import eventually

from quavelet.sinks.outputs import make_transport
from quavelet.sinks.transports.backoff import Backoff
from quavelet.sinks.transports.mqtt import MqttTransport

pytestmark = needs_mosquitto


@pytest.mark.parametrize("qos", [0, 1, 2])
def test_what_is_sent_arrives_once_and_in_order_and_close_says_offline(qos: int, tmp_path: Path) -> None:
    async def scenario(broker: Broker, listener: Listener) -> None:
        async with opened(plan_for(broker, qos=qos)) as transport:
            await connected(transport)
            await payloads(transport, 0, 300)
            assert await soon(lambda: listener.newest("t/status") == "online")
        stats = transport.stats()
        assert (stats.state, stats.sent, stats.lost) == ("closed", 300, 0)
        assert await soon(lambda: listener.newest("t/status") == "offline")
        assert listener.payloads("t/attitude") == [str(number) for number in range(300)]

    with Broker(tmp_path) as broker, Listener(broker) as listener:
        assert listener.is_ready()
        run(scenario(broker, listener))


def test_a_broker_that_is_killed_and_comes_back_loses_nothing_that_may_wait(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    async def scenario(broker: Broker) -> None:
        async with opened(plan_for(broker)) as transport:
            await connected(transport)
            broker.kill()
            await payloads(transport, 0, 200)
            assert await soon(lambda: state_of(transport).startswith("waiting for the broker: "))
            broker.start()
            with Listener(broker) as listener:
                # The listener may come after the first of them: those it would miss are on their way already.
                await connected(transport)
                assert await soon(lambda: transport.stats().sent == 200)
                assert await soon(lambda: listener.newest("t/status") == "online")
            assert transport.stats().lost == 0

    with caplog.at_level(logging.WARNING), Broker(tmp_path) as broker:
        run(scenario(broker))
    assert len(caplog.messages) == 1, "an outage is told once, not once a try"


def test_a_night_without_a_broker_costs_the_oldest_and_each_is_counted(tmp_path: Path) -> None:
    async def scenario(broker: Broker) -> None:
        async with opened(plan_for(broker)) as transport:
            for number in range(5000):
                transport.send(str(number).encode())
            assert transport.stats().lost == 5000 - 256
            with broker, Listener(broker, "t/attitude") as listener:
                assert await soon(lambda: transport.stats().sent == 256)
                transport.send(b"new")
                assert await soon(lambda: listener.newest("t/attitude") == "new")
        stats = transport.stats()
        assert (stats.sent, stats.lost) == (257, 5000 - 256)

    run(scenario(Broker(tmp_path)))


def test_a_broker_that_stops_answering_keeps_nobody_waiting(tmp_path: Path) -> None:
    async def scenario(broker: Broker) -> None:
        async with opened(plan_for(broker)) as transport:
            await connected(transport)
            broker.freeze()
            longest_s = 0.0
            for number in range(3000):
                begun_s = time.monotonic()
                transport.send(bytes(400) + str(number).encode())
                if number % 50 == 0:
                    await asyncio.sleep(0)
                longest_s = max(longest_s, time.monotonic() - begun_s)
            stats = transport.stats()
            assert stats.lost + 256 + 8 == 3000
            # Far below the 10 s that a broker may take to answer: nothing waited for it.
            assert longest_s < 3.0
            broker.thaw()
            assert await soon(lambda: transport.stats().sent == 264)

    with Broker(tmp_path) as broker:
        run(scenario(broker))


def test_close_beside_a_broker_that_does_not_answer_is_over_in_a_moment(tmp_path: Path) -> None:
    async def scenario(broker: Broker) -> None:
        async with opened(plan_for(broker)) as transport:
            await connected(transport)
            broker.freeze()
            await payloads(transport, 0, 50)
            begun_s = time.monotonic()
        assert time.monotonic() - begun_s < 3.5
        stats = transport.stats()
        assert (stats.state, stats.sent + stats.lost) == ("closed", 50)
        broker.thaw()

    with Broker(tmp_path) as broker:
        run(scenario(broker))


def test_an_output_may_be_closed_and_opened_again(tmp_path: Path) -> None:
    async def scenario(broker: Broker) -> None:
        transport = MqttTransport(plan_for(broker))
        for round_ in range(1, 4):
            await transport.open()
            transport.send(b"1")
            assert await soon(lambda rounds=round_: transport.stats().sent == rounds)
            await transport.close()
            await transport.close()

    with Broker(tmp_path) as broker:
        run(scenario(broker))


def test_documents_stay_on_a_broker_and_come_back_to_one_that_forgot_them(tmp_path: Path) -> None:
    async def scenario(broker: Broker) -> None:
        async with opened(plan_for(broker)) as transport:
            await connected(transport)
            await documents(broker)
            broker.kill()
            broker.start()
            await documents(broker)

    async def documents(broker: Broker) -> None:
        """To one who comes later, until all are there."""

        def retained() -> set[str]:
            with Listener(broker) as late:
                late.is_ready()
                time.sleep(0.1)
                return {str(one["topic"]).replace(device(late), "ID") for one in late.heard() if one["retain"]}

        def device(late: Listener) -> str:
            return next((json.loads(text)["id"] for text in late.payloads("t/identity")), "?")

        wanted = {"t/status", "t/identity", "homeassistant/device/ID/config"}
        for _ in range(20):
            found = await asyncio.to_thread(retained)
            if found == wanted:
                return
            await asyncio.sleep(0.1)
        raise AssertionError(found)

    with Broker(tmp_path) as broker:
        run(scenario(broker))


def test_without_home_assistant_nothing_is_announced(tmp_path: Path) -> None:
    async def scenario(broker: Broker, listener: Listener) -> None:
        async with opened(plan_for(broker, home_assistant=False)) as transport:
            await connected(transport)
            assert await soon(lambda: listener.newest("t/diagnostics") is not None)
        assert {one["topic"] for one in listener.heard()} == {"t/status", "t/identity", "t/diagnostics"}

    with Broker(tmp_path) as broker, Listener(broker) as listener:
        assert listener.is_ready()
        run(scenario(broker, listener))


def test_documents_are_published_anew_only_when_they_have_changed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("quavelet.sinks.transports.mqtt.DIAGNOSTICS_S", 0.1)
    service = Service()

    def move_clock(ns: int) -> None:
        clock = msgspec.structs.replace(service.status.clock, offset_ns=service.status.clock.offset_ns + ns)
        service.change(clock=clock)

    async def rounds(listener: Listener, number: int) -> None:
        seen = len(listener.heard("t/diagnostics"))
        assert await soon(lambda: len(listener.heard("t/diagnostics")) >= seen + number)

    async def scenario(broker: Broker, listener: Listener) -> None:
        async with opened(plan_for(broker, service=service)) as transport:
            await connected(transport)
            move_clock(100_000)
            await rounds(listener, 3)
            assert len(listener.heard("t/identity")) == 1
            move_clock(2_000_000_000)
            service.change(message=msgspec.structs.replace(MESSAGE, yaw="magnetic"))
            await rounds(listener, 3)
        offsets = [json.loads(text)["clock"]["offset_ns"] for text in listener.payloads("t/identity")]
        assert len(offsets) == 2
        assert offsets[1] - offsets[0] == 2_000_100_000
        announced = [
            text for one in listener.heard() if "config" in str(one["topic"]) for text in [str(one["payload"])]
        ]
        assert ["Yaw (magnetic)" in text for text in announced] == [False, True]

    with Broker(tmp_path) as broker, Listener(broker) as listener:
        assert listener.is_ready()
        run(scenario(broker, listener))


def test_a_chip_that_is_lost_is_told_at_once_and_not_at_the_next_half_minute(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("quavelet.sinks.transports.mqtt._LOOK_S", 0.05)
    service = Service()

    async def scenario(broker: Broker, listener: Listener) -> None:
        async with opened(plan_for(broker, service=service)) as transport:
            await connected(transport)
            assert await soon(lambda: len(listener.heard("t/diagnostics")) == 1)
            service.change(state="lost: nothing answers at 0x68")
            assert await soon(lambda: len(listener.heard("t/diagnostics")) == 2)
            service.change(state="running")
            assert await soon(lambda: len(listener.heard("t/diagnostics")) == 3)
            await asyncio.sleep(0.3)
        assert [json.loads(text)["problem"] for text in listener.payloads("t/diagnostics")] == [False, True, False]

    with Broker(tmp_path) as broker, Listener(broker) as listener:
        assert listener.is_ready()
        run(scenario(broker, listener))


PROGRAM = """
import asyncio, sys
from output_plans import mqtt_plan
from quavelet.sinks.transports.mqtt import MqttTransport

async def main():
    transport = MqttTransport(mqtt_plan(sys.argv[1], topic="t"))
    await transport.open()
    await asyncio.sleep(60)

asyncio.run(main())
"""


def test_a_service_that_is_killed_is_offline_by_its_last_will(tmp_path: Path) -> None:
    with Broker(tmp_path) as broker, Listener(broker, "t/status") as listener:
        command = [sys.executable, "-c", PROGRAM, f"mqtt:127.0.0.1:{broker.port}"]
        with subprocess.Popen(command, env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}) as service:
            assert eventually(lambda: listener.newest("t/status") == "online", within_s=20.0)
            service.send_signal(signal.SIGKILL)
        assert eventually(lambda: listener.newest("t/status") == "offline")


def test_ten_megabytes_on_every_topic_of_ours_do_not_reach_us(tmp_path: Path) -> None:
    async def scenario(broker: Broker) -> None:
        async with opened(plan_for(broker)) as transport:
            await connected(transport)
            for topic in ("t/attitude", "t/status", "t/identity", "homeassistant/status"):
                command = [
                    "mosquitto_pub",
                    "-h",
                    "127.0.0.1",
                    "-p",
                    str(broker.port),
                    "-q",
                    "1",
                    "-r",
                    "-t",
                    topic,
                    "-s",
                ]
                process = await asyncio.create_subprocess_exec(*command, stdin=subprocess.PIPE)
                await process.communicate(bytes(10_000_000))
            await payloads(transport, 0, 50)
            assert await soon(lambda: transport.stats().sent == 50)
            assert state_of(transport) == "connected"

    with Broker(tmp_path) as broker:
        run(scenario(broker))


class Noted(Backoff):
    """Waits that are written down; without chance, so that each is twice the one before."""

    def __init__(self) -> None:
        super().__init__(first_s=0.05, most_s=60.0, uniform=lambda: 0.0)
        self.waits_s: list[float] = []

    def wait_s(self, *, slow: bool = False) -> float:
        self.waits_s.append(super().wait_s(slow=slow))
        return self.waits_s[-1]


def test_two_of_one_client_id_do_not_push_each_other_off_many_times_a_second(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    async def scenario(broker: Broker) -> None:
        waits = [Noted(), Noted()]
        pair = [MqttTransport(plan_for(broker, client_id="same"), backoff=one) for one in waits]
        for one in pair:
            await one.open()
        # By what they do, not by when: at each change there is a moment in which both are connected.
        assert await soon(lambda: min(len(one.waits_s) for one in waits) >= 5, within_s=30.0)
        for one in pair:
            await one.close()
        for noted in waits:
            assert noted.waits_s[:5] == pytest.approx([0.05, 0.05, 0.1, 0.2, 0.4])

    with caplog.at_level(logging.WARNING), Broker(tmp_path) as broker:
        run(scenario(broker))
    assert "has another client the same client_id?" in caplog.text


def test_an_output_to_mqtt_is_this_transport() -> None:
    async def scenario() -> None:
        assert isinstance(make_transport(mqtt_plan("mqtt:h")), MqttTransport)
        assert isinstance(make_transport(mqtt_plan("mqtts:h")), MqttTransport)

    run(scenario())
