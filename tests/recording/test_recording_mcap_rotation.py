"""MCAP files that follow each other keep their bounds, and a power cut leaves all but the last chunk."""

from __future__ import annotations

import io
import os
import struct
import sys
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.exceptions import McapError
from mcap.reader import make_reader
from mcap.stream_reader import StreamReader
from recorded import INFO
from rotation_rig import SMALL, Rig, slow_drains

from quavelet.core.blocks import Flag
from quavelet.core.clock import VirtualClock
from quavelet.core.errors import RecordingError, SettingsError
from quavelet.core.units import NS_PER_MS, NS_PER_S
from quavelet.recording import mcap
from quavelet.recording.mcap import McapWriter, Sample
from quavelet.recording.mcap_recorder import RotatingMcap
from quavelet.recording.rotation import Bounds

BOUNDS = Bounds(file_bytes=100_000, file_ns=60 * NS_PER_S, total_bytes=300_000)
AXES = ("+x", "+y", "+z")
ALL_FLAGS = Flag.names(int(sum(Flag)))
LONG = -sys.float_info.min * 1.1
"""As many characters as a number has at most."""


def sample_at(t_ns: int, *, number: float = 0.123456789, flags: tuple[str, ...] = (), gap_ns: int = 0) -> Sample:
    return Sample(t_ns, (number,) * 4, (number,) * 3, (number,) * 3, (number,) * 3, flags, "relative", gap_ns)


def samples(n: int, *, first: int = 0, every_ns: int = 10 * NS_PER_MS) -> list[Sample]:
    """Whose numbers do not compress to nothing."""
    return [sample_at(k * every_ns, number=(k * 0.618034) % 1.0) for k in range(first, first + n)]


def recovered(content: bytes) -> list[int]:
    """The times of /imu/data in what is left of a file, as the library reads what has no end."""
    times, topics = [], {}
    try:
        for record in StreamReader(io.BytesIO(content), validate_crcs=True).records:
            if type(record).__name__ == "Channel":
                topics[record.id] = record.topic
            if type(record).__name__ == "Message" and topics[record.channel_id] == "/imu/data":
                times.append(record.log_time)
    except (McapError, struct.error, ValueError):
        pass
    return times


def times_of(path: Path) -> list[int]:
    """Those of a file that is whole, by its index."""
    with path.open("rb") as file:
        reader = make_reader(file, validate_crcs=True)
        return [message.log_time for _, _, message in reader.iter_messages(topics=["/imu/data"])]


class McapRig:
    def __init__(self, folder: Path, bounds: Bounds = BOUNDS, *, rate_hz: float = 100.0, fsync_s: float = 0.0) -> None:
        self.folder, self.told = folder, list[str]()
        self.recorder = RotatingMcap(
            folder,
            name="imu",
            bounds=bounds,
            axes=AXES,
            about={},
            clock=VirtualClock(),
            offset_ns=int,
            rate_hz=rate_hz,
            tell=self.told.append,
            fsync_s=fsync_s,
        )

    @property
    def files(self) -> list[Path]:
        return sorted(self.folder.glob("imu-*.mcap"))

    @property
    def total(self) -> int:
        return sum(path.stat().st_size for path in self.folder.iterdir())

    def write(self, *items: Sample) -> None:
        for item in items:
            self.recorder.write(item)


MakeMcapRig = Callable[..., McapRig]


@pytest.fixture
def make_rig(tmp_path: Path) -> Iterator[MakeMcapRig]:
    rigs: list[McapRig] = []

    def make(bounds: Bounds = BOUNDS, **how: float) -> McapRig:
        rigs.append(McapRig(tmp_path, bounds, **how))
        return rigs[-1]

    yield make
    for rig in rigs:
        rig.recorder.close()


