"""The network's thread: a part that fails, is stuck or has a mistake harms itself alone, and never the loop."""

import asyncio
import threading
from collections.abc import Iterator

import pytest
from network_rig import BOUND_S, Rig, message, network, plan, until

from quavelet.core.clock import VirtualClock
from quavelet.core.errors import ImuError, SettingsError
from quavelet.loop.hub import Hub
from quavelet.sinks.message import Message
from quavelet.sinks.network import Network
from quavelet.sinks.outputs import ENCODINGS, make_output


class Keeper:
    """A part that keeps what it is given, and does what else it is told."""

    def __init__(self, name: str = "keeper") -> None:
        self.name = name
        self.times: list[int] = []
        self.opened = 0
        self.closed = 0
        self.open_raises: list[BaseException] = []
        self.write_raises: list[BaseException] = []

    async def open(self) -> None:
        self.opened += 1
        if self.open_raises:
            raise self.open_raises.pop(0)

    def write(self, message: Message) -> bool:
        if self.write_raises:
            raise self.write_raises.pop(0)
        self.times.append(message.t_ns)
        return True

    async def close(self) -> None:
        self.closed += 1


@pytest.fixture
def rig() -> Iterator[Rig]:
    with network() as rig:
        yield rig


def add(rig: Rig, *parts: Keeper) -> None:
    for part in parts:
        rig.network.add(part)
    until(lambda: all(part.opened for part in parts))


@pytest.mark.parametrize("error", [OSError("gone"), ImuError("gone"), ZeroDivisionError("gone")], ids=repr)
def test_a_part_that_raises_is_told_of_once_and_opened_again_and_the_others_get_all(rig: Rig, error: Exception) -> None:
    bad, good = Keeper("bad"), Keeper("good")
    bad.write_raises = [error, type(error)("gone")]
    add(rig, bad, good)
    rig.send(0, 10)
    until(lambda: len(good.times) == 10)
    until(lambda: bad.opened == 2)
    rig.send(10, 11)
    until(lambda: bad.opened == 3)
    until(lambda: rig.send(20, 21) or bool(bad.times))
    assert bad.closed == 2
    assert "gone; it is tried again, the others go on" in rig.said[0]
    assert rig.said[1:] == ["bad: works again"]
    assert good.times[:11] == list(range(11))


def test_a_part_that_cannot_be_opened_is_tried_until_it_can_and_told_of_once(rig: Rig) -> None:
    late = Keeper("late")
    late.open_raises = [OSError("no route") for _ in range(5)]
    add(rig, late)
    until(lambda: late.opened == 6)
    assert rig.said == ["late: no route; it is tried again, the others go on", "late: works again"]
    rig.send(0, 3)
    until(lambda: late.times == [0, 1, 2])


def test_an_encoding_with_a_mistake_ends_its_output_alone(rig: Rig, monkeypatch: pytest.MonkeyPatch) -> None:
    class Wrong:
        def encode(self, message: Message) -> bytes:
            raise KeyError(message.t_ns)

    monkeypatch.setitem(ENCODINGS, "nmea", lambda _: Wrong())
    good = Keeper("good")
    add(rig, good)
    output = make_output(plan("udp:127.0.0.1:9", encoding="nmea"))
    rig.network.add(output)
    until(lambda: rig.status(output).state.startswith("sending"))
    rig.send(0, 100)
    until(lambda: len(good.times) == 100)
    until(lambda: any("KeyError" in text for text in rig.said))


def test_a_stuck_part_costs_the_publisher_nothing_and_what_is_lost_is_counted() -> None:
    gate, entered = threading.Event(), threading.Event()

    class Stuck(Keeper):
        def write(self, message: Message) -> bool:
            entered.set()
            assert gate.wait(BOUND_S)
            return super().write(message)

    with network(wait_for_room=False) as rig:
        stuck = Stuck()
        add(rig, stuck)
        rig.send(0, 1)
        assert entered.wait(BOUND_S)
        rig.send(1, 10_000)  # returns, or the test never ends
        assert rig.network.lost == 10_000 - 257
        gate.set()
        until(lambda: len(stuck.times) == 257)
        assert stuck.times == list(range(257))


def test_in_virtual_time_nothing_is_lost_to_a_slow_part() -> None:
    with network() as rig:
        part = Keeper()
        add(rig, part)
        rig.send(0, 20_000)
        until(lambda: len(part.times) == 20_000)
        assert rig.network.lost == 0


def test_as_a_subscriber_of_the_hub_it_is_closed_with_it() -> None:
    part = Keeper()
    it = Network(talk=print, clock=VirtualClock(), wait_for_room=True)
    it.start()
    it.add(part)
    until(lambda: part.opened == 1)
    with Hub[Message]() as hub:
        hub.subscribe("network", it, depth=256)
        for n in range(100):
            hub.publish(message(n))
    assert part.times == list(range(100))
    assert part.closed == 1
    it.write(message(100))
    it.close()


def test_a_part_that_never_ends_does_not_keep_the_program_from_ending() -> None:
    class Endless(Keeper):
        async def close(self) -> None:
            await asyncio.Event().wait()

    rig = Rig()
    add(rig, Endless())
    rig.network.close()
    assert not any(thread.name == "network" and thread.is_alive() for thread in threading.enumerate())


def test_a_part_that_is_removed_gets_no_more(rig: Rig) -> None:
    gone, stays = Keeper("gone"), Keeper("stays")
    add(rig, gone, stays)
    rig.send(0, 5)
    rig.network.remove(gone)
    assert gone.closed == 1
    rig.send(5, 10)
    until(lambda: stays.times == list(range(10)))
    assert gone.times == list(range(5))


def test_the_latency_is_from_the_drain_to_the_send_of_its_own_message(rig: Rig) -> None:
    part = Keeper()
    add(rig, part)
    rig.clock.advance_ns(1_000_000)
    for n in range(1, 4):
        rig.network.drained(n, 400_000)
    rig.network.drained(9, 0)
    rig.send(3, 4)  # 1 and 2 were lost on the way
    until(lambda: part.times == [3])
    until(lambda: rig.network.latency.count == 1)
    assert rig.network.latency.max_ns == 600_000
    rig.send(5, 6)  # of no drain
    rig.send(9, 10)
    until(lambda: rig.network.latency.count == 2)
    assert rig.network.latency.max_ns == 1_000_000


def test_an_encoding_or_a_transport_that_is_not_there_is_refused_by_name(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delitem(ENCODINGS, "json")
    with pytest.raises(SettingsError, match=r"output\.x: encoding 'json' is not there"):
        make_output(plan("udp:127.0.0.1:9"))
