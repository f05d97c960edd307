"""The page's "record": a recording begun and ended by hand, and the list of all there are."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from contextlib import suppress
from pathlib import Path
from stat import S_ISREG

import msgspec

from quavelet.core.clock import Clock
from quavelet.core.errors import NotPossible, RecordingError, SettingsError
from quavelet.core.paths import expanded
from quavelet.core.units import NS_PER_S
from quavelet.loop.hub import Hub, Policy
from quavelet.mpu6050.drain import Drain
from quavelet.mpu6050.stream import StreamInfo
from quavelet.recording.folder import delete_ended, names_of
from quavelet.recording.recorder import RotatingRecorder
from quavelet.recording.rotation import RotationStats
from quavelet.service.recordings import DEPTH
from quavelet.settings import Settings
from quavelet.settings.service import AUTO
from quavelet.sinks.message import Message

SUBSCRIBER = "page recording"
LOOK_NS = NS_PER_S
"""How often the directory is looked at."""
MOST_LISTED = 100
"""Each viewer gets the list whenever one of them has grown."""


class RecordedFile(msgspec.Struct, frozen=True, kw_only=True):
    """ended: nothing more is written to it."""

    name: str
    bytes: int
    ended: bool


class RecordState(msgspec.Struct, frozen=True, kw_only=True):
    """recording: it goes on, into `file` of `bytes`, both nothing before the first drain; since_ns of the clock, None
    where it was not begun by hand and cannot be ended.

    files   the newest first, MOST_LISTED of them
    why     why nothing can be started or stopped, or is written; "" while all is well
    """

    recording: bool
    since_ns: int | None
    bytes: int
    file: str
    files: list[RecordedFile]
    why: str


class _Recording:
    """What the hub writes to; `closed` once the file is whole."""

    def __init__(self, recorder: RotatingRecorder, since_ns: int) -> None:
        self.recorder = recorder
        self.since_ns = since_ns
        self.closed = False

    def write(self, item: StreamInfo | Drain) -> None:
        self.recorder.write(item)

    def close(self) -> None:
        self.recorder.close()
        self.closed = True


class RecordAbility:
    """ "start", "stop" and "delete" with a name. Where [recording] records all the time there is nothing to start or
    to stop, and its files are those that are listed.

    name      of the service, with which the files' names begin
    records   where the drains come from
    begin     makes the recorder in a directory; it joins a stream that has begun
    always    what became of [recording], None where that records nothing
    threads   is called when a thread was begun
    """

    def __init__(
        self,
        settings: Settings,
        *,
        service: str,
        clock: Clock,
        environ: Mapping[str, str],
        records: Hub[StreamInfo | Drain],
        policy: Policy,
        begin: Callable[[Path], RotatingRecorder],
        always: Callable[[], RotationStats | None],
        threads: Callable[[], None],
    ) -> None:
        self.directory = directory_of(settings, environ=environ)
        self._is_always = bool(settings.recording.directory)
        self._makes = settings.web.recordings == AUTO
        self._names = names_of(service)
        self._clock = clock
        self._records = records
        self._policy = policy
        self._begin = begin
        self._always = always
        self._threads = threads
        self._recording: _Recording | None = None
        self._before: _Recording | None = None
        self._files: list[RecordedFile] = []
        self._looked_ns: int | None = None

    @property
    def name(self) -> str:
        return "record"

    def about(self) -> dict[str, str]:
        return {"directory": str(self.directory or "")}

    def state(self) -> RecordState:
        now_ns = self._clock.now_ns()
        if self._looked_ns is None or not 0 <= now_ns - self._looked_ns < LOOK_NS:
            self._look()
        recording, stats = self._recording, self._stats()
        file = Path(stats.file).name if stats and stats.file else ""
        return RecordState(
            recording=self._is_always or recording is not None,
            since_ns=recording.since_ns if recording else None,
            bytes=next((f.bytes for f in self._files if f.name == file), 0),
            file=file,
            files=self._files[:MOST_LISTED],
            why=self._why(stats),
        )

    def see(self, message: Message) -> None:
        """Drains are recorded, not messages."""

    def do(self, what: str, values: Mapping[str, object]) -> str:
        if what == "start":
            return self._start()
        if what == "stop":
            return self._stop()
        if what == "delete":
            return self._delete(values.get("name"))
        raise ValueError('a recording can be begun by "start", ended by "stop", and an ended one deleted by "delete"')

    def open_file(self, name: str) -> Path | None:
        """The file of that name out of the list, None where there is none."""
        self._look()
        listed = any(file.name == name for file in self._files)
        return self.directory / name if listed and self.directory is not None else None

    def close(self) -> None:
        """End the recording; the hub waits for it."""
        if self._recording is not None:
            # The hub may be closed already, and has ended it then.
            with suppress(SettingsError):
                self._records.unsubscribe(SUBSCRIBER)
            self._recording = None

    def _start(self) -> str:
        if self._is_always:
            raise NotPossible(_ALWAYS)
        if self._recording is not None:
            raise NotPossible("a recording goes on already: stop that first")
        if self._before is not None and not self._before.closed:
            raise NotPossible("the disk is still busy with the recording before: try again in a moment")
        directory = self._made_directory()
        recording = _Recording(self._begin(directory), self._clock.now_ns())
        self._records.subscribe(SUBSCRIBER, recording, depth=DEPTH, policy=self._policy)
        self._recording, self._looked_ns = recording, None
        self._threads()
        return f"recording into {directory}"

    def _stop(self) -> str:
        if self._is_always:
            raise NotPossible(_ALWAYS)
        if self._recording is None:
            raise NotPossible("nothing is being recorded: start first")
        self._records.unsubscribe(SUBSCRIBER)
        self._before, self._recording, self._looked_ns = self._recording, None, None
        return "the recording is ended"

    def _delete(self, name: object) -> str:
        path = self.open_file(name) if isinstance(name, str) else None
        if path is None:
            raise ValueError("there is no recording of that name: take one out of the list")
        self._looked_ns = None
        try:
            delete_ended(path)
        except BlockingIOError as error:
            raise NotPossible(f"{path.name} is being written: stop the recording first") from error
        except OSError as error:
            raise RecordingError(f"{path.name} cannot be deleted ({error.strerror})") from error
        return f"{path.name} is deleted"

    def _made_directory(self) -> Path:
        directory = self.directory
        if directory is None:
            raise NotPossible("there is no place for recordings: give a directory as web.recordings in the settings")
        try:
            if self._makes:
                directory.mkdir(parents=True, exist_ok=True)
            if not directory.is_dir():
                raise RecordingError(f"there is no directory {directory}: make it, or mount its disk")
        except OSError as error:
            raise RecordingError(
                f"{directory} cannot be made ({error.strerror}): give another, web.recordings"
            ) from error
        if not os.access(directory, os.W_OK | os.X_OK):
            raise RecordingError(f"{directory} cannot be written to: give a directory this user may write to")
        return directory

    def _stats(self) -> RotationStats | None:
        """Of what records now."""
        if self._is_always:
            return self._always()
        return self._recording.recorder.stats() if self._recording else None

    def _why(self, stats: RotationStats | None) -> str:
        if stats is not None and stats.stopped:
            return f"nothing is written, it is tried again each minute: {stats.stopped}"
        if self._is_always:
            return _ALWAYS
        if self.directory is None:
            return "web.recordings of the settings names no place for recordings"
        return ""

    def _look(self) -> None:
        self._looked_ns = self._clock.now_ns()
        writing = {Path(stats.file) for stats in (self._stats(), self._before_stats()) if stats and stats.file}
        self._files = [] if self.directory is None else self._listed(self.directory, writing)

    def _before_stats(self) -> RotationStats | None:
        return self._before.recorder.stats() if self._before and not self._before.closed else None

    def _listed(self, directory: Path, writing: set[Path]) -> list[RecordedFile]:
        found: list[tuple[int, RecordedFile]] = []
        # A directory that is not there yet holds nothing; what is wrong with one is told at the start.
        with suppress(OSError), os.scandir(directory) as entries:
            for entry in entries:
                match = self._names.fullmatch(entry.name)
                if match is None:
                    continue
                # It may be deleted by somebody between the listing and the look.
                with suppress(OSError):
                    status = entry.stat(follow_symlinks=False)
                    if S_ISREG(status.st_mode):
                        ended = directory / entry.name not in writing
                        file = RecordedFile(name=entry.name, bytes=status.st_size, ended=ended)
                        found.append((int(match[1]), file))
        return [file for _, file in sorted(found, key=lambda numbered: -numbered[0])]


_ALWAYS = "[recording] of the settings records all the time: there is nothing to start or to stop"


def directory_of(settings: Settings, *, environ: Mapping[str, str]) -> Path | None:
    """Where recordings are: of [recording], else of [web]; None for nowhere."""
    if settings.recording.directory:
        return expanded(settings.recording.directory)
    asked = settings.web.recordings
    if asked != AUTO:
        return expanded(asked) if asked else None
    given = environ.get("STATE_DIRECTORY", "").partition(":")[0]
    if given:
        return Path(given) / "recordings"
    home = environ.get("HOME", "")
    return Path(home, ".local/state/quavelet/recordings") if home else None
