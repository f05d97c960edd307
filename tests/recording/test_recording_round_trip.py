"""What goes into a recording comes out of it, to the byte."""

import struct
import tracemalloc
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from recorded import ANY_DRAIN, INFO, SETTINGS, STREAM_INFO, drains, record

from quavelet.bus.protocol import Edge
from quavelet.core.clock import VirtualClock
from quavelet.core.errors import SettingsError
from quavelet.core.health import Health
from quavelet.mpu6050.drain import Drain
from quavelet.mpu6050.stream import StreamInfo
from quavelet.recording.format import MAGIC, Kind, checksum, pack_header, pack_record
from quavelet.recording.reader import RecordingReader
from quavelet.recording.replay import ReplaySource
from quavelet.recording.writer import RecordingWriter
from quavelet.settings import parse_settings


@pytest.fixture(scope="module")
def scratch(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("round") / "a.qrec"


@settings(deadline=None)
@given(info=STREAM_INFO, written=st.lists(ANY_DRAIN, max_size=30))
def test_any_drain_comes_back_as_it_was(scratch: Path, info: StreamInfo, written: list[Drain]) -> None:
    reader = RecordingReader(record(scratch, [info, *written]))
    assert list(reader) == [info, *written]
    assert not reader.damage.found
    reader.check()


@settings(deadline=None)
@given(streams=st.lists(st.tuples(STREAM_INFO, st.lists(ANY_DRAIN, max_size=5)), min_size=1, max_size=5))
def test_streams_of_a_restarted_chip_stay_apart(scratch: Path, streams: list[tuple[StreamInfo, list[Drain]]]) -> None:
    items = list[StreamInfo | Drain]()
    for info, written in streams:
        items += [info, *written]
    assert list(RecordingReader(record(scratch, items))) == items


def test_a_restart_with_the_same_registers_is_a_stream_of_its_own(tmp_path: Path) -> None:
    items: list[StreamInfo | Drain] = [INFO, *drains(3), INFO, *drains(3)]
    reader = RecordingReader(record(tmp_path / "a.qrec", items))
    assert list(reader) == items
    assert list(reader) == items, "a second iteration gives the same"


def test_bytes_that_look_like_a_recording_are_data(tmp_path: Path) -> None:
    inner = record(tmp_path / "inner.qrec", [INFO, *drains(3)]).read_bytes()
    items: list[StreamInfo | Drain] = [INFO, Drain(0, 1, 2, 0, 0, inner), *drains(3, first=1)]
    assert list(RecordingReader(record(tmp_path / "a.qrec", items))) == items


def test_header_tells_when_it_began_by_both_clocks(tmp_path: Path) -> None:
    path = tmp_path / "a.qrec"
    before = datetime.now(UTC)
    with RecordingWriter(path, settings=SETTINGS, clock=VirtualClock(1234)) as writer:
        writer.begin(INFO)
    header = RecordingReader(path).header
    assert header.started_ns == 1234
    assert before <= datetime.fromisoformat(header.started_utc) <= datetime.now(UTC)
    assert header.stream == INFO
    assert header.version


def test_recorded_settings_come_back(tmp_path: Path) -> None:
    chip = {"gyro_range_dps": 250, "accel_range_g": 2, "dlpf": 2, "sample_rate_hz": 1000.0}
    recorded = parse_settings({"chip": chip, "start": {"gyro_bias_dps": [0.1, -0.2, 1 / 3]}}, where="test")
    path = tmp_path / "a.qrec"
    with RecordingWriter(path, settings=recorded) as writer:
        writer.begin(INFO)
    assert ReplaySource(RecordingReader(path), health=Health()).settings == recorded


def test_settings_of_another_version_do_not_keep_the_drains_from_being_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("quavelet.recording.writer.msgspec.to_builtins", lambda _: {"chip": {"colour": 3}})
    path = record(tmp_path / "a.qrec", [INFO, *drains(3)])
    source = ReplaySource(RecordingReader(path), health=Health())
    with pytest.raises(SettingsError, match=r"a\.qrec.*colour"):
        _ = source.settings
    assert source.read() is not None


def test_a_long_recording_is_read_in_bounded_memory(tmp_path: Path) -> None:
    path = record(tmp_path / "a.qrec", [INFO, *drains(20_000, frames=10)])
    assert path.stat().st_size > 3_000_000
    reader = RecordingReader(path)
    tracemalloc.start()
    assert sum(1 for _ in reader) == 20_001
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 500_000


def test_a_pulse_costs_16_bytes_and_a_drain_without_one_none(tmp_path: Path) -> None:
    plain = drains(100, frames=10)
    pulsed = [replace(d, edges=tuple(Edge(t_ns=d.before_ns + k, seq=k) for k in range(10))) for d in plain]
    sizes = [record(tmp_path / "a.qrec", [INFO, *written]).stat().st_size for written in (plain, pulsed)]
    assert (sizes[1] - sizes[0]) / 100 == 2 + 10 * 16


def test_a_recording_of_before_there_were_lines_reads_as_it_was_written(tmp_path: Path) -> None:
    """A DRAIN record by hand, and a header that does not say whether a line was there."""
    path = record(tmp_path / "a.qrec", [INFO])
    old = path.read_bytes().replace(b',"data_ready":false', b"")
    length = len(pack_header(RecordingReader(path).header)) - len(b',"data_ready":false')
    payload = old[len(MAGIC) + 13 : len(MAGIC) + 13 + length]
    crc = checksum(Kind.HEADER, payload, stream_crc=0)
    drain = struct.pack("<QqqBHB", 0, 10, 20, 1, 14, 0) + bytes(range(14))
    path.write_bytes(
        MAGIC
        + 2 * pack_record(Kind.HEADER, payload, crc=crc)
        + pack_record(Kind.DRAIN, drain, crc=checksum(Kind.DRAIN, drain, stream_crc=crc))
        + pack_record(Kind.END, b"", crc=checksum(Kind.END, b"", stream_crc=crc))
    )
    reader = RecordingReader(path)
    assert list(reader) == [INFO, Drain(0, 10, 20, 1, 14, bytes(range(14)))]
    assert not reader.damage.found


def test_a_sample_at_1_khz_costs_18_bytes(tmp_path: Path) -> None:
    path = tmp_path / "a.qrec"
    sizes = [record(path, [INFO, *drains(n, frames=10)]).stat().st_size for n in (100, 200)]
    assert (sizes[1] - sizes[0]) / (100 * 10) == pytest.approx(18.1)
