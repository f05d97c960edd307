"""The time of day is set while the service runs, as on a Pi without a battery: what it tells others jumps, no more."""

from __future__ import annotations

import json
import socket
from collections.abc import Callable
from datetime import datetime
from itertools import pairwise
from pathlib import Path

import msgspec
import pytest
from service_bed import Bed, EventClock
from waiting import eventually

from hw_fakes import Sway
from quavelet.core.clock import Clock
from quavelet.core.units import NS_PER_S
from quavelet.recording.mcap import offset_of
from quavelet.recording.reader import RecordingReader
from quavelet.service.time_of_day import TimeOfDay
from quavelet.settings import BusSettings, OutputSettings, RecordingSettings, Settings

PLAIN = Settings(bus=BusSettings(name="fake:bed"))
BOOT = "c0ffee" + 26 * "0"
BEGIN_NS = 1_700_000_000 * NS_PER_S
HOUR_S, YEARS_S = 3600, 20 * 365 * 86_400
STEPS_S = [HOUR_S, -HOUR_S, YEARS_S, -YEARS_S]
SET_S, END_S = 6.0, 9.0


class Wall:
    """The time of day, that goes with the clock and can be set."""

    def __init__(self, clock: Clock) -> None:
        self.offset_ns = BEGIN_NS
        self._clock = clock

    def __call__(self) -> int:
        return self._clock.now_ns() + self.offset_ns

    def set_by(self, step_s: float) -> None:
        self.offset_ns += round(step_s * NS_PER_S)


def bed_with(
    settings: Settings, step_s: float, *, folder: Path | None = None, before: Callable[[Bed], None] = lambda _: None
) -> Bed:
    """One whose time of day is set by `step_s` at SET_S; `before` is done in that moment, before it."""
    clock = EventClock()
    wall = Wall(clock)
    environ = {"RUNTIME_DIRECTORY": str(folder), "QUAVELET_BOOT_ID": BOOT} if folder else None
    bed = Bed(Sway(), settings=settings, clock=clock, wall_ns=wall, environ=environ)

    def step() -> None:
        before(bed)
        wall.set_by(step_s)

    clock.at(SET_S, step)
    return bed


@pytest.mark.parametrize("step_s", STEPS_S)
def test_attitude_loop_and_systemd_do_not_notice_and_the_journal_says_it_once(step_s: float) -> None:
    plain, stepped = bed_with(PLAIN, 0.0), bed_with(PLAIN, step_s)
    for bed in (plain, stepped):
        bed.run(until_s=END_S)
    assert stepped.messages == plain.messages
    assert stepped.heard.told == plain.heard.told
    assert stepped.service.imu is not None and plain.service.imu is not None
    assert stepped.service.imu.loop.stats == plain.service.imu.loop.stats
    assert stepped.service.imu.health == plain.service.imu.health
    assert plain.said == []
    (told,) = stepped.said
    way, span = "forward" if step_s > 0 else "back", "1 h 0 min" if abs(step_s) == HOUR_S else "7300 d 0 h"
    assert told.startswith(f"the time of day was set {way} by {span}: ")
    clock = stepped.service.status().clock
    assert (clock.offset_ns, clock.steps) == (BEGIN_NS + step_s * NS_PER_S, 1)


def unix_s(encoding: str, sent: bytes) -> float:
    """The time that is told in it."""
    if encoding == "influx":
        return int(sent.split()[-1]) / NS_PER_S
    return datetime.fromisoformat(json.loads(sent)["updates"][0]["timestamp"]).timestamp()


@pytest.mark.parametrize("encoding", ["influx", "signalk"])
@pytest.mark.parametrize("step_s", STEPS_S)
def test_times_in_an_output_jump_with_it_and_by_nothing_else(step_s: float, encoding: str) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
        sock.settimeout(10.0)
        sock.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4_000_000)
        sock.bind(("127.0.0.1", 0))
        to = f"udp:127.0.0.1:{sock.getsockname()[1]}"
        output = OutputSettings(to=to, encoding=encoding, rate_hz=10.0)  # type: ignore[arg-type]

        def level(bed: Bed) -> None:
            """The network's thread runs in real time: what was said before is told before."""

            def all_went() -> bool:
                (one,) = bed.service.status().outputs
                return one.sent + one.left_out == len(bed.messages)

            assert eventually(all_went)

        bed = bed_with(msgspec.structs.replace(PLAIN, output={"x": output}), step_s, before=level)

        def opened() -> None:
            """No message comes before there is somebody to take it."""
            assert not bed.messages
            assert eventually(lambda: bed.service.status().outputs[0].state.startswith("sending to"))

        bed.clock.at(0.001, opened)
        bed.run(until_s=END_S)
        times_s = [unix_s(encoding, sock.recv(65_536)) for _ in range(bed.service.status().outputs[0].sent)]
    jumps = [b - a for a, b in pairwise(times_s) if abs(b - a) > 600.0]
    assert len(jumps) == 1
    # The offset is asked for at each message, while virtual time goes on.
    assert jumps[0] == pytest.approx(step_s, abs=5.0)
    assert times_s[0] == pytest.approx(BEGIN_NS / NS_PER_S, abs=SET_S + 5.0)


