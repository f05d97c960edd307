"""The ability "play": what a stranger asks is done or refused with a sentence, after a seek the page has its past."""

import sys
from pathlib import Path

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st
from web_rig import Rig, run

from quavelet.core.clock import VirtualClock
from quavelet.core.units import NS_PER_S
from quavelet.pipeline import build_pipeline
from quavelet.recording.player import Player
from quavelet.settings import Settings
from quavelet.sinks.message import Message
from quavelet.web.ability import Ability, HasPast
from quavelet.web.playing import AGAIN_NS, SENT_FOR_NS, Playing

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "recording"))
from recorded import record_fake

SECONDS = 4.4
JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=3), inner, max_size=3),
    max_leaves=5,
)


@pytest.fixture(scope="module")
def path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return record_fake(tmp_path_factory.mktemp("playing") / "a.qrec", n=400).path


class Bed:
    """The ability over a player on virtual time; `published` is what the page would get."""

    def __init__(self, path: Path, *, known: bool = True) -> None:
        self.clock = VirtualClock()
        self.published: list[Message] = []
        self.player = Player(path, make_pipeline=lambda: build_pipeline(Settings()), clock=self.clock)
        self.playing = Playing(self.player, publish=self.published.append, clock=self.clock)
        self.player.give = self.playing.give
        while known and self.player.first_pass.step():
            pass

    def step(self, n: int = 1) -> None:
        for _ in range(n):
            self.player.step()


def test_it_is_an_ability_with_a_past(path):
    playing: Ability = Bed(path).playing
    assert isinstance(playing, HasPast)
    assert playing.name == "play"


def test_the_page_learns_of_the_whole_at_once(path):
    about = msgspec.to_builtins(Bed(path).playing.about())
    assert about["file"] == "a.qrec"
    assert about["length_s"] == pytest.approx(SECONDS, abs=0.1)
    overview = about["overview"]
    assert set(overview) == {"t_s", "roll_deg", "pitch_deg", "yaw_deg", "gaps"}
    assert len({len(overview[name]) for name in ("t_s", "roll_deg", "pitch_deg", "yaw_deg")}) == 1
    assert 20 < len(overview["t_s"]) <= 2000


def test_pause_resume_speed_and_seek_are_seen_in_the_state(path):
    bed = Bed(path)
    do = bed.playing.do
    assert do("pause", {}) == "paused"
    assert bed.playing.state().paused
    assert do("seek", {"t_s": 3}) == "going to 3.0 s"
    assert bed.playing.state().wanted_s == 3.0
    bed.step()
    assert (bed.playing.state().t_s, bed.playing.state().wanted_s) == (3.0, None)
    assert do("speed", {"x": 2.5}) == "playing at 2.5 times the speed"
    assert do("resume", {}) == "playing"
    assert (bed.playing.state().speed, bed.playing.state().paused) == (2.5, False)


def test_at_the_end_resume_plays_it_again(path):
    bed = Bed(path)
    bed.playing.do("seek", {"t_s": 99})
    bed.step()
    assert bed.playing.state().ended
    bed.playing.do("resume", {})
    bed.step(3)
    assert not bed.playing.state().ended
    assert bed.playing.state().t_s < 1.0


@pytest.mark.parametrize(("what", "key"), [("seek", "t_s"), ("speed", "x")])
@pytest.mark.parametrize("value", [None, True, "3", [3], {}, float("nan"), float("inf"), -float("inf"), 10**400])
def test_what_is_no_number_is_refused_and_changes_nothing(path, what, key, value):
    bed = Bed(path, known=False)
    before = bed.playing.state()
    with pytest.raises(ValueError, match=f"{key} is no number"):
        bed.playing.do(what, {key: value})
    with pytest.raises(ValueError, match=f"{key} is no number"):
        bed.playing.do(what, {})
    assert bed.playing.state() == before


@pytest.mark.parametrize("x", [0, -1, 0.05, 1e9])
def test_a_speed_out_of_bounds_is_refused(path, x):
    with pytest.raises(ValueError, match="give one from"):
        Bed(path, known=False).playing.do("speed", {"x": x})


@given(what=st.sampled_from(["pause", "resume", "seek", "speed"]) | st.text(max_size=8), values=st.data())
def test_whatever_is_asked_it_is_done_or_refused_in_a_sentence(path, what, values):
    bed = Bed(path, known=False)
    asked = values.draw(st.dictionaries(st.sampled_from(["t_s", "x"]) | st.text(max_size=3), JSON, max_size=3))
    try:
        assert bed.playing.do(what, asked)
    except ValueError as error:
        assert str(error)
    msgspec.json.encode(bed.playing.state())


def test_the_past_belongs_to_the_message_that_was_sought_and_to_no_other(path):
    bed = Bed(path)
    bed.step(20)
    bed.playing.do("seek", {"t_s": 4.0})
    bed.step()
    bed.playing.do("seek", {"t_s": 2.0})
    bed.step(20)
    pasts = [bed.playing.past(message) for message in bed.published]
    assert [i for i, past in enumerate(pasts) if past is not None] != []
    assert sum(past is not None for past in pasts) == 2
    for message, past in zip(bed.published, pasts, strict=True):
        for before in past or ():
            assert before.t_ns < message.t_ns
            assert before.src == message.src == "replay:fake:turntable"


def test_the_overview_is_sent_as_it_grows_and_then_no_more(path):
    bed = Bed(path, known=False)
    assert bed.playing.state().overview is None
    bed.player.first_pass.step()
    bed.clock.advance_ns(AGAIN_NS)
    first = bed.playing.state().overview
    assert first is not None
    bed.clock.advance_ns(SENT_FOR_NS)
    assert bed.playing.state().overview is None
    while bed.player.first_pass.step():
        pass
    last = bed.playing.state().overview
    assert last is not None
    assert len(last.t_s) > len(first.t_s)
    bed.clock.advance_ns(10 * NS_PER_S)
    assert bed.playing.state().overview is None
    assert "overview" not in msgspec.to_builtins(bed.playing.state())


def test_after_a_seek_the_page_is_sent_what_was_before_it_also_where_time_hardly_jumps(path):
    bed = Bed(path)

    async def scenario(rig: Rig) -> None:
        async with rig.viewer() as viewer:
            assert (await viewer.until("history"))["t_ns"] == []
            bed.step(20)
            for message in bed.published:
                rig.page.write(message)
            bed.published.clear()
            bed.playing.do("seek", {"t_s": 1.0})
            bed.step()
            (sought,) = bed.published
            rig.page.write(sought)
            history = await viewer.until("history")
            assert 5 <= len(history["t_ns"]) <= 15
            assert history["t_ns"] == sorted(history["t_ns"])
            while (message := (await viewer.until("message"))["m"])["t_ns"] != sought.t_ns:
                assert message["t_ns"] < sought.t_ns
            assert message["roll_deg"] == sought.roll_deg

    run(scenario, abilities=(bed.playing,))