@settings(max_examples=25, deadline=None)
@given(
    st.lists(
        st.tuples(st.integers(1, 60), st.integers(0, 2 * NS_PER_S), st.booleans(), st.sampled_from([0.1, LONG])),
        min_size=1,
        max_size=25,
    ),
    st.integers(40_000, 90_000),
    st.integers(2, 4),
    st.sampled_from([1.0, 100.0, 1000.0]),
)
def test_all_files_together_never_exceed_their_bound(
    tmp_path_factory: pytest.TempPathFactory,
    items: list[tuple[int, int, bool, float]],
    file_bytes: int,
    files: int,
    rate_hz: float,
) -> None:
    folder = tmp_path_factory.mktemp("bound")
    (folder / "imu-000007-20250101T000000Z.qrec").write_bytes(b"QREC? mine, though it is called so")
    mine = next(folder.iterdir())
    bounds = Bounds(file_bytes=file_bytes, file_ns=60 * NS_PER_S, total_bytes=files * file_bytes)
    rig = McapRig(folder, bounds, rate_hz=rate_hz)
    t_ns, written = 0, list[int]()
    for n, pause_ns, flagged, number in items:
        t_ns += pause_ns
        for k in range(n):
            t_ns += 10 * NS_PER_MS
            flags = tuple(ALL_FLAGS) if flagged and k % 2 else ()
            rig.write(sample_at(t_ns, number=number + k, flags=flags, gap_ns=pause_ns))
            written.append(t_ns)
            assert rig.total - mine.stat().st_size <= bounds.total_bytes
    rig.recorder.close()
    assert rig.told == []
    assert rig.recorder.stats().written == len(written)
    assert max(path.stat().st_size for path in rig.files) <= bounds.file_bytes
    kept = [time for path in rig.files for time in times_of(path)]
    assert kept == written[-len(kept) :], "the newest, and none between two files is lost"
    assert len(kept) == len(written) or rig.recorder.stats().deleted > 0
    assert mine.exists()


def test_a_file_is_filled_before_the_next_is_begun(make_rig: MakeMcapRig) -> None:
    rig = make_rig(replace(BOUNDS, file_ns=3600 * NS_PER_S))
    rig.write(*samples(6000))
    rig.recorder.close()
    assert rig.recorder.stats().files > 4
    sizes = [path.stat().st_size for path in rig.files]
    # What waits is counted as if it did not shrink, and the schemas stand in a file twice.
    assert min(sizes[:-1]) > 0.6 * BOUNDS.file_bytes


@pytest.mark.parametrize("rate_hz", [10.0, 100.0, 1000.0])
def test_what_a_kill_costs_is_a_second_whatever_the_rate(make_rig: MakeMcapRig, rate_hz: float) -> None:
    rig = make_rig(replace(BOUNDS, file_bytes=50_000_000, total_bytes=100_000_000), rate_hz=rate_hz)
    every_ns = round(NS_PER_S / rate_hz)
    for k in range(round(5 * rate_hz)):
        rig.write(*samples(1, first=k, every_ns=every_ns))
        # What another sees of it is what a kill would leave.
        there = recovered(rig.files[0].read_bytes()) if k % max(1, round(rate_hz / 10)) == 0 else None
        if there is not None and k * every_ns > 2 * NS_PER_S:
            assert k * every_ns - there[-1] < 1.5 * NS_PER_S
            assert there == list(range(0, there[-1] + 1, every_ns))


