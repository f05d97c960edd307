"""From a status, flags and counters to sentences for a person: what is wrong, and what to do."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from typing import Literal

import msgspec

from quavelet.core.blocks import Flag
from quavelet.core.health import EXPECTED, WORDS
from quavelet.sinks.status import Status

Level = Literal["bad", "warn", "good"]
LATELY_S, LOOK_S = 60.0, 1.0
MISSED_SHARE = 0.01
"""A larger share of deadlines missed is something to look after."""
REPAIRS = frozenset({"bus_retries", "fifo_resets"})
"""They go with what they repair, which has a counter of its own."""
MOST_COUNTERS = 2
_WIRES = "Check the plugs and the wires: long or loose ones do this."
_SUPPLY = "Check the supply of the chip and its plug: 3.3 V must not dip."
_HOST = (
    "Give the host less to do, or let the program have its real-time priority: it says at the start what was refused."
)


class Words(msgspec.Struct, frozen=True, kw_only=True):
    """One sentence of what is, one of what to do, "" where nothing is."""

    level: Level
    what: str
    do: str = ""


def _warn(what: str, do: str) -> Words:
    return Words(level="warn", what=what, do=do)


OF_FLAGS: Mapping[Flag, Words] = {
    Flag.GAP: _warn("Samples are missing.", "Now and then is no harm; if it goes on, see what else is said here."),
    Flag.OVERFLOW: _warn("The host came too late, and the chip's memory was full.", _HOST),
    Flag.MISALIGNED: _warn("The chip's memory was out of step and was emptied.", _WIRES),
    Flag.BUS_ERROR: _warn("The chip could not be read for a moment.", _WIRES),
    Flag.GYRO_CLIPPED: _warn("It turns faster than the gyroscope can tell.", "Raise chip.gyro_range_dps."),
    Flag.ACCEL_CLIPPED: _warn("It is shaken harder than the accelerometer can tell.", "Raise chip.accel_range_g."),
    Flag.CLOCK_UNSURE: _warn("The chip's clock is still being measured.", "Wait for some seconds."),
    Flag.BIAS_UNKNOWN: _warn("What the gyroscope gives at rest is not known yet.", "Let the board lie still."),
    Flag.SETTLING: _warn("The attitude is not to be trusted yet.", "Let the board lie still for some seconds."),
    Flag.CHIP_UPSET: _warn("The chip had lost its settings or gave nothing, and was set up again.", _SUPPLY),
    Flag.IMPLAUSIBLE: _warn("The chip gave what no sensor gives; that was thrown away.", _WIRES),
    Flag.STUCK: Words(
        level="bad",
        what="The chip gives the same again and again, so it is stuck.",
        do="It is being reset; if that does not help, take its supply away for a moment.",
    ),
    Flag.HEADING_SUSPECT: _warn("Yaw may drift: a slow turn cannot be told from an error.", "Let the board lie still."),
    Flag.UNCALIBRATED_TEMPERATURE: _warn(
        "The chip is warmer or colder than it was when it was calibrated.", "Calibrate it at this temperature, too."
    ),
    Flag.FIELD_LOST: _warn("The magnetometer gives nothing; yaw goes on by the gyroscope alone.", _WIRES),
    Flag.FIELD_DISTURBED: _warn(
        "The magnetic field is not the Earth's here; yaw goes on by the gyroscope alone.",
        "Keep iron, magnets and motors away.",
    ),
}


class Lately:
    """Which counters have grown in the last minute, and by how much."""

    def __init__(self) -> None:
        self._seen: list[tuple[float, dict[str, int]]] = []

    def grown(self, status: Status) -> dict[str, int]:
        """By name, those that have."""
        now_s, counts = status.uptime_s, status.health
        self._seen = [(at_s, then) for at_s, then in self._seen if at_s > now_s - LATELY_S]
        then = self._seen[0][1] if self._seen else counts
        # It is asked for each that joins, too.
        if not self._seen or now_s - self._seen[-1][0] >= LOOK_S:
            self._seen.append((now_s, dict(counts)))
        return {name: n - then.get(name, 0) for name, n in counts.items() if n > then.get(name, 0)}


def words_of(status: Status, *, flags: Collection[str] = (), grown: Mapping[str, int] | None = None) -> list[Words]:
    """The worst first, one that says so where all is well. flags are all since the last time, grown is `Lately`'s."""
    found = [*_of_state(status), *_of_flags(status, flags), *_of_counters(grown or {}), *_of_the_rest(status)]
    found.sort(key=lambda words: words.level != "bad")
    return found or [Words(level="good", what="All is well.")]


def _of_state(status: Status) -> Iterator[Words]:
    state = status.state
    if state.startswith("lost"):
        why = state.removeprefix("lost").lstrip(": ")
        yield Words(
            level="bad", what=f"The chip is lost: {why or 'it gives nothing'}.", do=f"{_WIRES} It is tried again."
        )
    elif state.startswith("waiting"):
        yield Words(
            level="bad",
            what=f"No chip answers on {status.src}.",
            do=f"{_WIRES} `quavelet doctor --bus {status.src}` says more, once this is stopped.",
        )
    elif state == "settling" and status.message is None:
        yield OF_FLAGS[Flag.SETTLING]
    elif state not in ("running", "settling"):
        yield _warn(f"{state.capitalize()}.", "")


def _of_flags(status: Status, flags: Collection[str]) -> Iterator[Words]:
    if status.state not in ("running", "settling"):
        # They are of before.
        return
    raised = {*flags, *(status.message.flags if status.message else ())}
    for flag, words in OF_FLAGS.items():
        if str(flag.name).lower() in raised:
            yield words


def _of_counters(grown: Mapping[str, int]) -> Iterator[Words]:
    counted = {name: n for name, n in grown.items() if name not in EXPECTED}
    causes = {name: n for name, n in counted.items() if name not in REPAIRS} or counted
    most = sorted(causes, key=lambda name: -causes[name])
    told = [f"{causes[name]} x {WORDS.get(name, name)}" for name in most[:MOST_COUNTERS]]
    told += [f"and {len(most) - MOST_COUNTERS} more counters"] if len(most) > MOST_COUNTERS else []
    if told:
        yield _warn(
            f"In the last minute: {'; '.join(told)}.",
            "A few now and then are no harm; if it goes on, check the plugs and the wires.",
        )


def _of_the_rest(status: Status) -> Iterator[Words]:
    loop = status.loop
    if loop.missed > MISSED_SHARE * (loop.ticks + loop.missed):
        yield _warn("Many deadlines are missed.", _HOST)
    for output in status.outputs:
        if output.state.startswith("failed"):
            yield Words(
                level="bad",
                what=f"Output {output.name} does not work: {output.state.removeprefix('failed: ')}.",
                do="It is tried again; see where it goes to, and the network.",
            )
        elif output.lost:
            yield _warn(
                f"Output {output.name} has lost {output.lost} messages.",
                f"Its reader or its network is too slow: lower output.{output.name}.rate_hz.",
            )
    recording = status.recording
    if recording is not None and (recording.lost or recording.state.startswith("stopped")):
        yield Words(
            level="bad",
            what=f"The recording is {recording.state} and has lost {recording.lost} drains.",
            do="See whether the disk is full, or too slow.",
        )
