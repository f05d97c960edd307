"""The time of day is set: who listens is told the new offset; a certificate that does not hold yet is called so."""

from __future__ import annotations

import asyncio
import json
import ssl
from pathlib import Path

import msgspec
import pytest
from mosquitto_broker import Broker, Listener, needs_mosquitto, soon
from mqtt_rig import connected, opened, plan_for, run
from output_plans import Service

from quavelet.settings.outputs import MqttSettings
from quavelet.sinks.transports.mqtt_trouble import of_error

HOUR_NS = 3600 * 1_000_000_000
YEARS_NS = 20 * 365 * 24 * HOUR_NS


@needs_mosquitto
@pytest.mark.parametrize("step_ns", [HOUR_NS, -HOUR_NS, YEARS_NS])
def test_identity_and_diagnostics_have_the_new_offset_at_the_next_look(
    step_ns: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("quavelet.sinks.transports.mqtt._LOOK_S", 0.05)
    service = Service()

    def offsets(listener: Listener, topic: str) -> list[int]:
        return [json.loads(text)["clock"]["offset_ns"] for text in listener.payloads(topic)]

    async def scenario(broker: Broker, listener: Listener) -> None:
        before = service.status.clock
        async with opened(plan_for(broker, service=service)) as transport:
            await connected(transport)
            assert await soon(lambda: len(offsets(listener, "t/diagnostics")) == 1)
            service.change(clock=msgspec.structs.replace(before, offset_ns=before.offset_ns + step_ns, steps=1))
            assert await soon(lambda: len(offsets(listener, "t/diagnostics")) == 2)
            await asyncio.sleep(0.2)
        for topic in ("t/identity", "t/diagnostics"):
            assert offsets(listener, topic) == [before.offset_ns, before.offset_ns + step_ns]

    with Broker(tmp_path) as broker, Listener(broker) as listener:
        assert listener.is_ready()
        run(scenario(broker, listener))


@pytest.mark.parametrize(("code", "words"), [(9, "certificate is not yet valid"), (10, "certificate has expired")])
def test_a_certificate_that_does_not_hold_by_our_clock_asks_whether_the_clock_is_right(code: int, words: str) -> None:
    error = ssl.SSLCertVerificationError(1, "")
    error.verify_code, error.verify_message = code, words
    trouble = of_error(error, mqtt=MqttSettings(), broker="home:8883")
    assert words in str(trouble)
    assert "timedatectl" in str(trouble)
    assert trouble.lasting
