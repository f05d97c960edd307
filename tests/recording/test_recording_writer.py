"""A recording that cannot be written says so in time, and keeps what was written."""

import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from full_disk import files_up_to
from recorded import INFO, SETTINGS, drains, record

from quavelet.core.errors import RecordingError
from quavelet.loop.hub import Hub, Policy
from quavelet.mpu6050.drain import Drain
from quavelet.mpu6050.stream import StreamInfo
from quavelet.recording.reader import RecordingReader
from quavelet.recording.writer import RecordingWriter

NOBODY = 65534


SMALL_BYTES = 20_000


@pytest.fixture
def folder_of_another(tmp_path: Path) -> Iterator[Path]:
    """A folder in which this process may make no file, whoever runs the tests."""
    folder = tmp_path / "theirs"
    folder.mkdir(mode=0o500)
    root = os.geteuid() == 0
    if root:
        os.seteuid(NOBODY)
    yield folder
    if root:
        os.seteuid(0)


def refusal(path: Path, *, overwrite: bool = False) -> str:
    with pytest.raises(RecordingError) as caught:
        RecordingWriter(path, settings=SETTINGS, overwrite=overwrite)
    assert str(path) in str(caught.value)
    return str(caught.value)


def test_an_older_recording_is_overwritten_only_when_asked(tmp_path: Path) -> None:
    path = record(tmp_path / "a.qrec", [INFO, *drains(3)])
    before = path.read_bytes()
    assert "give another name" in refusal(path)
    assert path.read_bytes() == before
    RecordingWriter(path, settings=SETTINGS, overwrite=True).close()
    assert len(path.read_bytes()) < len(before)


def test_a_path_that_cannot_be_written_is_found_before_the_first_sample(tmp_path: Path) -> None:
    assert "make its folder first" in refusal(tmp_path / "none" / "a.qrec")
    assert "not of a folder" in refusal(tmp_path, overwrite=True)


def test_a_folder_of_another_user_is_refused_with_what_to_do(folder_of_another: Path) -> None:
    assert "this user may write" in refusal(folder_of_another / "a.qrec")


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no /dev/full here")
def test_a_disk_full_from_the_start_is_found_before_the_first_sample(tmp_path: Path) -> None:
    path = tmp_path / "a.qrec"
    path.symlink_to("/dev/full")
    assert "make room" in refusal(path, overwrite=True)


def test_a_disk_full_from_the_start_leaves_no_file_to_refuse_the_next_try(tmp_path: Path) -> None:
    path = tmp_path / "a.qrec"
    with files_up_to(5):
        refusal(path)
    RecordingWriter(path, settings=SETTINGS).close()


def test_a_disk_that_fills_up_says_so_and_keeps_what_was_written(tmp_path: Path) -> None:
    path = tmp_path / "a.qrec"
    written = drains(2000, frames=10)
    with files_up_to(SMALL_BYTES), RecordingWriter(path, settings=SETTINGS) as writer:
        writer.begin(INFO)
        with pytest.raises(RecordingError, match=r"a\.qrec cannot be written .*record to another"):
            for drain in written:
                writer.write(drain)
        with pytest.raises(RecordingError, match="is closed"):
            writer.write(written[-1])
    assert path.stat().st_size == SMALL_BYTES
    reader = RecordingReader(path)
    _, *got = reader
    assert got == written[: len(got)]
    assert len(got) * 181 > SMALL_BYTES - 5_000
    assert reader.damage.truncated
    with pytest.raises(RecordingError, match="cut off"):
        reader.check()


def test_a_disk_full_at_the_very_end_is_told_by_close(tmp_path: Path) -> None:
    path = tmp_path / "a.qrec"
    with files_up_to(SMALL_BYTES):
        writer = RecordingWriter(path, settings=SETTINGS)
        writer.begin(INFO)
        writer.write(Drain(0, 0, 0, 0, 0, bytes(SMALL_BYTES)))
        with pytest.raises(RecordingError, match="cannot be written"):
            writer.close()
        writer.close()


KILLED = """
import os, signal, sys
sys.path.insert(0, sys.argv[2])
from recorded import INFO, SETTINGS, drains
from quavelet.recording.writer import RecordingWriter
writer = RecordingWriter(sys.argv[1], settings=SETTINGS)
writer.begin(INFO)
for drain in drains(1050):
    writer.write(drain)
os.kill(os.getpid(), signal.SIGKILL)
"""


def test_a_kill_costs_no_more_than_a_second(tmp_path: Path) -> None:
    path = tmp_path / "a.qrec"
    killed = subprocess.run([sys.executable, "-c", KILLED, str(path), str(Path(__file__).parent)], timeout=60)
    assert killed.returncode == -signal.SIGKILL
    reader = RecordingReader(path)
    info, *got = reader
    assert info == INFO
    assert got == drains(len(got))
    assert len(got) >= 950
    assert reader.damage.truncated


def test_a_drain_without_a_stream_is_refused(tmp_path: Path) -> None:
    writer = RecordingWriter(tmp_path / "a.qrec", settings=SETTINGS)
    with writer, pytest.raises(RecordingError, match="StreamInfo first"):
        writer.write(drains(1)[0])


def test_streams_and_drains_come_through_the_hub_in_order(tmp_path: Path) -> None:
    path = tmp_path / "a.qrec"
    items: list[StreamInfo | Drain] = [INFO, *drains(500), INFO, *drains(500)]
    with Hub[StreamInfo | Drain]() as hub:
        hub.subscribe("recording", RecordingWriter(path, settings=SETTINGS), policy=Policy.WAIT)
        for item in items:
            hub.publish(item)
    assert hub.failures() == {}
    reader = RecordingReader(path)
    assert list(reader) == items
    reader.check()
