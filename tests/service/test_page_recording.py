"""A recording begun and ended from the page while the service runs, and the list of what can be downloaded."""

from __future__ import annotations

import os
import threading
from collections.abc import Callable
from pathlib import Path
from time import monotonic, sleep

import msgspec
import pytest
from service_bed import Bed

from hw_fakes import Tilt
from quavelet.core.errors import ImuError
from quavelet.core.health import Health
from quavelet.core.units import NS_PER_S
from quavelet.mpu6050.drain import Drain
from quavelet.pipeline import build_pipeline
from quavelet.recording import writer as writing
from quavelet.recording.reader import RecordingReader
from quavelet.recording.replay import ReplaySource
from quavelet.service import service
from quavelet.service.page_recording import MOST_LISTED, RecordAbility, RecordState, directory_of
from quavelet.settings import BusSettings, RecordingSettings, Settings
from quavelet.settings.web import WebSettings
from quavelet.web.ability import Ability, HasFiles

BOUND_S = 20.0
PAGE = Settings(bus=BusSettings(name="fake:bed"), web=WebSettings(listen="127.0.0.1:0"))
pytest.importorskip("aiohttp")


def recording_into(place: Path | str, **recording) -> Settings:
    web = WebSettings(listen="127.0.0.1:0", recordings=str(place))
    return msgspec.structs.replace(PAGE, web=web, recording=RecordingSettings(**recording))


def bed_of(settings: Settings, environ: dict[str, str] | None = None) -> tuple[Bed, RecordAbility]:
    bed = Bed(Tilt(), settings=settings, environ=environ)
    (ability,) = (ability for ability in bed.service.abilities if isinstance(ability, RecordAbility))
    return bed, ability


def await_that(true: Callable[[], bool]) -> None:
    """Only for the thread that writes: the service's clock stands meanwhile."""
    end_s = monotonic() + BOUND_S
    while not true() and monotonic() < end_s:
        sleep(0.005)
    assert true()


def drains_of(path: Path) -> list[Drain]:
    reader = RecordingReader(path)
    drains = [item for item in reader if isinstance(item, Drain)]
    assert reader.damage.records == 0
    return drains


def refused(step: Callable[[], object]) -> str:
    with pytest.raises((ImuError, ValueError)) as error:
        step()
    return str(error.value)


def test_a_recording_that_begins_in_mid_stream_is_whole_and_replays_to_what_was_said(tmp_path: Path) -> None:
    bed, record = bed_of(recording_into(tmp_path))
    answers: list[str] = []
    bed.clock.at(5.0, lambda: answers.append(record.do("start", {})))
    bed.clock.at(12.0, lambda: answers.append(record.do("stop", {})))
    bed.run(until_s=14.0)
    assert answers == [f"recording into {tmp_path}", "the recording is ended"]
    (file,) = record.state().files
    assert file.ended and file.bytes == (tmp_path / file.name).stat().st_size
    drains = drains_of(tmp_path / file.name)
    assert drains[0].seq > 400
    assert 5.0 <= drains[0].after_ns / NS_PER_S < 5.1 and 11.9 < drains[-1].after_ns / NS_PER_S <= 12.0
    assert [drain.seq for drain in drains] == list(range(drains[0].seq, drains[-1].seq + 1))
    replayed, health = RecordingReader(tmp_path / file.name), Health()
    source, pipeline = ReplaySource(replayed, health=health), build_pipeline(PAGE)
    blocks = []
    while (raw := source.read()) is not None:
        blocks.append(pipeline.process(raw))
    assert sum(map(len, blocks)) == pytest.approx(7.0 * 200, abs=10)
    last = next(block for block in reversed(blocks) if len(block))
    # The chip's clock is measured anew from 5 s on, so the times agree within a part of a sample.
    live = min(bed.messages, key=lambda m: abs(m.t_ns - int(last.t_ns[-1])))
    assert abs(live.t_ns - int(last.t_ns[-1])) < 2_000_000
    assert live.accel_m_s2 == pytest.approx(last.accel_m_s2[-1], abs=1e-5)


def test_it_is_seen_how_far_it_is_and_what_is_written_so_far_can_be_read(tmp_path: Path) -> None:
    bed, record = bed_of(recording_into(tmp_path))
    seen: list[RecordState] = []
    read: list[int] = []

    def look() -> None:
        # The thread that writes takes its time, which the clock of the service does not know of.
        await_that(lambda: len(names(record)) > 0)
        (name,) = names(record)
        path = record.open_file(name)
        assert path == tmp_path / name
        await_that(lambda: path.stat().st_size > 5000)
        record.open_file(name)
        seen.append(record.state())
        (copy := tmp_path / "download").write_bytes(path.read_bytes())
        read.append(len([item for item in RecordingReader(copy) if isinstance(item, Drain)]))
        copy.unlink()

    bed.clock.at(4.9, lambda: seen.append(record.state()))
    bed.clock.at(5.0, lambda: record.do("start", {}))
    bed.clock.at(9.0, look)
    bed.clock.at(9.1, lambda: read.append(refused_delete(record)))
    bed.run(until_s=10.0)
    before, during = seen
    assert (before.recording, before.since_ns, before.file, before.files, before.why) == (False, None, "", [], "")
    assert during.recording and during.since_ns == pytest.approx(5.0 * NS_PER_S, abs=1e7)
    assert during.file == during.files[0].name and during.bytes == during.files[0].bytes > 5000
    assert not during.files[0].ended
    assert read[0] > 50
    # The program ended while it recorded: the file is whole, and ended.
    assert drains_of(tmp_path / during.file)[-1].after_ns > 9.9 * NS_PER_S
    record.open_file("")
    assert record.state().files[0].ended


