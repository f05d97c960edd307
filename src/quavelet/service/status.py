"""What the service says of itself, put together at the moment it is asked."""

from __future__ import annotations

import ctypes
import os
from collections.abc import Mapping
from functools import cache
from importlib.metadata import version
from pathlib import Path
from time import monotonic_ns

from quavelet.core.health import Health
from quavelet.core.units import NS_PER_S
from quavelet.imu import Imu
from quavelet.loop.deadline import NO_LOOP
from quavelet.loop.histogram import Histogram
from quavelet.service.host import boot_id
from quavelet.settings import Settings
from quavelet.sinks.message import Message
from quavelet.sinks.status import ClockStatus, LatencyStatus, OutputStatus, PageStatus, RecordingStatus, Status

_TIMEX_BYTES = 256
"""More than the kernel's struct timex takes; of zeros only, it asks and sets nothing."""
_TIME_ERROR = 5
_TIMESYNCD = Path("/run/systemd/timesync/synchronized")


def status_of(
    imu: Imu | None,
    *,
    settings: Settings,
    name: str,
    state: str,
    message: Message | None,
    latency: Histogram,
    outputs: list[OutputStatus],
    recording: RecordingStatus | None,
    page: PageStatus | None,
    began_ns: int,
    clock: ClockStatus,
    environ: Mapping[str, str],
) -> Status:
    """The status at this moment; `imu` is None before there is a chip, `began_ns` CLOCK_MONOTONIC at the start."""
    info = imu.source.info if imu else None
    return Status(
        name=name,
        src=settings.bus.name,
        fake=settings.bus.name.startswith("fake:"),
        chip=info.variant.name if info else "",
        address=settings.bus.address,
        version=_version(),
        uptime_s=round((monotonic_ns() - began_ns) / NS_PER_S, 3),
        state=state,
        message=message,
        rate_hz=imu.measured_rate_hz if imu else None,
        health=(imu.health if imu else Health()).as_dict(),
        loop=imu.loop.stats if imu else NO_LOOP,
        latency=latency_of(latency),
        outputs=outputs,
        calibration=_calibration(imu),
        recording=recording,
        page=page,
        clock=clock,
        boot_id=boot_id(environ),
        pid=os.getpid(),
        memory_mb=memory_mb(),
    )


def latency_of(latency: Histogram) -> LatencyStatus:
    return LatencyStatus(
        count=latency.count, p50_ns=latency.percentile(50), p99_ns=latency.percentile(99), max_ns=latency.max_ns
    )


def memory_mb() -> float:
    """Resident memory in MB (10^6 bytes), 0.0 where the system does not tell."""
    try:
        pages = int(Path("/proc/self/statm").read_text().split()[1])
    except (OSError, ValueError, IndexError):
        return 0.0
    return round(pages * os.sysconf("SC_PAGE_SIZE") / 1e6, 1)


def is_synchronised() -> bool | None:
    """Whether a time server keeps the clock, by the kernel, or by systemd-timesyncd where the unit's sandbox does not
    let the kernel be asked; None where neither tells."""
    state = int(_adjtimex()(ctypes.create_string_buffer(_TIMEX_BYTES)))
    if state >= 0:
        return state != _TIME_ERROR
    return True if _TIMESYNCD.exists() else None


@cache
def _adjtimex() -> ctypes._NamedFuncPointer:
    return ctypes.CDLL(None).adjtimex


@cache
def _version() -> str:
    return version("quavelet")


def _calibration(imu: Imu | None) -> str:
    """Which is in use, "" for none."""
    if imu is None or imu.calibration is None:
        return ""
    return f"{imu.calibration.in_words()} from {imu.calibration_file}"
