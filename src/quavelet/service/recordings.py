"""Recording all the time, as [recording] of the settings has it."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from quavelet.core.clock import Clock
from quavelet.recording.recorder import RotatingRecorder
from quavelet.recording.rotation import Bounds, RotationStats
from quavelet.settings import Settings
from quavelet.sinks.status import RecordingStatus

DEPTH = 2048
"""Drains that may wait for the disk: an SD card that is busy with itself takes seconds for an fsync."""


def recorder_for(
    settings: Settings, *, name: str, clock: Clock, tell: Callable[[str], None]
) -> RotatingRecorder | None:
    """The recorder, None where none is wanted. Its files' names begin with `name`."""
    recording = settings.recording
    if not recording.directory:
        return None
    return RotatingRecorder(
        Path(recording.directory).expanduser(),
        name=name,
        bounds=Bounds.of(recording),
        settings=settings,
        clock=clock,
        tell=tell,
        fsync_s=recording.fsync_s,
    )


def status_of(stats: RotationStats) -> RecordingStatus:
    """What `quavelet status` says of it."""
    state = "recording" if stats.file else "waiting for the chip"
    if stats.stopped:
        state = f"stopped: {stats.stopped}"
    return RecordingStatus(state=state, file=stats.file, bytes=stats.used_bytes, lost=stats.missed + stats.unwritten)


def in_words(stats: RotationStats) -> str:
    """What came of it, to be told at the end."""
    words = f"recordings: {stats.files} files begun, {stats.written} drains written"
    if stats.deleted:
        words += f", {stats.deleted} older files deleted for room"
    if stats.missed:
        words += f", {stats.missed} drains lost to a slow disk, each marked as a gap on replay"
    if stats.unwritten:
        words += f", {stats.unwritten} drains lost while nothing could be written"
    return words
