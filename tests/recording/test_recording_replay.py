"""A replay gives what the live run gave, to the bit, at the pace asked for."""

from dataclasses import replace
from math import inf, nan
from pathlib import Path

import pytest
from recorded import INFO, PERIOD_NS, Live, assert_identical, drains, record, record_fake

from quavelet.core.blocks import Flag, RawBlock, concat
from quavelet.core.clock import VirtualClock
from quavelet.core.errors import SettingsError
from quavelet.core.health import Health
from quavelet.core.units import NS_PER_S
from quavelet.pipeline import build_pipeline
from quavelet.recording.reader import RecordingReader
from quavelet.recording.replay import ReplaySource, paced


def replayed(path: Path) -> tuple[ReplaySource, Health, list[RawBlock]]:
    health = Health()
    source = ReplaySource(RecordingReader(path), health=health)
    blocks = []
    while (block := source.read()) is not None:
        blocks.append(block)
    assert source.read() is None
    return source, health, blocks


@pytest.fixture(params=["steady", "stalled for 2 s", "steady, with a line", "stalled for 2 s, with a line"])
def live(request: pytest.FixtureRequest, tmp_path: Path) -> Live:
    stalled, wired = request.param.startswith("stalled"), request.param.endswith("line")
    live = record_fake(
        tmp_path / "a.qrec",
        n=600,
        stall_at=300 if stalled else None,
        stall_ns=2 * NS_PER_S,
        int_line="fake:int" if wired else "",
        fault="int-lost at=2 for=1" if wired else "",
    )
    assert live.health.data_ready_missed == wired
    assert (live.health.fifo_overflows > 0) == stalled
    assert any((block.flags & Flag.OVERFLOW).any() for block in live.blocks) == stalled
    return live


def test_replayed_blocks_are_the_live_ones_to_the_bit(live: Live) -> None:
    source, health, blocks = replayed(live.path)
    assert len(blocks) == len(live.blocks)
    for a, b in zip(live.blocks, blocks, strict=True):
        assert_identical(a, b)
        assert a.scale == b.scale
    assert source.settings == live.settings
    assert source.info == live.items[0]
    assert source.last_drain == live.items[-1]
    assert health == live.health


def test_replayed_attitude_is_the_live_one_to_the_bit(live: Live) -> None:
    _, _, blocks = replayed(live.path)
    pipeline = build_pipeline(live.settings)
    expected = concat([pipeline.process(block) for block in live.blocks])
    pipeline = build_pipeline(ReplaySource(RecordingReader(live.path), health=Health()).settings)
    got = concat([pipeline.process(block) for block in blocks])
    assert len(got) > 500
    assert_identical(expected, got)


def test_a_restarted_chip_is_decoded_with_its_new_ranges(tmp_path: Path) -> None:
    other = replace(INFO, gyro_config=24, accel_config=24)
    path = record(tmp_path / "a.qrec", [INFO, *drains(3), other, *drains(3)])
    source, _, blocks = replayed(path)
    assert [block.scale for block in blocks] == [INFO.scale] * 3 + [other.scale] * 3
    assert source.info == other


def test_a_damaged_drain_is_a_gap_in_the_blocks_and_counted(tmp_path: Path) -> None:
    live = record_fake(tmp_path / "a.qrec", n=400)
    data = bytearray(live.path.read_bytes())
    data[len(data) // 2] ^= 0x10
    live.path.write_bytes(data)
    _, health, blocks = replayed(live.path)
    assert len(blocks) == len(live.blocks) - 1
    assert health.records_damaged == 1
    assert sum(int((block.flags & Flag.GAP != 0).sum()) for block in blocks) == 1
    assert health.samples_lost == live.health.samples - health.samples


@pytest.mark.parametrize("speed", [1.0, 4.0, 0.5])
def test_a_replay_keeps_the_pace_asked_for(tmp_path: Path, speed: float) -> None:
    path = record(tmp_path / "a.qrec", [INFO, *drains(101)])
    clock = VirtualClock(start_ns=77)
    times = []
    for _ in paced(ReplaySource(RecordingReader(path), health=Health()), clock=clock, speed=speed):
        times.append(clock.now_ns() - 77)
    assert times == [round(i * PERIOD_NS / speed) for i in range(101)]


def test_a_slow_consumer_does_not_make_the_replay_drift(tmp_path: Path) -> None:
    path = record(tmp_path / "a.qrec", [INFO, *drains(101)])
    clock = VirtualClock()
    for i, _ in enumerate(paced(ReplaySource(RecordingReader(path), health=Health()), clock=clock, speed=1.0)):
        if i == 50:
            clock.advance_ns(5 * PERIOD_NS)
    assert clock.now_ns() == 100 * PERIOD_NS


def test_a_flat_out_replay_never_waits(tmp_path: Path) -> None:
    path = record(tmp_path / "a.qrec", [INFO, *drains(101)])
    clock = VirtualClock()
    blocks = list(paced(ReplaySource(RecordingReader(path), health=Health()), clock=clock, speed=inf))
    assert len(blocks) == 101
    assert clock.now_ns() == 0


@pytest.mark.parametrize("speed", [0.0, -1.0, nan])
def test_a_speed_that_is_none_is_refused(tmp_path: Path, speed: float) -> None:
    source = ReplaySource(RecordingReader(record(tmp_path / "a.qrec", [INFO])), health=Health())
    with pytest.raises(SettingsError, match="give more than 0"):
        paced(source, clock=VirtualClock(), speed=speed)
