"""Recordings that follow each other keep their bounds, each is complete, and nothing of others is touched."""

import fcntl
import gc
import os
import shutil
import time
import tracemalloc
from collections.abc import Callable, Iterator
from dataclasses import replace
from datetime import datetime, timedelta
from pathlib import Path
from threading import Event

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from recorded import INFO, record_fake
from rotation_rig import NOON, OTHERS, SMALL, WIDE, MakeRig, Rig, drains_in, slow_drains

from quavelet.core.blocks import Flag
from quavelet.core.health import Health
from quavelet.core.units import NS_PER_S
from quavelet.loop.hub import Hub
from quavelet.mpu6050.drain import Drain
from quavelet.mpu6050.stream import StreamInfo
from quavelet.recording.format import MAGIC
from quavelet.recording.reader import RecordingReader
from quavelet.recording.replay import ReplaySource
from quavelet.recording.rotation import Bounds
from quavelet.recording.writer import FLUSH_NS


@pytest.fixture
def make_rig(tmp_path: Path) -> Iterator[MakeRig]:
    rigs: list[Rig] = []

    def make(bounds: Bounds = SMALL, *, folder: Path = tmp_path, fsync_s: float = 0.0) -> Rig:
        rigs.append(Rig(folder, bounds, fsync_s=fsync_s))
        return rigs[-1]

    yield make
    for rig in rigs:
        rig.close()


@pytest.fixture
def rig(make_rig: MakeRig) -> Rig:
    return make_rig()


def test_each_file_is_complete_by_itself_and_none_of_the_drains_between_two_is_lost(make_rig: MakeRig) -> None:
    rig = make_rig(replace(SMALL, total_bytes=10_000_000))
    rig.recorder.calibration = lambda: "calibration of this board"
    written = slow_drains(200)
    rig.write(INFO, *written)
    rig.close()
    assert len(rig.files) > 3
    assert drains_in(rig.files) == written
    for path in rig.files:
        assert path.stat().st_size <= SMALL.file_bytes
        assert RecordingReader(path).header.calibration == "calibration of this board"
    assert rig.told == []


def test_names_sort_by_age_though_the_clock_was_stepped_back(rig: Rig) -> None:
    every = slow_drains(150)
    rig.write(INFO)
    for drain in every:
        rig.write(drain)
        rig.utc += timedelta(days=-1 if drain.seq % 2 else 3)
    rig.close()
    kept = drains_in(rig.files)
    assert kept == every[-len(kept) :]
    assert rig.recorder.stats().deleted > 0


@pytest.mark.parametrize("step", [timedelta(hours=1), timedelta(hours=-1), timedelta(days=7305), timedelta(days=-7305)])
def test_a_step_of_utc_begins_a_file_of_its_own_deletes_the_oldest_alone_and_overwrites_none(
    rig: Rig, step: timedelta
) -> None:
    """A header has one instant by both clocks, and all of a file's times are told by it."""
    every = slow_drains(90)
    rig.write(INFO, *every[:50])
    before = rig.files
    rig.utc += step
    rig.write(*every[50:])
    rig.close()
    kept = drains_in(rig.files)
    assert kept == every[-len(kept) :]
    assert rig.recorder.stats().deleted > 0
    ((first, *_),) = [[path for path in rig.files if path not in before]]
    assert drains_in([first])[0] == every[50]
    for path in rig.files:
        began = datetime.fromisoformat(RecordingReader(path).header.started_utc)
        assert began == (NOON if path in before else NOON + step)


def test_a_clock_that_two_programs_fight_over_makes_no_more_than_a_file_a_minute(make_rig: MakeRig) -> None:
    rig = make_rig(WIDE)
    rig.write(INFO)
    for drain in slow_drains(300):
        rig.utc += timedelta(seconds=5 if drain.seq % 2 else -5)
        rig.write(drain)
    assert len(rig.files) <= 300 // 60 + 10


