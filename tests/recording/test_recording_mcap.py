"""An MCAP file holds what the replay gives, as Foxglove and ROS understand it, with every gap and doubt."""

import io
import json
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from datetime import datetime
from pathlib import Path

import numpy as np
import pytest
from jsonschema import Draft202012Validator
from mcap.reader import make_reader
from mcap.stream_reader import StreamReader
from recorded import INFO, drains, record, record_fake
from scipy.spatial.transform import Rotation

from quavelet.core.blocks import AttitudeBlock, Flag, RawBlock, YawFrom, concat
from quavelet.core.errors import RecordingError
from quavelet.core.health import Health
from quavelet.core.mounting import rotation
from quavelet.core.units import NS_PER_S, STANDARD_GRAVITY_M_S2
from quavelet.pipeline import build_pipeline
from quavelet.recording.mcap import McapWriter, covariance_of, offset_of
from quavelet.recording.reader import RecordingReader
from quavelet.recording.replay import ReplaySource

AXES = ("+y", "-x", "+z")
OFFSET_NS = 1_700_000_000 * NS_PER_S


@dataclass
class File:
    """What the mcap library reads: messages by topic with their log times, schemas by topic, metadata."""

    topics: dict[str, list[tuple[int, dict]]] = field(default_factory=dict)
    schemas: dict[str, tuple[str, dict]] = field(default_factory=dict)
    metadata: dict[str, str] = field(default_factory=dict)

    @property
    def log(self) -> list[str]:
        return [message["message"] for _, message in self.topics["/log"]]


def read(content: bytes) -> File:
    file = File()
    reader = make_reader(io.BytesIO(content), validate_crcs=True)
    for schema, channel, message in reader.iter_messages():
        assert schema is not None
        assert (schema.encoding, channel.message_encoding) == ("jsonschema", "json")
        assert message.publish_time == message.log_time
        file.schemas[channel.topic] = schema.name, json.loads(schema.data)
        file.topics.setdefault(channel.topic, []).append((message.log_time, json.loads(message.data)))
    for metadata in reader.iter_metadata():
        file.metadata |= metadata.metadata
    return file


def replayed(path: Path) -> Iterator[tuple[RawBlock, AttitudeBlock]]:
    source = ReplaySource(RecordingReader(path), health=Health())
    pipeline = build_pipeline(source.settings, calibration=source.calibration)
    while (raw := source.read()) is not None:
        yield raw, pipeline.process(raw)


def time_ns(stamp: dict) -> int:
    return stamp["sec"] * NS_PER_S + stamp["nsec"]


def three(vector: dict) -> list[float]:
    return [vector["x"], vector["y"], vector["z"]]


