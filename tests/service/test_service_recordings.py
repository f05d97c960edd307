"""The service records all the time, and what it records replays to what it said."""

from pathlib import Path

from quavelet.core.clock import VirtualClock
from quavelet.core.health import Health
from quavelet.core.units import NS_PER_S
from quavelet.pipeline import build_pipeline
from quavelet.recording.reader import RecordingReader
from quavelet.recording.replay import ReplaySource
from quavelet.service import recordings
from quavelet.service.service import Service
from quavelet.settings import BusSettings, RecordingSettings, ServiceSettings, Settings


def service_in(directory: Path, said: list[str], *, address: int = 0x68) -> Service:
    settings = Settings(
        bus=BusSettings(name="fake:tilt", address=address),
        service=ServiceSettings(name="boat"),
        recording=RecordingSettings(directory=str(directory), file_mb=0.1, total_mb=0.2, fsync_s=0.0),
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