def test_a_new_start_goes_on_with_the_numbers_and_deletes_what_the_one_before_left(make_rig: MakeRig) -> None:
    first = make_rig()
    first.write(INFO, *slow_drains(60))
    first.close()
    before = first.files
    second = make_rig()
    second.utc -= timedelta(days=365)
    second.write(INFO, *slow_drains(30))
    assert second.files[-1].name > before[-1].name
    assert before[0] not in second.files
    assert before[-1] in second.files


def test_a_file_is_no_longer_than_its_time(make_rig: MakeRig) -> None:
    rig = make_rig(Bounds(file_bytes=10**9, file_ns=60 * NS_PER_S, total_bytes=10**9))
    rig.write(INFO, *slow_drains(180))
    rig.close()
    assert [len(drains_in([path])) for path in rig.files] == [60, 60, 60]


@pytest.mark.parametrize("step_s", [-10_000, 10_000])
def test_a_step_of_the_drains_clock_stops_nothing(make_rig: MakeRig, step_s: int) -> None:
    rig = make_rig(Bounds(file_bytes=10**9, file_ns=60 * NS_PER_S, total_bytes=10**9))
    step_ns = step_s * NS_PER_S
    rest = [
        replace(d, before_ns=d.before_ns + step_ns, after_ns=d.after_ns + step_ns) for d in slow_drains(90, first=90)
    ]
    rig.write(INFO, *slow_drains(90), *rest)
    rig.close()
    assert [d.seq for d in drains_in(rig.files)] == list(range(180))
    assert max(len(drains_in([path])) for path in rig.files) <= 60 + 30


@settings(max_examples=60, deadline=None)
@given(
    st.lists(
        st.tuples(st.integers(0, 3000), st.integers(0, 3 * FLUSH_NS), st.booleans(), st.integers(0, 30)),
        min_size=1,
        max_size=150,
    ),
    st.integers(8_000, 20_000),
    st.integers(2, 5),
)
def test_all_files_together_never_exceed_their_bound(
    tmp_path_factory: pytest.TempPathFactory, items: list[tuple[int, int, bool, int]], file_bytes: int, files: int
) -> None:
    folder = tmp_path_factory.mktemp("bound")
    for name, content in OTHERS.items():
        (folder / name).write_bytes(content)
    bounds = Bounds(file_bytes=file_bytes, file_ns=30 * NS_PER_S, total_bytes=files * file_bytes)
    rig = Rig(folder, bounds)
    rig.write(INFO)
    t_ns = seq = 0
    for size, dt_ns, stalled, restart in items:
        if not restart:
            rig.write(INFO)
            seq = 0
        t_ns += dt_ns
        seq += 1 + stalled
        before = set(rig.files)
        rig.write(Drain(seq, t_ns, t_ns, 0, 0, bytes(size)))
        assert rig.total <= bounds.total_bytes
        gone = before - set(rig.files)
        assert all(path < min(rig.files) for path in gone), "the oldest go first"
    rig.close()
    assert rig.total <= bounds.total_bytes
    assert rig.told == []
    stats = rig.recorder.stats()
    assert stats.written == len(items)
    assert stats.used_bytes >= rig.total
    assert {name: (folder / name).read_bytes() for name in OTHERS} == OTHERS
    for path in rig.files:
        RecordingReader(path).check()
    shutil.rmtree(folder)


def test_what_is_not_ours_is_neither_counted_nor_deleted(make_rig: MakeRig, tmp_path: Path) -> None:
    for name, content in OTHERS.items():
        (tmp_path / name).write_bytes(content)
    elsewhere = tmp_path / "elsewhere"
    elsewhere.write_bytes(MAGIC + bytes(100_000))
    (tmp_path / "imu-000002-20261122T120000Z.qrec").symlink_to(elsewhere)
    (tmp_path / "imu-000003-20261122T120000Z.qrec").mkdir()
    before = sorted(path.name for path in tmp_path.iterdir())
    rig = make_rig()
    rig.write(INFO, *slow_drains(200))
    rig.close()
    assert rig.recorder.stats().deleted > 3
    own = [path for path in rig.files if path.is_file() and not path.is_symlink()]
    assert rig.recorder.stats().used_bytes == sum(path.stat().st_size for path in own)
    assert rig.told == []
    assert set(before) <= {path.name for path in tmp_path.iterdir()}
    assert len(elsewhere.read_bytes()) == len(MAGIC) + 100_000


