"""A `Status` for the tests of what is made from one."""

from __future__ import annotations

from sink_messages import OFFSET_NS, message

from quavelet.core.health import Health
from quavelet.loop.deadline import LoopStats
from quavelet.sinks.message import Message
from quavelet.sinks.status import ClockStatus, LatencyStatus, OutputStatus, RecordingStatus, Status

_LEVEL = message()


def status(
    *, name: str = "imu0", src: str = "linux:1", state: str = "running", last: Message | None = _LEVEL
) -> Status:
    """A service at work, with two outputs and a recording."""
    return Status(
        name=name,
        src=src,
        fake=src.startswith("fake:"),
        chip="MPU-6050",
        address=0x68,
        version="0.1.0",
        uptime_s=12.5,
        state=state,
        message=last,
        rate_hz=200.25,
        health=Health(samples=2500, gaps=3, fifo_overflows=1).as_dict(),
        loop=LoopStats(100, 2, 10_000, 90_000, 120_000, 400_000, 800_000, 900_000),
        latency=LatencyStatus(count=100, p50_ns=200_000, p99_ns=500_000, max_ns=750_000),
        outputs=[
            OutputStatus(name="phone", to="udp:10.0.0.2:10110", encoding="nmea", state="sending", sent=90, lost=4),
            OutputStatus(name="plot", to="tcp:127.0.0.1:0", encoding="json", state="listening", readers=2, bytes=77),
        ],
        recording=RecordingStatus(state="recording", file="a.qrec", bytes=123_456, lost=5),
        clock=ClockStatus(offset_ns=OFFSET_NS, synchronised=True),
        pid=1,
        memory_mb=41.5,
    )
