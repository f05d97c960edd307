"""The service streams to a real broker that is killed and comes back an hour of its time later, without a restart."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path

import msgspec
import pytest
from driven_loop import DrivenLoop
from mosquitto_broker import Broker, Listener, needs_mosquitto
from service_bed import Bed
from waiting import eventually

from hw_fakes import Sway
from quavelet.cli.status_words import in_words
from quavelet.core.units import NS_PER_S
from quavelet.service.status import memory_mb
from quavelet.settings import BusSettings, LoopSettings, MqttSettings, OutputSettings, Settings
from quavelet.sinks.message import Message
from quavelet.sinks.status import OutputStatus

pytestmark = needs_mosquitto

KILLED_S, AFTER_S = 6.0, 3.0
LONGEST_PAUSE_S = 60.0
GROWTH_MB = 4.0


@dataclass
class Watch:
    """What is seen of the outputs, at times of the service's clock."""

    bed: Bed
    loops: list[DrivenLoop]
    back_s: dict[str, float] = field(default_factory=dict)
    words: dict[float, list[str]] = field(default_factory=dict)
    memory_mb: list[float] = field(default_factory=list)

    @property
    def outputs(self) -> dict[str, OutputStatus]:
        return {one.name: one for one in self.bed.service.status().outputs}

    def keep_step(self) -> None:
        """The clock stands until every output is level with the messages, or between two tries to connect."""
        assert eventually(self._is_level, within_s=20.0, look_s=0.002), self.outputs
        for name, one in self.outputs.items():
            if one.state == "connected":
                self.back_s.setdefault(name, self.now_s)

    def end_when_back(self) -> None:
        """A little after both are connected."""
        self.keep_step()
        if len(self.back_s) == 2 and self.now_s >= max(self.back_s.values()) + AFTER_S:
            self.look()
            self.loops[0].let_go()
            self.bed.service.stop()

    @property
    def now_s(self) -> float:
        return self.bed.clock.now_ns() / NS_PER_S

    def _is_level(self) -> bool:
        outputs = self.outputs.values()
        connected = [one for one in outputs if one.state == "connected"]
        if any(thread.name == "mqtt connect" for thread in threading.enumerate()):
            return False
        if self.loops[0].sockets != len(connected):
            return False
        return all(one.sent + one.lost + one.left_out == self.bed.kept.count for one in connected)

    def look(self) -> None:
        self.words[self.now_s] = list(in_words(self.bed.service.status()))

    def weigh(self) -> None:
        self.memory_mb.append(memory_mb())


@pytest.fixture
def loops(monkeypatch: pytest.MonkeyPatch) -> Iterator[list[DrivenLoop]]:
    """The network's loop goes by the clock that is `driving`."""
    made: list[DrivenLoop] = []
    monkeypatch.setattr("asyncio.new_event_loop", lambda: made[-1])
    yield made


def settings_for(broker: Broker) -> Settings:
    plain = Settings(bus=BusSettings(name="fake:bed"), loop=LoopSettings(rate_hz=50.0))
    to = f"mqtt:127.0.0.1:{broker.port}"
    outputs = {
        "home": OutputSettings(to=to, rate_hz=10.0, mqtt=MqttSettings(topic="home")),
        "fast": OutputSettings(to=to, rate_hz=50.0, mqtt=MqttSettings(topic="fast", qos=1, home_assistant=False)),
    }
    chip = msgspec.structs.replace(plain.chip, sample_rate_hz=100.0)
    return msgspec.structs.replace(plain, chip=chip, output=outputs)


@pytest.mark.parametrize("away_s", [61.0, pytest.param(3600.0, marks=pytest.mark.slow)])
def test_a_broker_away_for_an_hour_is_told_counted_and_returned_to(
    away_s: float, loops: list[DrivenLoop], tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    broker, listeners = Broker(tmp_path), list[Listener]()
    bed = Bed(Sway(), settings=settings_for(broker), counts_only=True)
    loops.append(DrivenLoop(bed.clock))
    watch = Watch(bed, loops)
    back_s = KILLED_S + away_s
    latest_s = back_s + LONGEST_PAUSE_S + 2.0 * AFTER_S

    def kill() -> None:
        assert set(watch.back_s) == {"home", "fast"}
        watch.back_s.clear()
        broker.kill()
        assert eventually(lambda: all(one.state != "connected" for one in watch.outputs.values()))

    def come_back() -> None:
        broker.start()
        listeners.append(Listener(broker))
        assert listeners[0].is_ready()

    def step(from_s: float, to_s: float, what: Callable[[], None]) -> None:
        for tenth in range(round(10 * from_s), round(10 * to_s)):
            bed.clock.at(tenth / 10, what)

    broker.start()
    step(0.0, KILLED_S, watch.keep_step)
    bed.clock.at(KILLED_S, kill)
    bed.clock.at(KILLED_S + 0.25 * away_s, watch.weigh)
    bed.clock.at(back_s - 0.1, watch.weigh)
    bed.clock.at(back_s - 0.1, watch.look)
    bed.clock.at(back_s, come_back)
    step(back_s + 0.1, latest_s, watch.end_when_back)
    try:
        with caplog.at_level(logging.WARNING):
            bed.run(until_s=latest_s)
        (listener,) = listeners
        assert eventually(lambda: listener.newest("home/status") == listener.newest("fast/status") == "offline")

        for name in ("home", "fast"):
            made = bed.kept.count - (status := watch.outputs[name]).left_out
            assert status.sent + status.lost == made
            waited = back_s - KILLED_S
            rate_hz = 10.0 if name == "home" else 50.0
            # All but the 256 that waited, and what came while the broker was back and not yet found.
            assert rate_hz * waited - 256 - 10 <= status.lost <= rate_hz * (waited + LONGEST_PAUSE_S) - 256 + 10
            assert 0.0 < watch.back_s[name] - back_s <= LONGEST_PAUSE_S + 1.0
            assert listener.payloads(f"{name}/status") == ["online", "offline"]
            heard = [msgspec.json.decode(text, type=Message) for text in listener.payloads(f"{name}/attitude")]
            times_s = [one.t_ns / NS_PER_S for one in heard]
            assert times_s == sorted(set(times_s)), "in order, none twice"
            assert times_s[0] >= watch.back_s[name] - LONGEST_PAUSE_S - 1.0, "nothing of the hour as if it were new"
            assert times_s[-1] == pytest.approx(watch.now_s, abs=0.2)
            assert all(b - a < 1.5 / rate_hz + 0.02 for a, b in pairwise(times_s))
            told = [text for text in caplog.messages if text.startswith(f"output {name}: ")]
            assert len(told) == 2, "once that it goes, once that it is back"
            assert "waiting for the broker" in told[0]
            assert "connected to the broker again" in told[1]

        # Home Assistant's availability is the topic that the last will is on.
        (config,) = [str(one["payload"]) for one in listener.heard() if str(one["topic"]).startswith("homeassistant/")]
        assert '"availability_topic":"home/status"' in config
        away, returned = watch.words.values()
        minutes = "1 min 0 s" if away_s < 1000 else "59 min 59 s"
        assert sum("has no broker: 127.0.0.1" in line and f"(for {minutes})" in line for line in away) == 2
        assert not any("no broker" in line or "waiting" in line for line in returned)
        assert sum("its broker was away" in line for line in returned) == 2
        early_mb, late_mb = watch.memory_mb
        assert late_mb - early_mb < GROWTH_MB
    finally:
        for one in listeners:
            one.__exit__()
        broker.kill()
