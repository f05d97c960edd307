"""The service at one moment, version 1: what `quavelet status` shows, in words or as JSON.

New fields may be added; unknown ones are to be ignored.
"""

from __future__ import annotations

from typing import Literal

import msgspec

from quavelet.loop.deadline import LoopStats
from quavelet.sinks.message import Message


class LatencyStatus(msgspec.Struct, frozen=True, kw_only=True):
    """From the drain's deadline to the bytes' hand-over to the kernel, over all outputs; as `Histogram` has them."""

    count: int = 0
    p50_ns: int = 0
    p99_ns: int = 0
    max_ns: int = 0


class OutputStatus(msgspec.Struct, frozen=True, kw_only=True):
    """One output; the counters are those of `TransportStats`.

    left_out   messages that its rate or its dead band left out
    state      of its transport, or "failed: ..." where it has ended
    """

    name: str
    to: str
    encoding: str
    state: str
    sent: int = 0
    lost: int = 0
    left_out: int = 0
    readers: int = 0
    refused: int = 0
    bytes: int = 0


class RecordingStatus(msgspec.Struct, frozen=True, kw_only=True):
    """The recording.

    file     being written now, "" where none is
    bytes    that all its files take
    lost     of `kind`, "drains" or "messages": the disk was too slow for them, or took none
    """

    state: str
    file: str = ""
    bytes: int = 0
    lost: int = 0
    kind: str = "drains"


class PageStatus(msgspec.Struct, frozen=True, kw_only=True):
    """Who looks at the live page.

    now       viewers at this moment
    lost      messages that a slow viewer did not get
    refused   requests that were, by the reason: "token", "origin", "host", "viewers", "connections", ...
    dropped   viewers that were, by the reason: "stalled", "silent", "malformed", "oversized", "flood", ...
    """

    now: int = 0
    lost: int = 0
    refused: dict[str, int] = {}
    dropped: dict[str, int] = {}


class ClockStatus(msgspec.Struct, frozen=True, kw_only=True):
    """How the messages' times relate to the world's.

    offset_ns      CLOCK_REALTIME minus CLOCK_MONOTONIC
    synchronised   whether the kernel says that the clock is kept by a time server; None where it is not known
    steps          how often it was set, by half a second or more at once, since the program started
    """

    offset_ns: int
    synchronised: bool | None = None
    steps: int = 0


class Status(msgspec.Struct, frozen=True, kw_only=True):
    """The service at one moment.

    name       of the service
    src        the bus; fake: whether it is no real chip
    chip       what WHO_AM_I names, "" before it answered
    address    of the chip on its bus
    version    of quavelet
    uptime_s   since the program started
    state      "waiting for the chip", "settling", "running", or "lost: ..."
    message    the last one, None before the first
    rate_hz    samples a second by the host's clock, None until measured
    health     all counters of `Health` by name
    loop       how punctual the loop has been
    """

    v: Literal[1] = 1
    name: str
    src: str
    fake: bool
    chip: str = ""
    address: int
    version: str
    uptime_s: float
    state: str
    message: Message | None = None
    rate_hz: float | None = None
    health: dict[str, int]
    loop: LoopStats
    latency: LatencyStatus = LatencyStatus()
    outputs: list[OutputStatus] = []
    calibration: str = ""
    recording: RecordingStatus | None = None
    page: PageStatus | None = None
    clock: ClockStatus
    boot_id: str = ""
    pid: int
    memory_mb: float = 0.0