def names(record: RecordAbility) -> list[str]:
    record.open_file("")
    return [file.name for file in record.state().files]


def refused_delete(record: RecordAbility) -> int:
    assert "being written" in refused(lambda: record.do("delete", {"name": names(record)[0]}))
    return len(names(record))


def test_start_and_stop_and_start_again_makes_two_files_and_an_ended_one_can_be_deleted(tmp_path: Path) -> None:
    bed, record = bed_of(recording_into(tmp_path))
    said: list[str] = []

    def start_again() -> None:
        said.append(refused(lambda: record.do("stop", {})))
        await_that(lambda: record._before is not None and record._before.closed)
        record.do("start", {})
        said.append(refused(lambda: record.do("start", {})))

    bed.clock.at(4.0, lambda: record.do("start", {}))
    bed.clock.at(5.0, lambda: record.do("stop", {}))
    bed.clock.at(6.0, start_again)
    bed.run(until_s=7.0)
    assert "nothing is being recorded" in said[0] and "goes on already" in said[1]
    second, first = names(record)
    assert first < second
    assert record.do("delete", {"name": first}) == f"{first} is deleted"
    assert names(record) == [second] and drains_of(tmp_path / second)


def test_where_everything_is_recorded_there_is_nothing_to_start_and_the_files_are_listed(tmp_path: Path) -> None:
    settings = msgspec.structs.replace(PAGE, recording=RecordingSettings(directory=str(tmp_path)))
    bed, record = bed_of(settings)
    said: list[str] = []
    bed.clock.at(4.0, lambda: said.append(refused(lambda: record.do("start", {}))))
    bed.clock.at(5.0, lambda: said.append(refused(lambda: record.do("stop", {}))))
    seen: list[RecordState] = []

    def look() -> None:
        await_that(lambda: len(names(record)) > 0)
        seen.append(record.state())

    bed.clock.at(6.0, look)
    bed.run(until_s=8.0)
    assert all("records all the time" in text for text in said) and len(said) == 2
    assert seen[0].recording and "records all the time" in seen[0].why
    assert seen[0].file == seen[0].files[0].name and not seen[0].files[0].ended
    assert drains_of(tmp_path / names(record)[0])


STRANGE: list[object] = [
    "../secret", "/etc/passwd", "", ".", "..", "imu-000009-20260101T000000Z.qrec", "link", "a/../b", "imu\0",
    "imu-000002-20260101T000000Z.qrec", "imu-000003-20260101T000000Z.qrec", "notes.txt",
    "other-000001-20260101T000000Z.qrec", "./imu-000001-20260101T000000Z.qrec", None, 7, ["x"], {"name": "x"},
]  # fmt: skip


@pytest.mark.parametrize("name", STRANGE, ids=repr)
def test_nothing_but_what_is_in_the_list_can_be_had_or_deleted(tmp_path: Path, name: object) -> None:
    (tmp_path / "secret").write_text("mine")
    (folder := tmp_path / "recordings").mkdir()
    good = folder / "imu-000001-20260101T000000Z.qrec"
    good.write_bytes(writing.MAGIC)
    (folder / "imu-000002-20260101T000000Z.qrec").symlink_to(tmp_path / "secret")
    os.mkfifo(folder / "imu-000003-20260101T000000Z.qrec")
    (folder / "notes.txt").write_text("mine")
    (folder / "other-000001-20260101T000000Z.qrec").write_bytes(writing.MAGIC)
    _, record = bed_of(recording_into(folder))
    before = sorted(path.name for path in folder.iterdir())
    assert names(record) == [good.name] and record.open_file(good.name) == good
    if isinstance(name, str):
        assert record.open_file(name) is None
    assert "no recording of that name" in refused(lambda: record.do("delete", {"name": name}))
    assert sorted(path.name for path in folder.iterdir()) == before


def test_a_file_that_only_has_the_name_of_a_recording_is_not_deleted(tmp_path: Path) -> None:
    (tmp_path / (name := "imu-000001-20260101T000000Z.qrec")).write_text("the only copy of my thesis")
    _, record = bed_of(recording_into(tmp_path))
    assert "no recording" in refused(lambda: record.do("delete", {"name": name}))
    assert (tmp_path / name).exists()


