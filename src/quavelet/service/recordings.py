"""Recording all the time, as [recording] of the settings has it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from importlib.metadata import version
from pathlib import Path

from quavelet.core.clock import Clock
from quavelet.core.paths import expanded
from quavelet.loop.hub import Hub
from quavelet.recording.mcap_recorder import RotatingMcap
from quavelet.recording.recorder import RotatingRecorder
from quavelet.recording.rotation import Bounds, RotationStats
from quavelet.service.time_of_day import TimeOfDay
from quavelet.settings import Settings
from quavelet.sinks.message import Message
from quavelet.sinks.status import RecordingStatus

NAME = "recordings"
"""Of its queue."""

DEPTH = 2048
"""Drains that may wait for the disk: an SD card that is busy with itself takes seconds for an fsync."""


def recorder_for(
    settings: Settings, *, name: str, clock: Clock, time_of_day: TimeOfDay, tell: Callable[[str], None]
) -> RotatingRecorder | RotatingMcap | None:
    """The recorder, None where none is wanted; its files' names begin with `name`.

    Raises SettingsError for MCAP without its package.
    """
    recording = settings.recording
    if not recording.directory:
        return None
    directory = expanded(recording.directory)
    if recording.format == "mcap":
        return RotatingMcap(
            directory,
            name=name,
            bounds=Bounds.of(recording),
            axes=settings.mounting.axes,
            about={"src": settings.bus.name, "version": version("quavelet")},
            clock=clock,
            rate_hz=settings.loop.rate_hz,
            tell=tell,
            fsync_s=recording.fsync_s,
            offset_ns=time_of_day.offset_ns,
        )
    return drain_recorder(directory, settings=settings, name=name, clock=clock, time_of_day=time_of_day, tell=tell)


def drain_recorder(
    directory: Path,
    *,
    settings: Settings,
    name: str,
    clock: Clock,
    time_of_day: TimeOfDay,
    tell: Callable[[str], None],
    joins: bool = False,
) -> RotatingRecorder:
    """A recorder of what the chip gave, within the bounds of [recording]."""
    return RotatingRecorder(
        directory,
        name=name,
        bounds=Bounds.of(settings.recording),
        settings=settings,
        clock=clock,
        tell=tell,
        fsync_s=settings.recording.fsync_s,
        joins=joins,
        offset_ns=time_of_day.offset_ns,
    )


def stats_of(recorder: RotatingRecorder | RotatingMcap, messages: Hub[Message]) -> RotationStats:
    """What became of all; messages have no numbers, so it is their queue that knows which never came."""
    stats = recorder.stats()
    missed = sum(queue.lost for queue in messages.stats() if queue.name == NAME)
    return replace(stats, missed=stats.missed + missed)


def status_of(stats: RotationStats) -> RecordingStatus:
    """What `quavelet status` says of it."""
    state = "recording" if stats.file else "waiting for the chip"
    if stats.stopped:
        state = f"stopped: {stats.stopped}"
    lost = stats.missed + stats.unwritten
    return RecordingStatus(state=state, file=stats.file, bytes=stats.used_bytes, lost=lost, kind=stats.kind)


def in_words(stats: RotationStats) -> str:
    """What came of it, to be told at the end."""
    words = f"recordings: {stats.files} files begun, {stats.written} {stats.kind} written"
    if stats.deleted:
        words += f", {stats.deleted} older files deleted for room"
    if stats.missed:
        words += f", {stats.missed} {stats.kind} lost to a slow disk"
        words += ", each marked as a gap on replay" if stats.kind == "drains" else ""
    if stats.unwritten:
        words += f", {stats.unwritten} {stats.kind} lost while nothing could be written"
    return words