@pytest.mark.parametrize("step_s", STEPS_S)
def test_recordings_keep_their_order_lose_nothing_and_begin_anew_with_the_right_time(
    step_s: float, tmp_path: Path
) -> None:
    recording = RecordingSettings(directory=str(tmp_path), file_minutes=0.1, keep_free_mb=0.0)
    bed = bed_with(msgspec.structs.replace(PLAIN, recording=recording), step_s, before=drained)
    bed.run(until_s=END_S)
    files = sorted(tmp_path.iterdir())
    assert [int(path.name.split("-")[1]) for path in files] == list(range(1, len(files) + 1))
    offsets, drains = [], 0
    for path in files:
        reader = RecordingReader(path)
        drains += sum(1 for _ in reader) - 1
        reader.check()
        offsets.append(offset_of(reader.header))
        stamp = datetime.strptime(path.name.split("-")[2], "%Y%m%dT%H%M%SZ.qrec")
        assert abs((stamp - datetime.fromisoformat(reader.header.started_utc).replace(tzinfo=None)).total_seconds()) < 1
    assert offsets == sorted(offsets, reverse=step_s < 0)
    # To the microsecond, as a header has it.
    assert {round((offset - BEGIN_NS) / NS_PER_S, 4) for offset in offsets} == {0.0, step_s}
    assert bed.service.recorder is not None
    stats = bed.service.recorder.stats()
    assert (stats.missed, stats.unwritten, stats.deleted) == (0, 0, 0)
    assert drains == stats.written


@pytest.mark.parametrize("step_s", [HOUR_S, -YEARS_S])
def test_an_mcap_recording_begins_anew_with_the_right_time(step_s: float, tmp_path: Path) -> None:
    mcap = pytest.importorskip("mcap.reader", reason="mcap is not installed: pip install mcap")
    recording = RecordingSettings(directory=str(tmp_path), format="mcap", keep_free_mb=0.0)
    bed = bed_with(msgspec.structs.replace(PLAIN, recording=recording), step_s)
    bed.run(until_s=END_S)
    offsets = []
    for path in sorted(tmp_path.iterdir()):
        with path.open("rb") as file:
            (about,) = [one.metadata for one in mcap.make_reader(file).iter_metadata() if one.name == "quavelet"]
            offsets.append(int(about["offset_ns"]))
    assert offsets == [BEGIN_NS, BEGIN_NS + step_s * NS_PER_S]


def drained(bed: Bed) -> None:
    """Until the recorder's thread, which runs in real time, has what was read."""
    recorder = bed.service.recorder
    assert recorder is not None
    before = -1
    while before != (before := recorder.stats().written):
        assert not eventually(lambda: False, within_s=0.1)


@pytest.mark.parametrize("step_s", STEPS_S)
def test_the_attitude_is_gone_on_from_after_a_restart_across_a_step(step_s: float, tmp_path: Path) -> None:
    """Set between the two, too: the age of what was kept is not of this clock."""
    settings = msgspec.structs.replace(PLAIN, bus=BusSettings(name="fake:bed"))
    environ = {"RUNTIME_DIRECTORY": str(tmp_path), "QUAVELET_BOOT_ID": BOOT}
    for start_s, offset_s in ((0.0, 0.0), (13.0, step_s)):
        clock = EventClock(start_s)
        wall = Wall(clock)
        wall.set_by(offset_s)
        bed = Bed(settings=settings, clock=clock, wall_ns=wall, environ=environ)
        bed.run(until_s=start_s + 11.0 if not start_s else start_s + 1.0)
    assert any("goes on from where it was" in line for line in bed.said), bed.said


def watched(asleep_ns: Callable[[], int] = int) -> tuple[EventClock, Wall, TimeOfDay, list[str]]:
    clock, said = EventClock(), list[str]()
    wall = Wall(clock)
    return clock, wall, TimeOfDay(wall, clock=clock, asleep_ns=asleep_ns, talk=said.append), said


def pass_s(clock: EventClock, time_of_day: TimeOfDay, seconds: float) -> None:
    for _ in range(round(10 * seconds)):
        clock.advance_ns(NS_PER_S // 10)
        time_of_day.look()


def test_a_clock_that_a_time_server_moves_gently_was_not_set() -> None:
    clock, wall, time_of_day, said = watched()
    for _ in range(3600):
        wall.set_by(0.0005)
        pass_s(clock, time_of_day, 1.0)
    assert (said, time_of_day.steps) == ([], 0)


def test_a_machine_that_was_suspended_was_not_set() -> None:
    asleep = [0]
    clock, wall, time_of_day, said = watched(lambda: asleep[0])
    pass_s(clock, time_of_day, 3.0)
    asleep[0] = HOUR_S * NS_PER_S
    wall.set_by(HOUR_S)
    pass_s(clock, time_of_day, 3.0)
    assert said == []


def test_two_programs_that_fight_over_the_clock_do_not_fill_the_journal() -> None:
    clock, wall, time_of_day, said = watched()
    for n in range(600):
        wall.set_by(5.0 if n % 2 else -5.0)
        pass_s(clock, time_of_day, 1.0)
    assert len(said) <= 11