def test_a_file_cut_at_any_byte_gives_all_but_the_chunk_that_the_cut_is_in(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    ends = {0: 0}
    with McapWriter(path, offset_ns=0, axes=AXES, about={}, chunk_bytes=8000) as writer:
        for k, sample in enumerate(samples(100)):
            writer.write(sample)
            if path.stat().st_size != max(ends):
                # The last one may have its attitude in the chunk and its rates in the next.
                ends[path.stat().st_size] = k
    whole = path.read_bytes()
    assert len(ends) > 8
    for n in range(0, len(whole), 37):
        at_least = max(known for end, known in ends.items() if end <= n)
        got = recovered(whole[:n])
        assert at_least <= len(got) <= 100
        assert got == [k * 10 * NS_PER_MS for k in range(len(got))]
    assert len(recovered(whole)) == 100


def test_the_power_goes_and_what_was_synced_is_read(make_rig: MakeMcapRig, monkeypatch: pytest.MonkeyPatch) -> None:
    rig = make_rig(replace(BOUNDS, file_bytes=5_000_000, total_bytes=10_000_000), fsync_s=2.0)
    on_disk: dict[str, int] = {}
    real = os.fsync

    def counting(descriptor: int) -> None:
        real(descriptor)
        on_disk[str(Path(f"/proc/self/fd/{descriptor}").readlink())] = os.fstat(descriptor).st_size

    monkeypatch.setattr(os, "fsync", counting)
    for k, sample in enumerate(samples(1000)):
        rig.write(sample)
        if k == 0:
            assert str(rig.folder) in on_disk, "its name is on the disk before its first sample"
        (path,) = rig.files
        if k > 500 and k % 50 == 0:
            left = recovered(path.read_bytes()[: on_disk[str(path)]])
            assert sample.t_ns - left[-1] < 4.5 * NS_PER_S
            assert left == [j * 10 * NS_PER_MS for j in range(len(left))]


def test_the_bound_holds_over_both_formats(make_rig: MakeMcapRig, tmp_path: Path) -> None:
    before = Rig(tmp_path, replace(SMALL, total_bytes=BOUNDS.total_bytes))
    before.write(INFO, *slow_drains(400))
    before.close()
    oldest = before.files[0]
    rig = make_rig()
    for sample in samples(4000):
        rig.write(sample)
        assert rig.total <= BOUNDS.total_bytes
    assert not oldest.exists()
    assert int(rig.files[0].name.split("-")[1]) > int(oldest.name.split("-")[1])


def test_a_file_that_another_program_is_writing_is_not_deleted(make_rig: MakeMcapRig) -> None:
    other = make_rig()
    other.write(*samples(300))
    (theirs,) = other.files
    rig = make_rig()
    rig.write(*samples(8000))
    assert theirs.exists()
    assert rig.recorder.stats().deleted > 0


def test_a_directory_that_is_not_there_is_told_once_and_tried_each_minute(tmp_path: Path) -> None:
    rig = McapRig(tmp_path / "stick", replace(BOUNDS, total_bytes=10**7))
    rig.write(*samples(150, every_ns=NS_PER_S))
    assert len(rig.told) == 1 and "make it, or mount its disk" in rig.told[0]
    rig.folder.mkdir()
    rig.write(*samples(150, first=150, every_ns=NS_PER_S))
    rig.recorder.close()
    stats = rig.recorder.stats()
    assert (stats.unwritten, stats.written, stats.stopped) == (180, 120, "")
    assert "180 messages in all could not be recorded" in rig.told[1]


def test_a_file_taken_away_while_it_is_written_is_said(make_rig: MakeMcapRig) -> None:
    rig = make_rig()
    rig.write(*samples(150))
    rig.files[0].unlink()
    rig.write(*samples(300, first=150))
    assert "was deleted while it was written" in rig.told[0]
    assert rig.recorder.stats().unwritten > 100


def test_a_writer_that_failed_is_closed_and_says_so(tmp_path: Path) -> None:
    writer = McapWriter(tmp_path / "a.mcap", offset_ns=0, axes=AXES, about={})
    writer.close()
    writer.close()
    with pytest.raises(RecordingError, match="is closed"):
        writer.write(sample_at(0))


def test_without_the_package_it_is_said_before_anything_is_begun(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setitem(sys.modules, "mcap.writer", None)
    with pytest.raises(SettingsError, match=r"pip install 'quavelet\[mcap\]'"):
        McapRig(tmp_path)
    assert mcap.SUFFIX == ".mcap"