def test_a_directory_that_is_missing_or_closed_is_told_in_a_sentence(tmp_path: Path, monkeypatch) -> None:
    bed, record = bed_of(recording_into(tmp_path / "gone"))
    said: list[str] = []
    bed.clock.at(4.0, lambda: said.append(refused(lambda: record.do("start", {}))))
    bed.run(until_s=5.0)
    assert said == [f"there is no directory {tmp_path / 'gone'}: make it, or mount its disk"]
    assert not record.state().recording and len(bed.messages) > 400
    # Whoever runs the tests may be root, who may write anywhere.
    monkeypatch.setattr(os, "access", lambda *_: False)
    _, closed = bed_of(recording_into(tmp_path))
    assert "cannot be written to" in refused(lambda: closed.do("start", {}))
    (tmp_path / "file").write_text("")
    _, blocked = bed_of(PAGE, {"STATE_DIRECTORY": str(tmp_path / "file")})
    assert "cannot be made" in refused(lambda: blocked.do("start", {}))
    _, nowhere = bed_of(recording_into(""))
    assert "no place" in refused(lambda: nowhere.do("start", {}))
    assert "names no place" in nowhere.state().why


def test_a_disk_that_fills_up_is_told_and_the_loop_goes_on(tmp_path: Path) -> None:
    # No disk has so much left.
    bed, record = bed_of(recording_into(tmp_path, keep_free_mb=1e8))
    seen: list[RecordState] = []

    def look() -> None:
        await_that(lambda: record.state().why != "")
        seen.append(record.state())

    bed.clock.at(4.0, lambda: record.do("start", {}))
    bed.clock.at(6.0, look)
    bed.run(until_s=8.0)
    assert seen[0].recording and "tried again each minute" in seen[0].why and "keep_free_mb" in seen[0].why
    assert any("recording stopped" in line and "make room" in line for line in bed.said)
    assert bed.messages[-1].t_ns > 7.9 * NS_PER_S
    assert names(record) == []


def test_a_file_is_only_so_large_and_another_follows(tmp_path: Path) -> None:
    bed, record = bed_of(recording_into(tmp_path, file_mb=0.1, total_mb=0.2))
    bed.clock.at(4.0, lambda: record.do("start", {}))
    bed.run(until_s=60.0)
    state = record.state()
    assert 1 <= len(names(record)) <= 3
    assert sum(file.bytes for file in record.state().files) <= 200_000 and state.why == ""
    assert int(names(record)[0].split("-")[1]) >= 3


@pytest.mark.parametrize(
    ("settings", "environ", "place"),
    [
        (PAGE, {"STATE_DIRECTORY": "/var/lib/quavelet:/x", "HOME": "/h"}, "/var/lib/quavelet/recordings"),
        (PAGE, {"HOME": "/h"}, "/h/.local/state/quavelet/recordings"),
        (PAGE, {}, None),
        (recording_into("/data"), {"HOME": "/h"}, "/data"),
        (recording_into(""), {"HOME": "/h"}, None),
        (recording_into("/data", directory="/all"), {"HOME": "/h"}, "/all"),
    ],
)
def test_where_recordings_go(settings: Settings, environ: dict[str, str], place: str | None) -> None:
    assert directory_of(settings, environ=environ) == (Path(place) if place else None)


def test_the_place_by_default_is_made(tmp_path: Path) -> None:
    bed, record = bed_of(PAGE, {"STATE_DIRECTORY": str(tmp_path)})
    assert record.about() == {"directory": str(tmp_path / "recordings")}
    assert record.state().files == []
    bed.clock.at(4.0, lambda: record.do("start", {}))
    bed.run(until_s=5.0)
    assert len(list((tmp_path / "recordings").iterdir())) == 1


def test_many_files_are_listed_newest_first_and_in_bounds(tmp_path: Path) -> None:
    for number in range(1, MOST_LISTED + 51):
        (tmp_path / f"imu-{number:06d}-20260101T000000Z.qrec").write_bytes(writing.MAGIC)
    _, record = bed_of(recording_into(tmp_path))
    listed = names(record)
    assert len(listed) == MOST_LISTED and listed[0].startswith("imu-000150")
    assert record.open_file("imu-000001-20260101T000000Z.qrec") is not None
    assert len(msgspec.json.encode(record.state())) < 12_000


def test_the_recordings_thread_is_kept_running_as_the_others_are(tmp_path: Path, monkeypatch) -> None:
    bed, record = bed_of(recording_into(tmp_path))
    raised: list[list[str]] = []
    # No test may ask for real-time priority.
    monkeypatch.setattr(
        service, "keep_others_running", lambda: raised.append([thread.name for thread in threading.enumerate()])
    )
    bed.service._is_punctual = True
    bed.clock.at(4.0, lambda: record.do("start", {}))
    bed.run(until_s=5.0)
    (names_then,) = raised
    assert "sink page recording" in names_then


def test_the_page_has_these_abilities_and_a_service_without_a_page_has_none() -> None:
    bed, record = bed_of(PAGE)
    assert [ability.name for ability in bed.service.abilities] == ["zero", "record", "mounting"]
    as_ability: Ability = record
    assert isinstance(as_ability, HasFiles)
    assert all(msgspec.json.encode([a.about(), a.state()]) for a in bed.service.abilities)
    assert Bed(settings=Settings(bus=BusSettings(name="fake:bed"))).service.abilities == []
    assert "deleted by" in refused(lambda: record.do("format c:", {}))