def test_a_file_that_was_replaced_meanwhile_is_not_deleted(rig: Rig) -> None:
    rig.write(INFO, *slow_drains(60))
    oldest = rig.files[0]
    oldest.write_bytes(b"mine")
    rig.write(*slow_drains(200, first=60))
    assert oldest.read_bytes() == b"mine"


@pytest.mark.parametrize("digits", [18, 100])
def test_a_number_however_high_is_gone_on_from(make_rig: MakeRig, tmp_path: Path, digits: int) -> None:
    high = tmp_path / f"imu-{'9' * digits}-20261122T110000Z.qrec"
    high.write_bytes(MAGIC + bytes(30_000))
    rig = make_rig()
    rig.write(INFO, *slow_drains(200))
    assert not high.exists(), "the oldest, though its name is longer"
    assert sum(path.stat().st_size for path in tmp_path.iterdir()) <= SMALL.total_bytes
    assert min(int(path.name.split("-")[1]) for path in tmp_path.iterdir()) > int("9" * digits)


def test_a_number_that_no_name_can_follow_stops_the_recording_and_says_so(make_rig: MakeRig, tmp_path: Path) -> None:
    room = 255 - len("imu--20261122T110000Z.qrec")
    (tmp_path / f"imu-{'9' * room}-20261122T110000Z.qrec").write_bytes(MAGIC)
    rig = make_rig()
    rig.write(INFO, *slow_drains(3))
    assert "cannot be written (File name too long)" in rig.told[0]


def test_a_file_that_another_program_is_writing_is_not_deleted(make_rig: MakeRig) -> None:
    other = make_rig()
    other.write(INFO, *slow_drains(20))
    (theirs,) = [other.files[-1]]
    rig = make_rig()
    rig.write(INFO, *slow_drains(300))
    assert theirs.exists()
    assert rig.total <= SMALL.total_bytes
    other.close()
    rig.write(*slow_drains(60, first=300))
    assert not theirs.exists()


def test_a_file_whose_first_line_never_reached_the_disk_is_ours_and_goes_as_the_oldest(
    make_rig: MakeRig, tmp_path: Path
) -> None:
    empty = tmp_path / "imu-000001-20261122T110000Z.qrec"
    empty.touch()
    rig = make_rig()
    rig.write(INFO, *slow_drains(100))
    assert not empty.exists()


def test_a_directory_that_is_not_there_is_told_once_and_tried_each_minute(make_rig: MakeRig, tmp_path: Path) -> None:
    rig = make_rig(WIDE, folder=tmp_path / "stick")
    rig.write(INFO, *slow_drains(150))
    assert len(rig.told) == 1
    assert "make it, or mount its disk" in rig.told[0]
    stats = rig.recorder.stats()
    assert (stats.written, stats.unwritten) == (0, 150)
    assert "mount" in stats.stopped
    rig.folder.mkdir()
    rig.write(*slow_drains(150, first=150))
    assert len(rig.told) == 2
    assert "recording again" in rig.told[1]
    stats = rig.recorder.stats()
    assert stats.stopped == ""
    assert stats.unwritten == 180, "tries are a minute apart"
    rig.close()
    assert [d.seq for d in drains_in(rig.files)] == list(range(180, 300))


