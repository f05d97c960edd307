"""A recording played from anywhere gives what a straight replay gives, to the bit."""

from functools import cache
from math import inf, nan
from pathlib import Path

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from played import DENOISED, KINDS, LEAD_NS, PLAIN, SECONDS, Playing, messages_of, straight, two_streams
from recorded import INFO, assert_identical, record

from quavelet.core.blocks import concat
from quavelet.core.units import NS_PER_S
from quavelet.mpu6050.drain import Drain
from quavelet.recording.reader import RecordingReader
from quavelet.sinks.message import Message

WAYS = {"plain": PLAIN, "denoised": DENOISED}
RUNS = [*((kind, "plain") for kind in KINDS), ("a gap", "denoised"), ("two streams", "denoised")]


@pytest.fixture(scope="module")
def recordings(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    folder = tmp_path_factory.mktemp("player")
    paths = {kind: folder / f"{kind}.qrec" for kind in KINDS}
    for kind, make in KINDS.items():
        make(paths[kind])
    return paths


@cache
def straight_messages(path: Path, way: str) -> list[Message]:
    return messages_of(straight(path, WAYS[way]))


@cache
def playing_of(path: Path, way: str) -> Playing:
    return Playing(path, WAYS[way])


@pytest.mark.parametrize(("kind", "way"), RUNS)
def test_played_without_a_seek_it_is_the_straight_replay(recordings: dict[str, Path], kind: str, way: str) -> None:
    playing = Playing(recordings[kind], WAYS[way], known=False)
    playing.to_the_end()
    assert messages_of(played.attitude for played in playing.given) == straight_messages(recordings[kind], way)
    assert all(played.before is None for played in playing.given)


# At 2 s sharp the filter has just settled, and what is sought is the last of a tenth of a second.
@example(seeks=[(2.0, 0.0)])
@example(seeks=[(2.000001, 0.0)])
@pytest.mark.parametrize(("kind", "way"), RUNS)
@settings(max_examples=5, deadline=None)
@given(seeks=st.lists(st.tuples(st.floats(-1, SECONDS + 5), st.floats(0, 0.5)), min_size=1, max_size=3))
def test_after_any_seeks_the_messages_are_those_of_a_straight_replay(
    recordings: dict[str, Path], kind: str, way: str, seeks: list[tuple[float, float]]
) -> None:
    expected = straight_messages(recordings[kind], way)
    # One player for all examples: it must not matter where it was before.
    playing = playing_of(recordings[kind], way)
    for t_s, for_s in seeks:
        playing.given.clear()
        playing.player.seek(t_s)
        playing.arrive()
        state = playing.player.state()
        assert state.t_s == pytest.approx(min(max(t_s, 0.0), state.length_s), abs=1e-6)
        playing.play(for_s)
        if not playing.given:
            continue
        assert [played.before is None for played in playing.given] == [False] + [True] * (len(playing.given) - 1)
        got = messages_of(played.attitude for played in playing.given)
        first = place_of(got, expected)
        assert got == expected[first : first + len(got)]


def place_of(got: list[Message], expected: list[Message]) -> int:
    """Where `got` begins in `expected`, whose times may come twice."""
    places = [i for i, message in enumerate(expected) if message == got[0]]
    assert places, "the first message is none of a straight replay"
    return next((i for i in places if expected[i : i + len(got)] == got), places[0])


def test_a_seek_brings_the_seconds_before_it_without_a_hole(recordings: dict[str, Path]) -> None:
    playing = Playing(recordings["steady"])
    playing.player.pause()
    playing.player.seek(9.0)
    playing.arrive()
    (played,) = playing.given
    assert played.before is not None
    rows = concat([*played.before, played.attitude])
    whole = concat(straight(recordings["steady"], PLAIN))
    begin = int((whole.t_ns == rows.t_ns[0]).argmax())
    assert_identical(rows, whole[begin : begin + len(rows)])
    assert rows.t_ns[-1] - rows.t_ns[0] == pytest.approx(LEAD_NS, abs=0.05 * NS_PER_S)
    assert 15 <= len(played.before) <= 35


def test_while_paused_nothing_comes_but_what_was_sought(recordings: dict[str, Path]) -> None:
    playing = Playing(recordings["steady"])
    playing.play(1.0)
    playing.player.pause()
    before = playing.player.state()
    playing.given.clear()
    playing.play(5.0)
    assert playing.given == []
    assert playing.player.state() == before
    playing.player.seek(8.0)
    playing.arrive()
    playing.play(5.0)
    assert len(playing.given) == 1
    assert playing.player.state().t_s == 8.0
    playing.player.resume()
    playing.play(0.5)
    assert playing.player.state().t_s == pytest.approx(8.5, abs=0.011)


@pytest.mark.parametrize("speed", [0.1, 1.0, 3.0, 50.0, 100.0])
def test_it_takes_as_long_as_its_speed_says_and_no_sample_is_left_out(
    recordings: dict[str, Path], speed: float
) -> None:
    playing = Playing(recordings["steady"])
    playing.player.set_speed(speed)
    playing.player.seek(3.0)
    playing.arrive()
    begin_ns = playing.clock.now_ns()
    playing.given.clear()
    playing.play(1.0 if speed < 10 else 0.05)
    took_s = (playing.clock.now_ns() - begin_ns) / NS_PER_S
    assert playing.player.state().t_s - 3.0 == pytest.approx(speed * took_s, abs=0.011 + 0.005 * speed)
    rows = concat([played.attitude for played in playing.given])
    whole = concat(straight(recordings["steady"], PLAIN))
    begin = int((whole.t_ns == rows.t_ns[0]).argmax())
    assert_identical(rows, whole[begin : begin + len(rows)])
    assert len(playing.given) <= 250 * took_s


def test_a_change_of_speed_does_not_make_time_jump(recordings: dict[str, Path]) -> None:
    playing = Playing(recordings["steady"])
    for speed in (1.0, 10.0, 0.5, 50.0, 1.0):
        before_s = playing.player.state().t_s
        playing.player.set_speed(speed)
        playing.play(0.1)
        gone_s = playing.player.state().t_s - before_s
        assert gone_s == pytest.approx(0.1 * speed, abs=0.03 + 0.01 * speed)


def test_a_machine_that_is_too_slow_does_not_run_after_what_it_missed(recordings: dict[str, Path]) -> None:
    playing = Playing(recordings["steady"])
    playing.play(1.0)
    playing.clock.advance_ns(20 * NS_PER_S)
    playing.play(1.0)
    assert playing.player.state().t_s == pytest.approx(2.0, abs=0.1)


def length_s(path: Path) -> float:
    drains = [item for item in RecordingReader(path) if isinstance(item, Drain)]
    return (drains[-1].after_ns - drains[0].after_ns) / NS_PER_S


def test_the_end_is_stayed_at_and_can_be_left(recordings: dict[str, Path]) -> None:
    playing = Playing(recordings["steady"])
    playing.player.seek(1e300)
    playing.arrive()
    state = playing.player.state()
    assert state.ended
    assert state.t_s == state.length_s == state.known_s == length_s(recordings["steady"])
    playing.play(3.0)
    assert playing.player.state() == state
    assert len(playing.given) == 1
    playing.player.seek(5.0)
    playing.arrive()
    playing.play(1.0)
    assert playing.player.state().t_s == pytest.approx(6.0, abs=0.011)
    assert not playing.player.state().ended


def test_beyond_what_is_known_a_seek_waits_and_says_so(recordings: dict[str, Path]) -> None:
    playing = Playing(recordings["steady"], known=False)
    player = playing.player
    player.seek(9.0)
    playing.play(1.0)
    state = player.state()
    assert (state.wanted_s, state.known_s, state.t_s, state.ended) == (9.0, 0.0, 0.0, False)
    assert playing.given == []
    while player.first_pass.known_ns < 7 * NS_PER_S:
        player.first_pass.step()
    assert not player.first_pass.done
    playing.arrive()
    assert player.state().t_s == 9.0
    assert messages_of([playing.given[0].attitude])[0] in straight_messages(recordings["steady"], "plain")


def test_the_last_of_many_seeks_counts(recordings: dict[str, Path]) -> None:
    playing = Playing(recordings["steady"])
    for t_s in (5.0, 9.0, 3.0):
        playing.player.seek(t_s)
    playing.arrive()
    assert len(playing.given) == 1
    assert playing.player.state().t_s == 3.0


def test_its_length_is_known_before_the_file_is_gone_through(recordings: dict[str, Path]) -> None:
    for kind, path in recordings.items():
        playing = Playing(path, known=False)
        for _ in range(2):
            playing.player.first_pass.step()
        guessed_s = playing.player.state().length_s
        while playing.player.first_pass.step():
            pass
        within = 0.5 if kind == "two streams" else 1e-6
        assert guessed_s == pytest.approx(playing.player.state().length_s, rel=within), kind


@pytest.mark.parametrize(
    ("kind", "words"),
    [("steady", ""), ("damaged", "damaged at byte"), ("cut", "cut off, or never closed"), ("two streams", "")],
)
def test_what_is_wrong_with_the_file_is_said(recordings: dict[str, Path], kind: str, words: str) -> None:
    says = Playing(recordings[kind]).player.state().says
    assert words in says
    assert bool(says) == bool(words)


def test_a_time_of_a_long_silence_shows_what_came_last_before_it(tmp_path: Path) -> None:
    two_streams(path := tmp_path / "a.qrec")
    playing = Playing(path)
    playing.player.seek(SECONDS / 3 + 1.5)
    playing.arrive()
    (played,) = playing.given
    assert 0 < len(played.attitude) <= 4
    assert played.before


def test_a_recording_without_a_sample_has_no_length_and_ends_at_once(tmp_path: Path) -> None:
    playing = Playing(record(tmp_path / "a.qrec", [INFO]))
    playing.player.step()
    state = playing.player.state()
    assert (state.length_s, state.t_s, state.ended) == (0.0, 0.0, True)
    playing.player.seek(3.0)
    playing.arrive()
    assert playing.player.state().ended
    assert playing.given == []
    assert playing.player.overview().t_s == []


@pytest.mark.parametrize("speed", [0.0, 0.09, 101.0, -1.0, nan, inf])
def test_a_speed_that_is_none_changes_nothing(recordings: dict[str, Path], speed: float) -> None:
    player = Playing(recordings["steady"], known=False).player
    with pytest.raises(ValueError, match=r"give one from 0\.1 to 100"):
        player.set_speed(speed)
    assert player.state().speed == 1.0


@pytest.mark.parametrize("t_s", [nan, inf, -inf])
def test_a_time_that_is_none_changes_nothing(recordings: dict[str, Path], t_s: float) -> None:
    player = Playing(recordings["steady"], known=False).player
    with pytest.raises(ValueError, match="is no time"):
        player.seek(t_s)
    assert player.state().wanted_s is None


def test_health_is_that_up_to_where_it_plays(recordings: dict[str, Path]) -> None:
    playing = Playing(recordings["a gap"])
    playing.player.seek(9.0)
    playing.arrive()
    assert playing.player.health.gaps >= 1
    playing.player.seek(5.0)
    playing.arrive()
    assert playing.player.health.gaps == 0
    assert playing.player.health.samples == pytest.approx(5 * 222, rel=0.2)
