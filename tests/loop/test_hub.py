"""The hub: a slow, stuck, broken or faulty output harms itself alone, and what it lost is counted."""

import threading
from collections.abc import Iterator

import pytest

from quavelet.core.errors import ImuError, SettingsError
from quavelet.loop.hub import Hub, Policy, SubscriberStats

BOUND_S = 20.0


class ListSink:
    """Keeps what it is given; `had_four` says that the item 4 was among it."""

    def __init__(self) -> None:
        self.items: list[int] = []
        self.closed = threading.Event()
        self.had_four = threading.Event()
        self._had_any = threading.Event()

    def write(self, item: int) -> None:
        self.items.append(item)
        self._had_any.set()
        if item == 4:
            self.had_four.set()

    def had_one(self) -> bool:
        return self._had_any.wait(BOUND_S)

    def close(self) -> None:
        self.closed.set()


class GatedSink(ListSink):
    """Writes nothing until its gate is opened; `entered` says that it holds an item."""

    def __init__(self) -> None:
        super().__init__()
        self.gate = threading.Event()
        self.entered = threading.Event()

    def write(self, item: int) -> None:
        self.entered.set()
        assert self.gate.wait(BOUND_S)
        super().write(item)


class RaisingSink(ListSink):
    """Raises `error` at every item from the `good`-th on, and `at_close` when closed."""

    def __init__(self, error: BaseException | None, *, good: int = 0, at_close: BaseException | None = None) -> None:
        super().__init__()
        self._error = error
        self._good = good
        self._at_close = at_close

    def write(self, item: int) -> None:
        if self._error is not None and len(self.items) >= self._good:
            raise self._error
        super().write(item)

    def close(self) -> None:
        super().close()
        if self._at_close is not None:
            raise self._at_close


@pytest.fixture
def hub() -> Iterator[Hub[int]]:
    with Hub[int]() as hub:
        yield hub


def test_every_sink_gets_every_item_in_order_and_is_closed_after_the_last() -> None:
    sinks = [ListSink(), ListSink()]
    with Hub[int]() as hub:
        for n, sink in enumerate(sinks):
            hub.subscribe(f"s{n}", sink, depth=1_000)
        for item in range(1_000):
            hub.publish(item)
    for sink in sinks:
        assert sink.items == list(range(1_000))
        assert sink.closed.is_set()
    assert hub.stats() == (SubscriberStats("s0", 1_000, 0, None), SubscriberStats("s1", 1_000, 0, None))
    assert hub.failures() == {}


def test_a_slow_reader_loses_the_oldest_messages_and_the_publisher_never_waits(hub: Hub[int]) -> None:
    slow, quick = GatedSink(), ListSink()
    hub.subscribe("slow", slow, depth=4)
    hub.subscribe("quick", quick, depth=100)
    hub.publish(0)
    assert slow.entered.wait(BOUND_S)
    # Were it to wait, the gate would never open and the test would not end.
    for item in range(1, 50):
        hub.publish(item)
    assert hub.stats()[0] == SubscriberStats("slow", 0, 45, None)
    slow.gate.set()
    hub.close(BOUND_S)
    assert slow.items == [0, 46, 47, 48, 49]
    assert quick.items == list(range(50))
    assert hub.stats()[0] == SubscriberStats("slow", 5, 45, None)


@pytest.mark.parametrize("error", [ImuError("cannot encode"), OSError("disk full"), BrokenPipeError(32, "Broken pipe")])
def test_a_sink_that_raises_is_closed_and_reported_and_the_others_go_on(hub: Hub[int], error: Exception) -> None:
    bad, good = RaisingSink(error, good=2), ListSink()
    hub.subscribe("bad", bad)
    hub.subscribe("good", good)
    for item in range(3):
        hub.publish(item)
    assert bad.closed.wait(BOUND_S)
    assert hub.failures() == {"bad": error}
    for item in range(3, 10):
        hub.publish(item)
    hub.close(BOUND_S)
    assert good.items == list(range(10))
    assert bad.items == [0, 1]
    assert hub.stats() == (SubscriberStats("bad", 2, 8, str(error)), SubscriberStats("good", 10, 0, None))


