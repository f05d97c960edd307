"""The service records all the time, and what it records replays to what it said."""

from pathlib import Path
from threading import Event
from typing import Literal

import msgspec
from mcap.reader import make_reader
from output_plans import MESSAGE

from quavelet.core.clock import VirtualClock
from quavelet.core.health import Health
from quavelet.core.units import NS_PER_S
from quavelet.loop.hub import Hub
from quavelet.pipeline import build_pipeline
from quavelet.recording.reader import RecordingReader
from quavelet.recording.replay import ReplaySource
from quavelet.service import recordings
from quavelet.service.service import Service
from quavelet.settings import BusSettings, RecordingSettings, ServiceSettings, Settings
from quavelet.sinks.message import Message


def service_in(
    directory: Path, said: list[str], *, address: int = 0x68, format: Literal["qrec", "mcap"] = "qrec"
) -> Service:
    settings = Settings(
        bus=BusSettings(name="fake:tilt", address=address),
        service=ServiceSettings(name="boat"),
        recording=RecordingSettings(directory=str(directory), format=format, file_mb=0.1, total_mb=0.2, fsync_s=0.0),
    )
    return Service(settings, clock=VirtualClock(), talk=said.append, realtime=False)


def test_it_records_in_bounds_and_any_file_of_it_replays(tmp_path: Path) -> None:
    said: list[str] = []
    service = service_in(tmp_path, said)
    service.run(until_ns=45 * NS_PER_S)
    files = sorted(tmp_path.iterdir())
    assert len(files) >= 2
    assert all(path.name.startswith("boat-") for path in files)
    assert sum(path.stat().st_size for path in files) <= 200_000
    assert service.recorder is not None
    stats = service.recorder.stats()
    assert stats.deleted > 0 and stats.missed == stats.unwritten == 0
    assert "older files deleted for room" in recordings.in_words(stats)
    for path in files:
        reader, health = RecordingReader(path), Health()
        source = ReplaySource(reader, health=health)
        pipeline = build_pipeline(source.settings, calibration=source.calibration)
        rows = 0
        while (raw := source.read()) is not None:
            rows += len(pipeline.process(raw))
        reader.check()
        assert rows > 500
    assert not [text for text in said if "recording" in text]


def test_a_directory_that_is_not_there_does_not_stop_the_service(tmp_path: Path) -> None:
    said: list[str] = []
    service = service_in(tmp_path / "stick", said)
    service.run(until_ns=10 * NS_PER_S)
    told = [text for text in said if "recording" in text]
    assert len(told) == 1 and "make it, or mount its disk" in told[0]
    assert service.recorder is not None
    status = recordings.status_of(service.recorder.stats())
    assert status.state.startswith("stopped: there is no directory")
    assert status.lost > 900


def test_as_mcap_it_keeps_the_newest_messages_in_bounds(tmp_path: Path) -> None:
    said: list[str] = []
    service = service_in(tmp_path, said, format="mcap")
    messages: list[int] = []

    class Seen:
        def write(self, message: Message) -> None:
            messages.append(message.t_ns)

        def close(self) -> None: ...

    service.messages.subscribe("seen", Seen(), depth=64, policy=service.policy)
    service.run(until_ns=45 * NS_PER_S)
    files = sorted(tmp_path.iterdir())
    assert len(files) >= 2
    assert all(path.name.startswith("boat-") and path.suffix == ".mcap" for path in files)
    assert sum(path.stat().st_size for path in files) <= 200_000
    kept = []
    for path in files:
        with path.open("rb") as file:
            reader = make_reader(file, validate_crcs=True)
            (about,) = [metadata.metadata for metadata in reader.iter_metadata()]
            assert about["src"] == "fake:tilt"
            found = reader.iter_messages(topics=["/imu/data"])
            kept += [message.log_time - int(about["offset_ns"]) for _, _, message in found]
    assert kept == messages[-len(kept) :]
    stats = service.recording_stats()
    assert stats is not None
    assert (stats.written, stats.missed, stats.unwritten) == (len(messages), 0, 0)
    assert f"{len(messages)} messages written" in recordings.in_words(stats)
    assert not [text for text in said if "recording" in text]


def test_messages_that_the_disk_was_too_slow_for_are_in_the_status(tmp_path: Path) -> None:
    """They have no numbers that would tell: their queue does."""
    service = service_in(tmp_path, [], format="mcap")
    recorder = recordings.recorder_for(
        service.settings, name="boat", clock=VirtualClock(), time_of_day=service.time_of_day, tell=print
    )
    assert recorder is not None
    busy, free = Event(), Event()

    class Stuck:
        def write(self, message: Message) -> None:
            del message
            busy.set()
            assert free.wait(60)

        def close(self) -> None: ...

    with Hub[Message]() as hub:
        hub.subscribe(recordings.NAME, Stuck(), depth=2)
        hub.publish(MESSAGE)
        assert busy.wait(60)
        for k in range(1, 8):
            hub.publish(msgspec.structs.replace(MESSAGE, t_ns=k))
        free.set()
        stats = recordings.stats_of(recorder, hub)
    assert stats.missed == 5
    status = recordings.status_of(stats)
    assert (status.lost, status.kind) == (5, "messages")
    assert "5 messages lost to a slow disk" in recordings.in_words(stats)
    assert "replay" not in recordings.in_words(stats)