@pytest.mark.parametrize("remove", [shutil.rmtree, lambda folder: next(folder.iterdir()).unlink()])
def test_what_is_removed_while_it_is_written_is_noticed_within_a_second(
    make_rig: MakeRig, tmp_path: Path, remove: Callable[[Path], None]
) -> None:
    rig = make_rig(WIDE, folder=tmp_path / "here")
    rig.folder.mkdir()
    rig.write(INFO, *slow_drains(3))
    remove(rig.folder)
    rig.write(*slow_drains(2, first=3))
    assert "was deleted while it was written" in rig.told[0]
    rig.folder.mkdir(exist_ok=True)
    rig.write(*slow_drains(130, first=5))
    rig.close()
    assert [drain.seq for drain in drains_in(rig.files)] == list(range(63, 135))
    assert len(rig.told) == 2


def test_a_stream_whose_beginning_the_queue_lost_is_asked_for(rig: Rig) -> None:
    wider = replace(INFO, gyro_config=0x18)
    rig.recorder.current_stream = lambda: wider
    rig.write(INFO, *slow_drains(3), *slow_drains(3))
    rig.close()
    assert [item for item in RecordingReader(rig.files[0]) if isinstance(item, StreamInfo)] == [INFO, wider]


def test_drains_of_a_stream_that_nobody_knows_are_not_recorded_as_of_another(rig: Rig) -> None:
    rig.write(INFO, *slow_drains(3), *slow_drains(3))
    assert rig.recorder.stats().unwritten == 3
    rig.close()
    assert len(drains_in(rig.files)) == 3


def test_a_card_that_is_busy_with_itself_costs_drains_that_are_counted_and_gaps_on_replay(
    make_rig: MakeRig, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    live = record_fake(tmp_path / "live.qrec", n=300)
    rig = make_rig(replace(WIDE, file_bytes=5_000_000), fsync_s=0.5)
    waits, busy, free = [0], Event(), Event()
    real = os.fsync

    def slow(fd: int) -> None:
        waits[0] += 1
        if waits[0] == 3:
            busy.set()
            assert free.wait(60)
        real(fd)

    monkeypatch.setattr(os, "fsync", slow)
    with Hub[StreamInfo | Drain]() as hub:
        hub.subscribe("recordings", rig.recorder, depth=40)
        for published, item in enumerate(live.items):
            if published == 250:
                free.set()
            # Before and after the wait the recorder keeps up.
            while not busy.is_set() or free.is_set():
                (stats,) = hub.stats()
                if stats.delivered + stats.lost > published - 20:
                    break
                time.sleep(0.001)
            hub.publish(item)
        free.set()
    lost = hub.stats()[0].lost
    assert rig.recorder.stats().missed == lost > 0
    (path,) = rig.files
    reader, health = RecordingReader(path), Health()
    source = ReplaySource(reader, health=health)
    flags = 0
    while (block := source.read()) is not None:
        flags |= int(np.bitwise_or.reduce(block.flags)) if len(block) else 0
    reader.check()
    assert flags & Flag.GAP
    assert health.gaps == 1
    assert health.samples + health.samples_lost == pytest.approx(live.health.samples, abs=2)


def test_drains_that_the_disk_was_too_slow_for_are_counted(rig: Rig) -> None:
    rig.write(INFO, *slow_drains(3), *slow_drains(3, first=10))
    assert rig.recorder.stats().missed == 7


def test_memory_does_not_grow_from_file_to_file(rig: Rig) -> None:
    rig.write(INFO)
    sizes = []
    tracemalloc.start()
    try:
        for part in range(4):
            for first in range(part * 1500, (part + 1) * 1500, 100):
                rig.write(*slow_drains(100, first=first))
            gc.collect()
            sizes.append(tracemalloc.get_traced_memory()[0])
    finally:
        tracemalloc.stop()
    assert rig.recorder.stats().deleted > 150
    assert sizes[-1] - sizes[1] < 10_000


def test_the_file_being_written_is_locked(rig: Rig) -> None:
    rig.write(INFO, *slow_drains(3))
    with rig.files[0].open("rb") as file, pytest.raises(BlockingIOError):
        fcntl.flock(file, fcntl.LOCK_SH | fcntl.LOCK_NB)
