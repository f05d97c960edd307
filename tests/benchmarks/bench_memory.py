"""Whether the service's memory grows: hours of virtual time with every output, among them a reader that never reads.

    python tests/benchmarks/bench_memory.py [SAMPLES]

Ten million samples at 1 kHz are 2.8 hours of the chip.
"""

from __future__ import annotations

import socket
import sys
import tempfile
import threading
import time
from contextlib import ExitStack, suppress
from dataclasses import dataclass
from pathlib import Path

import msgspec

from hw_fakes import FakeBus, FakeMpu6050, Sway
from quavelet.core.clock import Clock, VirtualClock
from quavelet.core.units import NS_PER_S
from quavelet.mpu6050.config import ChipConfig
from quavelet.service.service import Service
from quavelet.service.status import memory_mb
from quavelet.settings import (
    BusSettings,
    EncodingName,
    LoopSettings,
    OutputSettings,
    RecordingSettings,
    ServiceSettings,
    Settings,
)
from quavelet.sinks.status import Status

SAMPLE_HZ, LOOP_HZ = 1000.0, 40.0
WARM = 0.1
"""The share of the samples after which memory is first looked at."""
ENCODINGS: tuple[EncodingName, ...] = ("json", "nmea", "signalk", "influx", "opentrack")


@dataclass(frozen=True)
class Growth:
    """Resident memory in MB when warm and at the end, what the service said at the end, and how long it took."""

    warm_mb: float
    end_mb: float
    status: Status
    seconds: float


class Measured(VirtualClock):
    """Looks at the memory when its time comes."""

    def __init__(self, warm_ns: int) -> None:
        super().__init__()
        self._warm_ns = warm_ns
        self.warm_mb = 0.0

    def sleep_until_ns(self, t_ns: int) -> None:
        super().sleep_until_ns(t_ns)
        if not self.warm_mb and t_ns >= self._warm_ns:
            self.warm_mb = memory_mb()


def settings_in(folder: Path) -> Settings:
    udp = {f"udp-{name}": OutputSettings(to="udp:127.0.0.1:9", encoding=name) for name in ENCODINGS}
    return Settings(
        bus=BusSettings(name="fake:bed"),
        chip=ChipConfig(gyro_range_dps=500, accel_range_g=4, dlpf=1, sample_rate_hz=SAMPLE_HZ),
        loop=LoopSettings(rate_hz=LOOP_HZ),
        service=ServiceSettings(socket=f"{folder}/control.sock"),
        recording=RecordingSettings(directory=f"{folder}/recordings", file_mb=4.0, total_mb=16.0, fsync_s=0.0),
        output={
            "unix": OutputSettings(to=f"unix:{folder}/json.sock"),
            "tcp": OutputSettings(to="tcp:127.0.0.1:0", encoding="nmea"),
            "thin": OutputSettings(to="udp:127.0.0.1:9", rate_hz=3.0, dead_band_deg=0.5),
            **udp,
        },
    )


def readers_of(folder: Path, stop: threading.Event) -> None:
    """One that never reads, one that does, one that comes and goes."""
    path = f"{folder}/json.sock"
    while not Path(path).exists() and not stop.is_set():
        time.sleep(0.01)
    with ExitStack() as stack, suppress(OSError):
        ends = [stack.enter_context(socket.socket(socket.AF_UNIX)) for _ in range(2)]
        for end in ends:
            end.connect(path)
        ends[1].settimeout(1.0)
        while not stop.is_set():
            with suppress(TimeoutError):
                ends[1].recv(65_536)
            with socket.socket(socket.AF_UNIX) as guest, suppress(OSError):
                guest.connect(path)


def grow(samples: int) -> Growth:
    """Run for so many samples."""
    began_s = time.monotonic()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "recordings").mkdir()
        clock = Measured(round(WARM * samples / SAMPLE_HZ * NS_PER_S))

        def opened(bus: str, at: Clock) -> FakeBus:
            return FakeBus({0x68: FakeMpu6050(at, motion=Sway(), seed=1)}, clock=at, name=bus)

        service = Service(settings_in(folder), clock=clock, talk=print, realtime=False, opened=opened)
        stop = threading.Event()
        readers = threading.Thread(target=readers_of, args=(folder, stop))
        readers.start()
        try:
            service.run(until_ns=round(samples / SAMPLE_HZ * NS_PER_S))
        finally:
            stop.set()
            readers.join()
        return Growth(clock.warm_mb, memory_mb(), service.status(), time.monotonic() - began_s)


def report(growth: Growth) -> str:
    status = growth.status
    sent = ", ".join(f"{output.name} {output.sent}" for output in status.outputs)
    return (
        f"{status.health['samples']} samples in {growth.seconds:.0f} s: {growth.warm_mb:.1f} MB warm, "
        f"{growth.end_mb:.1f} MB at the end, {growth.end_mb - growth.warm_mb:+.1f}\n"
        f"  sent: {sent}\n  recordings {msgspec.json.encode(status.recording).decode()}"
    )


if __name__ == "__main__":
    print(report(grow(int(sys.argv[1]) if len(sys.argv) > 1 else 10_000_000)))
