"""The power of a real file system is cut: its disk is copied while a recording is written, and the copy is mounted."""

import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
SCRIPT = """
import shutil, subprocess, sys
from pathlib import Path
sys.path[:0] = sys.argv[2:]
from recorded import INFO, SETTINGS, drains
from quavelet.core.clock import VirtualClock
from quavelet.core.units import NS_PER_S
from quavelet.mpu6050.drain import Drain
from quavelet.recording.reader import RecordingReader
from quavelet.recording.recorder import RotatingRecorder
from quavelet.recording.rotation import Bounds

work = Path(sys.argv[1])
disk, folder, seen = work / "disk", work / "folder", work / "seen"
folder.mkdir()
seen.mkdir()

def mount(image, where):
    # Its journal is written when we wait for it, not every five seconds.
    subprocess.run(["mount", "-o", "loop,commit=300", image, where], check=True)

mount(disk, folder)
told = []
recorder = RotatingRecorder(
    folder, name="imu", settings=SETTINGS, clock=VirtualClock(), tell=told.append, fsync_s=10.0,
    offset_ns=int,
    bounds=Bounds(file_bytes=400_000, file_ns=3600 * NS_PER_S, total_bytes=1_500_000),
)
recorder.write(INFO)
written = drains(30_000)
cuts = [7, 1003, 1997, 5555, 12_345, 20_001, 29_998]
for drain in written:
    recorder.write(drain)
    if drain.seq not in cuts:
        continue
    cut = work / f"cut{drain.seq}"
    shutil.copyfile(disk, cut)
    mount(cut, seen)
    *before, last = sorted(seen.glob("*.qrec"))
    got = []
    for path in before:
        reader = RecordingReader(path)
        got += [item for item in reader if isinstance(item, Drain)]
        reader.check()
    # The header is there before the first drain is; a file that was just begun may hold no more.
    got += [item for item in RecordingReader(last) if isinstance(item, Drain)]
    first = got[0].seq if got else 0
    assert got == written[first : first + len(got)], drain.seq
    newest_ns = got[-1].after_ns if got else 0
    missing_s = (drain.after_ns - newest_ns) / NS_PER_S
    print(f"cut at {drain.after_ns / NS_PER_S:.2f} s: {len(got)} drains, the last {missing_s:.2f} s missing")
    assert missing_s <= 11.0
    assert sum(path.stat().st_size for path in seen.glob("*.qrec")) <= 1_500_000
    subprocess.run(["umount", seen], check=True)
    cut.unlink()
recorder.close()
assert told == [], told
assert recorder.stats().deleted > 0
subprocess.run(["umount", folder], check=True)
"""


def test_a_file_system_that_lost_its_power_has_all_but_the_last_seconds(tmp_path: Path) -> None:
    disk, mkfs = tmp_path / "disk", shutil.which("mkfs.ext4", path="/usr/sbin:/sbin:/usr/bin:/bin")
    if mkfs is None:
        pytest.skip("mkfs.ext4 is not installed")
    with disk.open("wb") as file:
        file.truncate(16_000_000)
    subprocess.run([mkfs, "-q", "-F", disk], check=True)
    (tmp_path / "try").mkdir()
    own = ["unshare", "--mount", "sh", "-c"]
    tried = subprocess.run([*own, 'mount -o loop "$0" "$1"', disk, tmp_path / "try"], capture_output=True, check=False)
    if tried.returncode:
        pytest.skip("this user may not mount a loop device")
    python = [sys.executable, "-c", SCRIPT, tmp_path, ROOT / "src", ROOT, Path(__file__).parent]
    ran = subprocess.run([*own, 'exec "$0" "$@"', *python], capture_output=True, text=True, timeout=120, check=False)
    print(ran.stdout)
    assert ran.returncode == 0, ran.stderr
