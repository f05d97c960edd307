"""The bench session that is watched from the page: on a fake board, by its own time, and nothing of it is kept."""

from __future__ import annotations

import tempfile
import threading
import time
from collections.abc import Callable, Iterator

import msgspec
import numpy as np
import pytest

from hw_fakes.wire.bench import BenchBus
from quavelet.bench.session import KINDS, USUAL
from quavelet.bench.session_paced import PacedClock, PacedSession
from quavelet.bench.session_page import NOT_KEPT, CalibratePage, CalibrateState
from quavelet.bench.session_words import in_words
from quavelet.core.errors import SettingsError
from quavelet.core.instruction import FACES, Instruction
from quavelet.core.quaternion import inclination_between
from quavelet.core.units import NS_PER_S

FAST = 1e6
"""Nothing waits for a real clock."""
LOADED_S = 2.0
"""A machine that is busy with other things."""


@pytest.fixture
def page() -> Iterator[CalibratePage]:
    page = CalibratePage(speed=FAST)
    yield page
    page.close()
    assert not page.running


def until(page: CalibratePage, there: Callable[[CalibrateState], bool], most_s: float = 60.0) -> CalibrateState:
    end = time.monotonic() + most_s
    while not there(state := page.state()):
        assert time.monotonic() < end, state
        time.sleep(0.002)
    return state


def test_a_session_from_the_page_comes_to_its_verdict_and_leaves_nothing_behind(page, tmp_path, monkeypatch):
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    assert page.state() == CalibrateState(running=False, speed=FAST)
    assert page.do("start", {"steps": ["faces"]}).endswith(NOT_KEPT)
    told = set()

    def done(state: CalibrateState) -> bool:
        if state.view is not None:
            told.add(state.view.instruction)
        return not state.running

    state = until(page, done)
    assert state.why == ""
    assert state.result.verdict == "good"
    assert [line.title for line in state.result.lines] == ["accelerometer", "gyroscope scale", "verdict"]
    assert state.result.lines[-1].text == f"good; {NOT_KEPT}"
    assert state.result.lines[0].text.startswith("1 g within 0.")
    assert {line.level for line in state.result.lines} <= {"good", "warn"}
    assert [step.name for step in state.view.steps] == ["faces", "check"]
    assert {step.progress for step in state.view.steps} == {1.0}
    # The words are those that a person at a terminal hears.
    asked = [
        Instruction(action="rest"),
        Instruction(action="pose"),
        *(Instruction(action="face", face=f) for f in FACES),
    ]
    asked += [Instruction(action="turn", face=face, turn_deg=180.0) for face in FACES]
    assert told <= {"", *map(in_words, asked)}
    assert len(told) > 3
    assert list(tmp_path.iterdir()) == []
    assert msgspec.json.decode(msgspec.json.encode(state))["view"]["at"] == 2


def test_the_board_is_drawn_another_way_than_it_lies():
    off_deg, clocks = [], []

    class Watched(PacedSession):
        def show(self, view):
            super().show(view)
            if self.q is not None:
                t_ns = clocks[0].now_ns()
                truth = bus[0].attitude(np.array([t_ns]))[0]
                off_deg.append((t_ns, np.degrees(inclination_between(truth, np.array(self.q)))))

    bus: list[BenchBus] = []

    def opened(name, clock):
        clocks.append(clock)
        bus.append(BenchBus(clock=clock, seed=3, name=name))
        return bus[0]

    assert Watched(["faces"], bus="fake:bench", speed=FAST, opened=opened).run()
    # Not calibrated, drawn from the data sheet's limits, and turned by hand: what the picture needs.
    settled = [off for t_ns, off in off_deg if t_ns > 20 * NS_PER_S]
    assert len(settled) > 200
    assert np.percentile(settled, 90) < 6.0


