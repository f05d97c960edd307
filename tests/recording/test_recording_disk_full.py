"""A disk that is full: the oldest go; where that is not enough recording stops, says so, and goes on when it can."""

import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
MOUNT = 'mount -t tmpfs -o size=256k none "$1" && shift && exec "$@"'
SCRIPT = """
import sys
from pathlib import Path
sys.path[:0] = sys.argv[2:]
from recorded import INFO
from test_recording_rotation import Rig, slow_drains
from quavelet.recording.rotation import Bounds
from quavelet.recording.reader import RecordingReader
folder, MB = Path(sys.argv[1]), 10**6
stranger = folder / "stranger"

def fill() -> None:
    with stranger.open("ab", buffering=0) as file:
        try:
            while file.write(bytes(4096)):
                pass
        except OSError:
            pass

def more(n: int) -> None:
    rig.write(*slow_drains(n, first=rig.recorder._expected))

BOUNDS = Bounds(file_bytes=40_000, file_ns=3600 * 10**9, total_bytes=MB)
"""
FILLS_UP = """
rig = Rig(folder, BOUNDS)
written = slow_drains(2000)
rig.write(INFO, *written)
assert rig.told == [], rig.told
rig.close()
stats = rig.recorder.stats()
assert stats.deleted > 5, stats
assert stats.unwritten == 0, stats
assert 150_000 < rig.total <= 256 * 1024, rig.total
for path in rig.files:
    items = list(reader := RecordingReader(path))
    reader.check()
"""
TAKEN_BY_OTHERS = """
rig = Rig(folder, BOUNDS)
rig.write(INFO, *slow_drains(300))
while not rig.told:
    fill()
    more(30)
assert len(rig.told) == 1 and "cannot be written (No space left on device): make room" in rig.told[0], rig.told
for _ in range(10):
    fill()
    more(30)
assert len(rig.told) == 1, rig.told
# A try takes what is left of a page, then fails.
for _ in range(5):
    if not rig.recorder.stats().stopped:
        fill()
        more(1)
stats = rig.recorder.stats()
assert stats.unwritten > 100 and "No space" in stats.stopped, stats
assert not [path for path in rig.files if path.stat().st_size == 0]
stranger.unlink()
more(130)
assert len(rig.told) == 2 and "recording again" in rig.told[1], rig.told
rig.close()
assert rig.recorder.stats().stopped == ""
"""
KEEP_FREE = """
import os
rig = Rig(folder, Bounds(file_bytes=40_000, file_ns=3600 * 10**9, total_bytes=MB, keep_free_bytes=100_000))
for drain in [INFO, *slow_drains(1500)]:
    rig.write(drain)
    disk = os.statvfs(folder)
    # The disk gives whole pages of 4096 bytes.
    assert disk.f_bavail * disk.f_frsize >= 100_000 - 4096
assert rig.told == [], rig.told
assert rig.recorder.stats().deleted > 5
while not rig.told:
    fill()
    more(30)
assert len(rig.told) == 1 and "less than keep_free_mb left" in rig.told[0], rig.told
stranger.unlink()
more(130)
assert len(rig.told) == 2, rig.told
rig.close()
"""
READ_ONLY = """
import subprocess
def remount(how):
    subprocess.run(["mount", "-o", f"remount,{how}", folder], check=True)
rig = Rig(folder, BOUNDS)
rig.write(INFO, *slow_drains(50))
rig.close()
remount("ro")
rig = Rig(folder, BOUNDS)
rig.write(INFO)
more(130)
assert len(rig.told) == 1 and "cannot be written (Read-only file system): give a place" in rig.told[0], rig.told
assert rig.recorder.stats().unwritten == 130
remount("rw")
more(130)
assert len(rig.told) == 2 and "recording again" in rig.told[1], rig.told
rig.close()
assert len(rig.files) == 2
"""


@pytest.mark.parametrize(
    "what", [FILLS_UP, TAKEN_BY_OTHERS, KEEP_FREE, READ_ONLY], ids=["by us", "by others", "keep_free_mb", "read-only"]
)
def test_a_small_disk_that_takes_no_more(tmp_path: Path, what: str) -> None:
    own = ["unshare", "--mount", "--map-root-user", "sh", "-c", MOUNT, "sh", str(tmp_path)]
    try:
        subprocess.run([*own, "true"], check=True, capture_output=True)
    except (OSError, subprocess.CalledProcessError):
        pytest.skip("this user may not mount a file system of its own")
    python = [
        sys.executable,
        "-c",
        SCRIPT + what,
        str(tmp_path),
        str(ROOT / "src"),
        str(ROOT),
        str(Path(__file__).parent),
    ]
    ran = subprocess.run([*own, *python], capture_output=True, text=True, timeout=60)
    assert ran.returncode == 0, ran.stderr
