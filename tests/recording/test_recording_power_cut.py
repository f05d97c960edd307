"""The power goes, or the process is killed, in the middle of a write: all but the last block can be read."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from recorded import INFO, SETTINGS, Live, assert_identical, drains, record_fake

from quavelet.core.errors import RecordingError
from quavelet.core.health import Health
from quavelet.core.units import NS_PER_S
from quavelet.mpu6050.drain import Drain
from quavelet.recording.format import drain_bytes
from quavelet.recording.reader import RecordingReader
from quavelet.recording.replay import ReplaySource
from quavelet.recording.writer import END_BYTES, RecordingWriter

SECTOR = 512


@pytest.fixture(scope="module")
def live(tmp_path_factory: pytest.TempPathFactory) -> Live:
    return record_fake(tmp_path_factory.mktemp("live") / "a.qrec", n=400)


@pytest.fixture(scope="module")
def scratch(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("cut") / "a.qrec"


def recorded_drains(live: Live) -> list[Drain]:
    return [item for item in live.items if isinstance(item, Drain)]


def test_a_real_file_cut_at_any_byte_of_its_last_blocks_gives_all_that_was_before(live: Live, scratch: Path) -> None:
    whole, written = live.path.read_bytes(), recorded_drains(live)
    ends = [len(whole) - END_BYTES]
    for drain in written[:-5:-1]:
        ends.append(ends[-1] - drain_bytes(drain))
    for n in range(ends[-1], len(whole)):
        scratch.write_bytes(whole[:n])
        reader = RecordingReader(scratch)
        got = [item for item in reader if isinstance(item, Drain)]
        there = len(written) - sum(n < end for end in ends)
        assert got == written[:there], f"cut at {n}"
        with pytest.raises(RecordingError, match=r"at byte \d+, what came after 20\d\d-.* is missing: all that could"):
            reader.check()


def test_a_cut_recording_replays_to_the_blocks_that_were_seen_live(live: Live, scratch: Path) -> None:
    whole = live.path.read_bytes()
    scratch.write_bytes(whole[: len(whole) - END_BYTES - 7])
    health = Health()
    source = ReplaySource(RecordingReader(scratch), health=health)
    for block in live.blocks[:-1]:
        got = source.read()
        assert got is not None
        assert_identical(got, block)
    assert source.read() is None


@pytest.mark.parametrize("filling", [b"\0", b"\xff", b"\xc7Q\xf2r"], ids=["zeros", "ones", "markers"])
def test_blocks_of_the_disk_that_were_never_written_cost_only_what_stood_in_them(
    live: Live, scratch: Path, filling: bytes
) -> None:
    # A file system may know the file's length, and later blocks, before what belongs into one.
    whole, written = live.path.read_bytes(), recorded_drains(live)
    for first in range(len(whole) // SECTOR - 20, len(whole) // SECTOR):
        begin = first * SECTOR
        scratch.write_bytes(whole[:begin] + (filling * SECTOR)[:SECTOR] + whole[begin + SECTOR :])
        reader = RecordingReader(scratch)
        got = [item for item in reader if isinstance(item, Drain)]
        position, touched = len(whole) - END_BYTES, 0
        for drain in reversed(written):
            end, position = position, position - drain_bytes(drain)
            touched += begin < end and position < begin + SECTOR
        assert [d for d in written if d in got] == got
        assert len(got) == len(written) - touched, f"sector {first}"
        assert reader.damage.found
        assert reader.damage.drains_lost in (touched, 0)


def test_the_disk_is_waited_for_as_often_as_asked(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path, synced, waited = tmp_path / "a.qrec", [0], [0]
    real = os.fsync

    def fsync(fd: int) -> None:
        real(fd)
        if Path(f"/proc/self/fd/{fd}").readlink() == path:
            synced[0] = path.stat().st_size
        waited[0] += 1

    monkeypatch.setattr(os, "fsync", fsync)
    writer = RecordingWriter(path, settings=SETTINGS, fsync_s=5.0)
    writer.begin(INFO)
    header = synced[0]
    assert header > 1000, "without its header nothing in the file could be read"
    written = drains(3000)
    for drain in written:
        writer.write(drain)
        on_disk = (synced[0] - header) // drain_bytes(drain)
        oldest = written[min(on_disk, drain.seq)]
        assert drain.after_ns - oldest.after_ns <= 6 * NS_PER_S
    writer.close()
    assert waited[0] <= 2 + 30 // 5 + 2
    assert synced[0] == path.stat().st_size


KILLED = """
import sys
from pathlib import Path
sys.path[:0] = sys.argv[2:]
from recorded import drains
from test_recording_rotation import INFO, Rig
from quavelet.recording.rotation import Bounds
rig = Rig(Path(sys.argv[1]), Bounds(file_bytes=60_000, file_ns=3600 * 10**9, total_bytes=400_000))
rig.write(INFO)
print("begun", flush=True)
for first in range(0, 10**9, 1000):
    rig.write(*drains(1000, first=first))
"""


def test_a_writer_killed_again_and_again_leaves_its_bound_and_whole_files(tmp_path: Path) -> None:
    here = Path(__file__).resolve()
    argv = [sys.executable, "-c", KILLED, str(tmp_path), str(here.parents[2] / "src"), str(here.parents[2])]
    cut = 0
    for attempt in range(4):
        with subprocess.Popen([*argv, str(here.parent)], stdout=subprocess.PIPE) as writer:
            assert writer.stdout is not None
            assert writer.stdout.readline() == b"begun\n"
            time.sleep(0.05 + 0.02 * attempt)
            writer.kill()
        assert writer.returncode == -signal.SIGKILL
        files = sorted(tmp_path.iterdir())
        assert sum(path.stat().st_size for path in files) <= 400_000
        for path in files:
            try:
                reader = RecordingReader(path)
            except RecordingError:
                assert path.stat().st_size < 5000, "killed before its header was written"
                cut += 1
                continue
            info, *got = reader
            assert info == INFO
            first = got[0].seq if got and isinstance(got[0], Drain) else 0
            assert got == drains(len(got), first=first)
            assert not reader.damage.places
            cut += reader.damage.truncated
    assert 1 <= cut <= 4 + 3 + 2 + 1