def test_a_session_that_is_stopped_says_so_and_another_begins_anew(page):
    page.do("start", {})
    until(page, lambda state: state.q is not None)
    with pytest.raises(SettingsError, match="stop it first"):
        page.do("start", {})
    assert page.do("stop", {}) == "the calibration is stopped"
    state = until(page, lambda state: not state.running)
    assert state.why == "stopped before its end" and state.result is None
    page.do("start", {"steps": ["rest"]})
    state = until(page, lambda state: not state.running)
    assert state.why == "" and state.result is not None


def test_the_end_of_the_program_waits_for_a_session_no_longer_than_a_second():
    page = CalibratePage(speed=1.0)
    page.do("start", {})
    until(page, lambda state: state.view is not None)
    before = time.monotonic()
    page.close()
    assert time.monotonic() - before < 1.0 + LOADED_S
    assert not page.running and "calibrate" not in {thread.name for thread in threading.enumerate()}
    with pytest.raises(SettingsError):
        page.do("start", {})


@pytest.mark.parametrize(
    ("what", "values"),
    [
        ("start", {"steps": []}),
        ("start", {"steps": "faces"}),
        ("start", {"steps": ["../faces"]}),
        ("start", {"steps": [3]}),
        ("start", {"steps": {"faces": 1}}),
        ("stop", {}),
        ("save", {}),
        ("", {}),
    ],
)
def test_what_a_stranger_sends_begins_a_session(page, what: str, values: dict[str, object]):
    with pytest.raises(SettingsError):
        page.do(what, values)
    assert page.state() == CalibrateState(running=False, speed=FAST)


@pytest.mark.parametrize("bus", ["fake:still", "fake:nothing"])
def test_a_bus_whose_board_nobody_moves_is_calibrated_from_the_page(bus: str):
    page = CalibratePage(bus=bus, speed=FAST)
    page.do("start", {})
    state = until(page, lambda state: not state.running)
    assert ("nobody moves the board" in state.why) == (bus == "fake:still")
    assert state.result.verdict == "bad" and state.result.lines[0].text == state.why


def test_the_page_knows_other_steps_than_the_session(page):
    about = page.about()
    assert [(step.name, step.title) for step in about.steps] == [(kind.name, kind.title) for kind in KINDS]
    assert tuple(step.name for step in about.steps if step.usual) == USUAL


def test_a_paced_clock_runs_ahead_of_its_speed():
    clock = PacedClock(speed=50.0, stopped=threading.Event())
    before = time.monotonic()
    for k in range(1, 101):
        clock.sleep_until_ns(k * NS_PER_S // 20)
        clock.advance_ns(1000)
    assert time.monotonic() - before >= 0.095
    assert clock.now_ns() == pytest.approx(5 * NS_PER_S, abs=NS_PER_S // 1000)


def test_a_host_that_is_too_slow_is_followed_by_haste():
    clock = PacedClock(speed=50.0, stopped=threading.Event())
    clock.sleep_until_ns(NS_PER_S // 10)
    time.sleep(0.2)  # ten seconds of its time
    clock.sleep_until_ns(clock.now_ns() + NS_PER_S // 10)
    before = time.monotonic()
    clock.sleep_until_ns(clock.now_ns() + 5 * NS_PER_S)
    assert time.monotonic() - before > 0.09


def test_a_stopped_clock_keeps_nobody_waiting():
    stopped = threading.Event()
    clock = PacedClock(speed=0.001, stopped=stopped)
    threading.Timer(0.05, stopped.set).start()
    before = time.monotonic()
    clock.sleep_until_ns(3600 * NS_PER_S)
    assert time.monotonic() - before < 5.0
    assert clock.now_ns() == 3600 * NS_PER_S


@pytest.mark.parametrize("speed", [0.0, -1.0, float("nan")])
def test_a_time_that_stands_still_is_refused(speed: float):
    with pytest.raises(ValueError, match="above 0"):
        PacedClock(speed=speed, stopped=threading.Event())