@pytest.mark.parametrize(("error", "level"), [(OSError("disk full"), "WARNING"), (BrokenPipeError("gone"), "INFO")])
def test_a_failure_is_logged_once_and_a_reader_that_left_is_no_warning(
    caplog: pytest.LogCaptureFixture, error: OSError, level: str
) -> None:
    caplog.set_level("INFO")
    with Hub[int]() as hub:
        hub.subscribe("out", RaisingSink(error, at_close=error))
        for item in range(10):
            hub.publish(item)
    assert [(r.levelname, r.getMessage()) for r in caplog.records] == [
        (level, f"output out ended, the others go on: {error}")
    ]


def test_an_error_that_comes_only_when_the_sink_is_closed_is_reported_too() -> None:
    error = BrokenPipeError("gone at the last flush")
    with Hub[int]() as hub:
        hub.subscribe("stdout", RaisingSink(None, at_close=error))
        hub.publish(1)
    assert hub.failures() == {"stdout": error}
    assert hub.stats() == (SubscriberStats("stdout", 1, 0, "gone at the last flush"),)


def test_a_mistake_in_a_sinks_code_is_reported_and_its_traceback_shown(monkeypatch: pytest.MonkeyPatch) -> None:
    shown: list[BaseException | None] = []
    monkeypatch.setattr(threading, "excepthook", lambda args: shown.append(args.exc_value))
    mistake = TypeError("unsupported operand")
    bad = RaisingSink(mistake, at_close=OSError("and cannot close"))
    with Hub[int]() as hub:
        hub.subscribe("bad", bad)
        hub.publish(1)
    assert hub.failures() == {"bad": mistake}
    assert shown == [mistake]
    assert bad.closed.is_set()


def test_a_stuck_sink_is_given_up_after_the_time_out_and_what_it_held_counts_as_lost() -> None:
    stuck, good = GatedSink(), ListSink()
    hub = Hub[int]()
    hub.subscribe("stuck", stuck)
    hub.subscribe("good", good)
    for item in range(5):
        hub.publish(item)
    assert stuck.entered.wait(BOUND_S)
    assert good.had_four.wait(BOUND_S)
    hub.close(timeout_s=0.05)
    assert isinstance(hub.failures()["stuck"], TimeoutError)
    stats = hub.stats()
    assert stats[0] == SubscriberStats("stuck", 0, 5, "did not finish within 0.05 s")
    assert good.items == list(range(5))
    # Should it ever come free, it finishes the item in hand, writes no other, and closes.
    stuck.gate.set()
    assert stuck.closed.wait(BOUND_S)
    assert stuck.items == [0]


def test_with_policy_wait_nothing_is_lost_and_the_publisher_waits_for_room() -> None:
    sink = GatedSink()
    hub = Hub[int]()
    hub.subscribe("file", sink, depth=2, policy=Policy.WAIT)
    published = threading.Event()

    def publish() -> None:
        for item in range(100):
            hub.publish(item)
        published.set()

    thread = threading.Thread(target=publish)
    thread.start()
    assert sink.entered.wait(BOUND_S)
    assert not published.is_set()
    sink.gate.set()
    assert published.wait(BOUND_S)
    thread.join(BOUND_S)
    hub.close(BOUND_S)
    assert sink.items == list(range(100))
    assert hub.stats() == (SubscriberStats("file", 100, 0, None),)


def test_a_publisher_waiting_for_a_sink_that_fails_is_let_go() -> None:
    bad = RaisingSink(OSError("disk full"), good=3)
    with Hub[int]() as hub:
        hub.subscribe("file", bad, depth=1, policy=Policy.WAIT)
        for item in range(100):
            hub.publish(item)
    assert hub.stats() == (SubscriberStats("file", 3, 97, "disk full"),)


def test_a_publisher_waiting_for_a_stuck_sink_is_let_go_when_the_hub_closes() -> None:
    stuck = GatedSink()
    hub = Hub[int]()
    hub.subscribe("file", stuck, depth=1, policy=Policy.WAIT)

    def publish() -> None:
        for item in range(100):
            hub.publish(item)

    thread = threading.Thread(target=publish)
    thread.start()
    assert stuck.entered.wait(BOUND_S)
    hub.close(timeout_s=0.0)
    thread.join(BOUND_S)
    assert not thread.is_alive()
    assert isinstance(hub.failures()["file"], TimeoutError)
    stuck.gate.set()
    assert stuck.closed.wait(BOUND_S)


def test_delivered_and_lost_add_up_to_what_was_published_under_load() -> None:
    sinks = {f"s{depth}": ListSink() for depth in (1, 2, 7, 64)}
    with Hub[int]() as hub:
        for name, sink in sinks.items():
            hub.subscribe(name, sink, depth=int(name[1:]))
        for item in range(20_000):
            hub.publish(item)
    for stats in hub.stats():
        items = sinks[stats.name].items
        assert stats.delivered == len(items)
        assert stats.delivered + stats.lost == 20_000
        assert items == sorted(set(items))
        assert items[-1] == 19_999


