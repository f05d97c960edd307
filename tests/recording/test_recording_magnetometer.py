"""A recording of a board with a magnetometer gives the same field again, and one from before there was any is read."""

from __future__ import annotations

import logging
from dataclasses import replace

import msgspec
import numpy as np
import pytest
from magnetometer_rig import BOARDS
from magnetometer_stream_rig import MagStreamRig
from recorded import INFO, assert_identical, drains, record

from hw_fakes.faults.plan import parse
from quavelet.core.errors import RecordingError
from quavelet.core.health import Health
from quavelet.mpu6050.magnetometer.asked import MagnetometerParams
from quavelet.mpu6050.stream import MagnetometerStream, StreamInfo
from quavelet.recording.reader import RecordingReader
from quavelet.recording.replay import ReplaySource


@pytest.mark.parametrize("name", BOARDS)
def test_field_of_the_replay_is_another(name, tmp_path, caplog):
    caplog.set_level(logging.CRITICAL)
    to_body = (0.0, -1.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0)
    rig = MagStreamRig(name, params=MagnetometerParams(use="auto", to_body=to_body)).start()
    rig.run(1.0)
    rig.fake_bus.adapter.faults.add(parse("slip bytes=7"))
    rig.run(0.5)
    rig.unplug()
    rig.run(1.5)
    path = record(tmp_path / "magnetometer.qrec", [*rig.infos, *rig.drains])
    health = Health()
    replay = ReplaySource(RecordingReader(path), health=health)
    assert replay.info == rig.infos[0]
    for live in rig.blocks:
        again = replay.read()
        assert again is not None
        assert_identical(again, live)
    assert replay.read() is None
    assert np.isfinite(rig.got.field_ut).any()
    assert health.magnetometer_lost == rig.health.magnetometer_lost == 1


@pytest.mark.parametrize(
    "changed", [{"kind": "AK09916"}, {"adjustment": None}, {"rate_hz": 7.0}, {"range_ut": 1.0}], ids=str
)
def test_recording_of_a_magnetometer_of_later_times_ends_in_a_traceback(changed, tmp_path):
    stream = MagnetometerStream(
        kind="AK8963", rate_hz=100.0, range_ut=4912.0, external_bytes=8, slaves=1, adjustment=(128, 128, 128)
    )
    path = record(tmp_path / "later.qrec", [replace(INFO, magnetometer=replace(stream, **changed))])
    with pytest.raises(RecordingError, match="magnetometer this version does not understand"):
        RecordingReader(path)


def test_header_without_a_magnetometer_is_refused(tmp_path):
    fields = msgspec.to_builtins(INFO)
    del fields["magnetometer"]
    assert msgspec.convert(fields, StreamInfo) == INFO
    block = ReplaySource(RecordingReader(record(tmp_path / "old.qrec", [INFO, *drains(3)])), health=Health()).read()
    assert block is not None
    assert np.isnan(block.field_ut).all()