@pytest.fixture(scope="module")
def qrec(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return record_fake(tmp_path_factory.mktemp("mcap") / "a.qrec", n=400, stall_at=300, stall_ns=NS_PER_S).path


@pytest.fixture(scope="module")
def converted(qrec: Path) -> tuple[File, RawBlock, AttitudeBlock]:
    out = qrec.with_suffix(".mcap")
    pairs = list(replayed(qrec))
    with McapWriter(out, offset_ns=offset_of(RecordingReader(qrec).header), axes=AXES, about={"src": "x"}) as writer:
        for raw, block in pairs:
            writer.write_raw(raw)
            writer.write(block)
    raws = concat([raw for raw, _ in pairs if len(raw)])
    return read(out.read_bytes()), raws, concat([block for _, block in pairs if len(block)])


Converted = tuple[File, RawBlock, AttitudeBlock]


def test_every_message_is_valid_by_the_schema_that_the_file_carries(converted: Converted) -> None:
    file, _, _ = converted
    assert set(file.topics) == {"/attitude", "/mounting", "/imu/data", "/imu/data_raw", "/log"}
    for topic, (name, schema) in file.schemas.items():
        Draft202012Validator.check_schema(schema)
        assert schema["title"] == name
        validator = Draft202012Validator(schema | {"additionalProperties": False})
        for _, message in file.topics[topic]:
            validator.validate(message)


def test_times_and_quaternions_are_those_of_the_replay(converted: Converted, qrec: Path) -> None:
    file, _, block = converted
    header = RecordingReader(qrec).header
    begun_ns = round(datetime.fromisoformat(header.started_utc).timestamp() * 1e6) * 1000
    t_ns = [time_ns(message["timestamp"]) for _, message in file.topics["/attitude"]]
    assert t_ns == [log_time for log_time, _ in file.topics["/attitude"]]
    assert t_ns == (block.t_ns + (begun_ns - header.started_ns)).tolist()
    for topic in ("/attitude", "/imu/data"):
        turns = [m["rotation"] if "rotation" in m else m["orientation"] for _, m in file.topics[topic]]
        got = Rotation.from_quat([[q["x"], q["y"], q["z"], q["w"]] for q in turns])
        assert (got * Rotation.from_quat(block.q[:, [1, 2, 3, 0]]).inv()).magnitude().max() < 1e-12


def test_the_frame_of_the_body_takes_up_to_up(converted: Converted) -> None:
    # What Foxglove does with a transform: the child's vectors into the parent's frame.
    file, _, _ = converted
    frame, felt = file.topics["/attitude"][-1][1], file.topics["/imu/data"][-1][1]
    assert (frame["parent_frame_id"], frame["child_frame_id"]) == ("world", felt["header"]["frame_id"])
    turn = Rotation.from_quat([frame["rotation"][name] for name in "xyzw"])
    up = turn.apply(three(felt["linear_acceleration"]))
    assert np.abs(up - [0, 0, STANDARD_GRAVITY_M_S2]).max() < 0.5


def test_raw_is_what_the_chip_gave_in_its_own_axes_without_an_orientation(converted: Converted) -> None:
    file, raw, _ = converted
    messages = [message for _, message in file.topics["/imu/data_raw"]]
    assert {m["header"]["frame_id"] for m in messages} == {"chip"}
    assert {m["orientation_covariance"][0] for m in messages} == {-1.0}
    counts = raw.counts.astype(float)
    accel = [three(m["linear_acceleration"]) for m in messages]
    # 4 g and 500 deg/s over 16 bit, by the data sheet.
    assert np.allclose(accel, counts[:, 0:3] / 8192 * STANDARD_GRAVITY_M_S2, rtol=1e-12)
    assert np.allclose([three(m["angular_velocity"]) for m in messages], np.radians(counts[:, 4:7] / 65.5), rtol=1e-12)


def test_the_covariance_is_the_square_of_sigma_about_the_worlds_axes(converted: Converted) -> None:
    file, _, block = converted
    got = np.array([m["orientation_covariance"] for _, m in file.topics["/imu/data"]]).reshape(-1, 3, 3)
    assert np.allclose(got, np.einsum("ni,ij->nij", block.sigma_rad**2, np.eye(3)), rtol=1e-12)
    assert (np.linalg.eigvalsh(got) >= 0).all()
    assert covariance_of([0.1, 0.1, float("inf")])[0] == -1.0
    assert covariance_of([float("nan"), 0.1, 0.1])[0] == -1.0


def test_the_mounting_takes_the_chips_vectors_to_the_body(converted: Converted) -> None:
    file, _, _ = converted
    ((_, frame),) = file.topics["/mounting"]
    assert (frame["parent_frame_id"], frame["child_frame_id"]) == ("body", "chip")
    turn = Rotation.from_quat([frame["rotation"][name] for name in "xyzw"])
    assert np.allclose(turn.as_matrix(), rotation(AXES))


def test_gaps_and_doubts_stand_in_the_log_where_they_are(converted: Converted) -> None:
    file, _, block = converted
    gaps = np.flatnonzero(block.gap_ns)
    assert len(gaps) == 1
    (text,) = [text for text in file.log if "without samples" in text]
    assert f"{block.gap_ns[gaps[0]] / 1e6:.1f} ms without samples" in text
    assert "gap" in text
    changes = [i for i in range(len(block)) if i == 0 or block.flags[i] != block.flags[i - 1]]
    offset_ns = int(file.metadata["offset_ns"])
    doubts = [(t_ns, m) for t_ns, m in file.topics["/log"] if "yaw is" not in m["message"]]
    assert [t_ns - offset_ns for t_ns, _ in doubts] == block.t_ns[changes].tolist()
    for i, (_, message) in zip(changes, doubts, strict=True):
        assert message["level"] == (3 if block.flags[i] else 2)
        assert all(name in message["message"] for name in Flag.names(int(block.flags[i])))
    assert f"yaw is {YawFrom.RELATIVE.name.lower()} from here on" in file.log


def test_how_the_samples_came_in_blocks_does_not_show(qrec: Path, tmp_path: Path) -> None:
    pairs = [(raw, block) for raw, block in replayed(qrec) if len(block)][:40]
    whole = concat([block for _, block in pairs])
    contents = []
    for name, blocks in (("one", [whole]), ("parts", [block for _, block in pairs])):
        with McapWriter(tmp_path / name, offset_ns=OFFSET_NS, axes=AXES, about={}) as writer:
            for block in blocks:
                writer.write(block)
        contents.append((tmp_path / name).read_bytes())
    assert contents[0] == contents[1]


def test_a_file_that_was_cut_gives_all_but_its_last_chunk(qrec: Path, tmp_path: Path) -> None:
    path, pairs = tmp_path / "a.mcap", list(replayed(qrec))
    with McapWriter(path, offset_ns=OFFSET_NS, axes=AXES, about={}) as writer:
        for raw, block in pairs:
            writer.write_raw(raw)
            writer.write(block)
    whole = sum(type(record).__name__ == "Message" for record in StreamReader(io.BytesIO(path.read_bytes())).records)
    got = 0
    with pytest.raises(Exception):  # noqa: B017 the library's own, several
        for record_ in StreamReader(io.BytesIO(path.read_bytes()[: path.stat().st_size * 3 // 5])).records:
            got += type(record_).__name__ == "Message"
    assert 0.3 * whole < got < whole


def test_no_file_is_overwritten_and_a_place_that_cannot_be_written_is_said(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    path.write_bytes(b"mine")
    with pytest.raises(RecordingError, match="exists: give another name"):
        McapWriter(path, offset_ns=0, axes=AXES, about={})
    assert path.read_bytes() == b"mine"
    with pytest.raises(RecordingError, match="cannot be written"):
        McapWriter(tmp_path / "none" / "a.mcap", offset_ns=0, axes=AXES, about={})


def test_replay_converts_from_the_command_line(qrec: Path, tmp_path: Path) -> None:
    out = tmp_path / "out.mcap"
    program = "from quavelet.cli.app import main; main()"
    argv = [sys.executable, "-c", program, "replay", str(qrec), "--mcap", str(out)]
    ran = subprocess.run(argv, capture_output=True, text=True, timeout=60)
    assert (ran.returncode, ran.stdout) == (0, ""), ran.stderr
    file = read(out.read_bytes())
    assert len(file.topics["/imu/data_raw"]) > 500
    assert file.metadata["src"] == "fake:turntable"


def test_a_run_writes_what_it_says_while_it_says_it(tmp_path: Path) -> None:
    out = tmp_path / "live.mcap"
    program = "from quavelet.cli.app import main; main()"
    how = ["run", "--bus", "fake:tilt", "--virtual-time", "--json", "--duration", "3", "--mcap", str(out)]
    begun_ns = time.time_ns()
    ran = subprocess.run([sys.executable, "-c", program, *how], capture_output=True, text=True, timeout=60)
    assert ran.returncode == 0, ran.stderr
    file, said = read(out.read_bytes()), [json.loads(line) for line in ran.stdout.splitlines()]
    offset_ns = int(file.metadata["offset_ns"])
    assert begun_ns <= offset_ns <= time.time_ns()
    assert [t_ns - offset_ns for t_ns, _ in file.topics["/imu/data"]] == [message["t_ns"] for message in said]
    for (_, felt), message in zip(file.topics["/imu/data"], said, strict=True):
        assert [felt["orientation"][name] for name in "wxyz"] == message["q"]
        assert three(felt["angular_velocity"]) == message["gyro_rad_s"]
        assert three(felt["linear_acceleration"]) == message["accel_m_s2"]
        sigma = np.radians(message["sigma_deg"])
        assert np.allclose(np.diag(np.reshape(felt["orientation_covariance"], (3, 3))), sigma**2, rtol=1e-9)
    assert any("settling" in text for text in file.log)
    validator = Draft202012Validator(file.schemas["/log"][1])
    for _, message in file.topics["/log"]:
        validator.validate(message)


def test_a_recording_whose_start_is_no_time_is_refused(tmp_path: Path) -> None:
    header = RecordingReader(record(tmp_path / "a.qrec", [INFO, *drains(3)])).header
    for text in ("yesterday", "2026-01-01T00:00:00"):
        object.__setattr__(header, "started_utc", text)
        with pytest.raises(RecordingError, match="is no time"):
            offset_of(header)