def test_a_closed_hub_ignores_items_takes_no_sink_and_may_be_closed_again(hub: Hub[int]) -> None:
    sink = ListSink()
    hub.subscribe("a", sink)
    hub.close(BOUND_S)
    hub.publish(1)
    hub.close(BOUND_S)
    assert sink.items == []
    assert hub.stats() == (SubscriberStats("a", 0, 0, None),)
    with pytest.raises(SettingsError, match="closed"):
        hub.subscribe("b", ListSink())


def test_a_name_twice_and_a_queue_without_room_are_refused(hub: Hub[int]) -> None:
    hub.subscribe("a", ListSink())
    with pytest.raises(SettingsError, match="already"):
        hub.subscribe("a", ListSink())
    with pytest.raises(SettingsError, match="at least 1"):
        hub.subscribe("b", ListSink(), depth=0)


def test_who_is_unsubscribed_writes_what_is_queued_and_closes_and_nobody_waits_for_it(hub: Hub[int]) -> None:
    leaving, staying = GatedSink(), ListSink()
    hub.subscribe("leaving", leaving)
    hub.subscribe("staying", staying)
    for item in range(5):
        hub.publish(item)
    assert leaving.entered.wait(BOUND_S)
    # It is stuck: were either to wait for it, the test would not end.
    hub.unsubscribe("leaving")
    hub.publish(5)
    assert not leaving.closed.is_set()
    assert [s.name for s in hub.stats()] == ["staying"]
    leaving.gate.set()
    assert leaving.closed.wait(BOUND_S)
    assert leaving.items == [0, 1, 2, 3, 4]
    hub.close(BOUND_S)
    assert staying.items == [0, 1, 2, 3, 4, 5]


def test_the_name_of_who_was_unsubscribed_is_free_at_once_and_none_but_a_subscriber_can_be(hub: Hub[int]) -> None:
    first, second = GatedSink(), ListSink()
    hub.subscribe("page", first)
    hub.publish(1)
    hub.unsubscribe("page")
    with pytest.raises(SettingsError, match="none of that name"):
        hub.unsubscribe("page")
    hub.subscribe("page", second)
    hub.publish(2)
    first.gate.set()
    hub.close(BOUND_S)
    assert (first.items, second.items) == ([1], [2])


def test_a_hub_that_is_closed_waits_for_who_was_unsubscribed_just_before() -> None:
    sink = GatedSink()
    with Hub[int]() as hub:
        hub.subscribe("page", sink)
        hub.publish(1)
        hub.publish(2)
        assert sink.entered.wait(BOUND_S)
        hub.unsubscribe("page")
        threading.Timer(0.05, sink.gate.set).start()
    assert sink.items == [1, 2]
    assert sink.closed.is_set()


def test_a_publisher_that_waits_for_room_is_let_go_by_the_unsubscribe(hub: Hub[int]) -> None:
    sink = GatedSink()
    hub.subscribe("page", sink, depth=1, policy=Policy.WAIT)
    hub.publish(1)
    assert sink.entered.wait(BOUND_S)
    publisher = threading.Thread(target=lambda: [hub.publish(item) for item in (2, 3, 4)])
    publisher.start()
    hub.unsubscribe("page")
    publisher.join(BOUND_S)
    assert not publisher.is_alive()
    sink.gate.set()
    assert sink.closed.wait(BOUND_S)
    assert sink.items[0] == 1


def test_a_publisher_that_never_pauses_goes_on_while_others_come_and_go(hub: Hub[int]) -> None:
    sinks = [ListSink() for _ in range(50)]
    done = threading.Event()

    def publish() -> None:
        item = 0
        while not done.is_set():
            hub.publish(item)
            item += 1

    publisher = threading.Thread(target=publish)
    publisher.start()
    try:
        for sink in sinks:
            hub.subscribe("page", sink, depth=10_000)
            assert sink.had_one()
            hub.unsubscribe("page")
    finally:
        done.set()
        publisher.join(BOUND_S)
    for sink in sinks:
        assert sink.closed.wait(BOUND_S)
        # Some may have been dropped, the thread being slower; none comes twice, nor out of order.
        assert sink.items == sorted(set(sink.items))
