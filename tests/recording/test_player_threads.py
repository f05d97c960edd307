"""The player on its own threads, in real time: nobody who asks waits, and it ends when it is told to."""

import time
from pathlib import Path
from threading import Event

import pytest
from played import PLAIN, maker, messages_of, straight
from recorded import record_fake

from quavelet.core.clock import MonotonicClock
from quavelet.recording.player import Played, Player

PATIENCE_S = 20.0


@pytest.fixture(scope="module")
def path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return record_fake(tmp_path_factory.mktemp("threads") / "a.qrec", n=400).path


def test_it_plays_seeks_and_ends_by_itself(path: Path) -> None:
    given: list[Played] = []
    sought = Event()

    def give(played: Played) -> None:
        given.append(played)
        if played.before is not None:
            sought.set()

    player = Player(path, make_pipeline=maker(PLAIN), clock=MonotonicClock(), give=give)
    player.start()
    try:
        player.set_speed(20.0)
        begin_s = time.monotonic()
        player.seek(2.5)
        assert time.monotonic() - begin_s < 0.5
        assert sought.wait(PATIENCE_S)
        deadline_s = time.monotonic() + PATIENCE_S
        while not player.state().ended and time.monotonic() < deadline_s:
            time.sleep(0.01)
        assert player.state().ended
    finally:
        player.close()
    assert player.failure is None
    expected = messages_of(straight(path, PLAIN))
    assert messages_of([given[-1].attitude])[0].q == expected[-1].q


def test_closing_does_not_wait_for_the_first_pass(path: Path) -> None:
    player = Player(path, make_pipeline=maker(PLAIN), clock=MonotonicClock(), give=lambda _: None)
    player.start()
    begin_s = time.monotonic()
    player.close()
    assert time.monotonic() - begin_s < PATIENCE_S / 4
    assert not player.first_pass.done


def test_a_mistake_of_who_takes_it_is_kept_for_the_owner(path: Path) -> None:
    def give(_: Played) -> None:
        raise ZeroDivisionError

    player = Player(path, make_pipeline=maker(PLAIN), clock=MonotonicClock(), give=give)
    with pytest.raises(ZeroDivisionError):
        player._kept(lambda: player._until_stopped(player.step))
    assert isinstance(player.failure, ZeroDivisionError)
