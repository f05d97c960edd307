"""Every output on, for so many samples of virtual time: what the memory does, and whether recordings keep their bound.

`python tests/benchmarks/soak_outputs.py --samples 10000000` prints the table (some ten minutes).
"""

from __future__ import annotations

import argparse
import socket
import sys
import tempfile
import threading
import urllib.request
from collections.abc import Callable
from contextlib import ExitStack, closing
from dataclasses import dataclass, field
from importlib.util import find_spec
from pathlib import Path

import msgspec

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "service"))
sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "contract"))

from mosquitto_broker import MOSQUITTO, Broker, free_port
from service_bed import Bed, EventClock, Kept

from hw_fakes import Tilt
from quavelet.mpu6050.config import ChipConfig
from quavelet.service.status import memory_mb
from quavelet.settings import BusSettings, LoopSettings, OutputSettings, RecordingSettings, ServiceSettings, Settings
from quavelet.sinks.message import Message
from quavelet.sinks.status import Status

RATE_HZ, LOOP_HZ = 1000.0, 100.0
BOUND_MB = 20.0
DATAGRAMS = ("json", "nmea", "signalk", "influx", "opentrack", *(("mavlink",) if find_spec("pymavlink") else ()))


@dataclass
class Soaked:
    """What was seen: (samples, MB resident) as it went on, the most the recordings ever took in MB, and the end."""

    memory: list[tuple[int, float]] = field(default_factory=list)
    recorded_mb: float = 0.0
    asked: int = 0
    status: Status | None = None

    @property
    def growth_mb(self) -> float:
        """From the end of the first fifth, when all has been used once, to the end."""
        late = [mb for samples, mb in self.memory if samples >= self.memory[-1][0] / 5]
        return late[-1] - late[0]


class Forgets(Kept):
    """Standard output that keeps nothing."""

    def write(self, message: Message) -> None:
        del message


def settings_in(folder: Path, datagrams: int, metrics: int, broker: Broker | None) -> Settings:
    """All there is: a socket file and a port for readers, datagrams in every encoding, a broker where mosquitto is
    installed, figures, recordings."""
    outputs = {
        "socket": OutputSettings(to=f"unix:{folder}/out.sock"),
        "port": OutputSettings(to="tcp:127.0.0.1:0", encoding="nmea"),
        **({"home": OutputSettings(to=f"mqtt:127.0.0.1:{broker.port}")} if broker else {}),
        **{kind: OutputSettings(to=f"udp:127.0.0.1:{datagrams}", encoding=kind) for kind in DATAGRAMS},
        "slow": OutputSettings(to=f"udp:127.0.0.1:{datagrams}", rate_hz=10.0, dead_band_deg=0.5),
    }
    return Settings(
        bus=BusSettings(name="fake:bed"),
        chip=ChipConfig(gyro_range_dps=500, accel_range_g=4, dlpf=3, sample_rate_hz=RATE_HZ),
        loop=LoopSettings(rate_hz=LOOP_HZ),
        output=outputs,
        service=ServiceSettings(socket=f"{folder}/ask.sock", metrics=f"127.0.0.1:{metrics}"),
        recording=RecordingSettings(
            directory=str(folder / "rec"), file_mb=2.0, total_mb=BOUND_MB, keep_free_mb=0.0, fsync_s=0.0
        ),
    )


def soak(samples: int, folder: Path, *, tell: Callable[[str], object] = len) -> Soaked:
    """Run it; one reader of the socket reads all, another one nothing."""
    found = Soaked()
    with ExitStack() as stack:
        sink = stack.enter_context(closing(socket.socket(socket.AF_INET, socket.SOCK_DGRAM)))
        sink.bind(("127.0.0.1", 0))
        metrics, broker = free_port(), Broker(folder) if MOSQUITTO else None
        if broker:
            broker.start()
            stack.callback(broker.kill)
        settings = settings_in(folder, sink.getsockname()[1], metrics, broker)
        (folder / "rec").mkdir()
        bed = Bed(Tilt(), settings=settings, clock=EventClock())
        bed.kept = Forgets()
        seconds = samples / RATE_HZ

        def join() -> None:
            for reads in (True, False):
                reader = stack.enter_context(closing(socket.socket(socket.AF_UNIX)))
                reader.connect(f"{folder}/out.sock")
                if reads:
                    threading.Thread(target=_read_on, args=(reader,), daemon=True).start()

        def look() -> None:
            count = bed.service.imu.health.samples if bed.service.imu else 0
            found.memory.append((count, memory_mb()))
            sizes = [path.stat().st_size for path in (folder / "rec").glob("*")]
            found.recorded_mb = max(found.recorded_mb, sum(sizes) / 1e6)
            with urllib.request.urlopen(f"http://127.0.0.1:{metrics}/metrics", timeout=20.0) as answer:
                found.asked += b"quavelet_" in answer.read()
            tell(f"{count:>10} samples  {found.memory[-1][1]:7.1f} MB  recordings {found.recorded_mb:5.1f} MB at most")

        bed.clock.at(2.0, join)
        for k in range(1, 21):
            bed.clock.at(seconds * k / 20 - 0.5, look)
        bed.run(until_s=seconds)
        found.status = bed.service.status()
    return found


def _read_on(reader: socket.socket) -> None:
    try:
        while reader.recv(1 << 16):
            pass
    except OSError:
        return  # closed at the end


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--samples", type=int, default=10_000_000)
    with tempfile.TemporaryDirectory() as folder:
        found = soak(parser.parse_args().samples, Path(folder), tell=print)
    assert found.status is not None, "it ran"
    for output in found.status.outputs:
        print(msgspec.json.encode(output).decode())
    print(f"memory grew by {found.growth_mb:.2f} MB after the first fifth; recordings took {found.recorded_mb:.1f} MB ")
    print(f"at most, of {BOUND_MB:g} allowed; Prometheus was answered {found.asked} times")


if __name__ == "__main__":
    main()
