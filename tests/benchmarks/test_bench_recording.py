"""An hour of recording at 1 kHz in virtual time: bytes, processor time, memory and what waiting for the disk costs.

pytest -m 'slow and benchmark' -s tests/benchmarks/test_bench_recording.py
"""

import os
import time
from pathlib import Path

import numpy as np
import pytest

from quavelet.core.clock import VirtualClock
from quavelet.core.units import NS_PER_S
from quavelet.mpu6050.drain import Drain
from quavelet.mpu6050.stream import StreamInfo
from quavelet.recording.format import drain_bytes
from quavelet.recording.recorder import RotatingRecorder
from quavelet.recording.rotation import Bounds
from quavelet.settings import Settings

INFO = StreamInfo(src="fake:hand", address=0x68, who_am_i=0x68, config=1, gyro_config=8, accel_config=8, smplrt_div=0)
HOUR_S = 3600
DRAINS_HZ, FRAMES = 100, 10
MOST_GROWTH_BYTES = 2_000_000

pytestmark = [pytest.mark.benchmark, pytest.mark.slow]


def resident_bytes() -> int:
    return int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")


@pytest.mark.parametrize(
    ("file_bytes", "fsync_s"), [(100_000_000, 0.0), (100_000_000, 10.0), (100_000_000, 1.0), (100_000, 10.0)]
)
def test_an_hour_at_1_khz(tmp_path: Path, file_bytes: int, fsync_s: float, monkeypatch: pytest.MonkeyPatch) -> None:
    waits: list[float] = []
    fsync = os.fsync

    def timed(fd: int) -> None:
        begin = time.monotonic()
        fsync(fd)
        waits.append(time.monotonic() - begin)

    monkeypatch.setattr(os, "fsync", timed)
    bounds = Bounds(file_bytes=file_bytes, file_ns=HOUR_S * NS_PER_S, total_bytes=10 * file_bytes)
    told: list[str] = []
    recorder = RotatingRecorder(
        tmp_path,
        name="imu",
        bounds=bounds,
        settings=Settings(),
        clock=VirtualClock(),
        tell=told.append,
        fsync_s=fsync_s,
        offset_ns=int,
    )
    noise = np.random.default_rng(1).integers(0, 256, (1000, 14 * FRAMES), dtype=np.uint8)
    frames = [row.tobytes() for row in noise]
    recorder.write(INFO)
    begin_rss = most_rss = most_bytes = 0
    begin_s, step_ns = time.process_time(), NS_PER_S // DRAINS_HZ
    for seq in range(HOUR_S * DRAINS_HZ):
        t_ns = seq * step_ns
        recorder.write(Drain(seq, t_ns, t_ns + 200_000, 1, 14 * FRAMES, frames[seq % 1000]))
        if seq % 5000 == 0:
            begin_rss = begin_rss or (resident_bytes() if seq >= 20_000 else 0)
            most_rss = max(most_rss, resident_bytes())
            most_bytes = max(most_bytes, sum(path.stat().st_size for path in tmp_path.iterdir()))
    recorder.close()
    cpu_s = time.process_time() - begin_s
    stats = recorder.stats()
    written = stats.written * drain_bytes(Drain(0, 0, 0, 1, 14 * FRAMES, frames[0]))
    print(
        f"\nfiles of {file_bytes / 1e6:g} MB, fsync_s {fsync_s:g}: {written / HOUR_S / 1000:.1f} kB/s, "
        f"{100 * cpu_s / HOUR_S:.3f} % of a core, {stats.files} files begun, {stats.deleted} deleted, "
        f"{most_bytes / 1e6:.1f} MB at most, memory {(most_rss - begin_rss) / 1e6:+.2f} MB, {len(waits)} waits for the "
        f"disk of {1000 * np.mean(waits):.1f} ms, {1000 * max(waits):.0f} ms at most"
    )
    assert told == []
    assert stats.written == HOUR_S * DRAINS_HZ
    assert stats.files - stats.deleted <= 11
    assert most_bytes <= bounds.total_bytes
    assert most_rss - begin_rss < MOST_GROWTH_BYTES
