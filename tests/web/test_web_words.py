"""What a person is told: every flag, every state and every counter has words, and all is well only when it is."""

from __future__ import annotations

import msgspec
import pytest
from output_plans import MESSAGE, STATUS

from quavelet.core.blocks import Flag
from quavelet.loop.deadline import LoopStats
from quavelet.sinks.status import OutputStatus, RecordingStatus, Status
from quavelet.web.health_words import OF_FLAGS, Lately, words_of


def with_(**fields: object) -> Status:
    return msgspec.structs.replace(STATUS, **fields)


def test_all_is_well_where_nothing_is_wrong():
    (only,) = words_of(STATUS)
    assert (only.level, only.do) == ("good", "")


@pytest.mark.parametrize("flag", list(Flag))
def test_every_flag_has_what_and_what_to_do(flag):
    words = OF_FLAGS[flag]
    assert words.what.endswith(".") and words.do.endswith(".") and words.level in ("bad", "warn")
    name = str(flag.name).lower()
    assert words in words_of(with_(message=msgspec.structs.replace(MESSAGE, flags=[name])))
    assert words in words_of(STATUS, flags=[name])


def test_flags_of_a_chip_that_is_gone_are_of_before():
    words = words_of(with_(state="lost: no answer", message=msgspec.structs.replace(MESSAGE, flags=["gyro_clipped"])))
    assert [w.level for w in words] == ["bad"] and "no answer" in words[0].what


@pytest.mark.parametrize(
    ("state", "level"),
    [
        ("waiting for the chip", "bad"),
        ("lost: a wire", "bad"),
        ("lost", "bad"),
        ("ended: x", "warn"),
        ("running", "good"),
    ],
)
def test_every_state_has_words_and_the_worst_comes_first(state, level):
    words = words_of(with_(state=state), grown={"spikes": 1})
    assert words[0].level == ("warn" if level == "good" else level)
    assert words_of(with_(state=state))[0].level == level


def test_settling_without_any_message_says_what_to_do():
    assert "still" in words_of(with_(state="settling", message=None))[0].do


def test_what_was_counted_is_told_for_a_minute_and_not_for_ever():
    lately = Lately()
    health = dict(STATUS.health)

    def at(uptime_s: float) -> dict[str, int]:
        return lately.grown(with_(uptime_s=uptime_s, health=dict(health)))

    assert at(10.0) == {}
    health["bus_errors"] += 3
    health["samples"] += 1000
    assert at(11.0) == {"bus_errors": 3, "samples": 1000}
    assert at(60.0)["bus_errors"] == 3
    assert at(72.0) == {}
    for _ in range(1000):
        at(72.5)
    assert len(lately._seen) <= 60
    (words,) = words_of(STATUS, grown={"bus_errors": 3, "samples": 1000})
    assert words.what == "In the last minute: 3 x a transfer failed."


def test_after_an_outage_its_cause_is_said_and_not_all_that_was_done_about_it():
    grown = {"bus_errors": 258, "bus_retries": 172, "fifo_resets": 2, "outages": 1, "chip_restarts": 1, "starved": 1}
    (words,) = words_of(STATUS, grown=grown)
    assert words.what.startswith("In the last minute: 258 x a transfer failed; ")
    assert words.what.endswith("; and 2 more counters.")
    assert "172" not in words.what
    (words,) = words_of(STATUS, grown={"bus_retries": 3})
    assert "3 x" in words.what


def test_the_loop_outputs_and_the_recording_are_spoken_of():
    output = OutputStatus(name="home", to="udp:x:1", encoding="json", state="failed: no route")
    lost = OutputStatus(name="phone", to="udp:x:1", encoding="json", state="open", lost=4)
    status = with_(
        loop=LoopStats(90, 10, 0, 0, 0, 0, 0, 0),
        outputs=[lost, output],
        recording=RecordingStatus(state="stopped: disk full", lost=2),
    )
    words = words_of(status)
    assert [w.level for w in words] == ["bad", "bad", "warn", "warn"]
    said = " ".join(w.what for w in words)
    for part in ("no route", "phone has lost 4", "disk full", "deadlines"):
        assert part in said
