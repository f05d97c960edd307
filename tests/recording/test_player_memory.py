"""However long a recording is, what is kept of it is bounded; and a day of it can still be gone to."""

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from played import PLAIN, maker
from recorded import INFO, drains, record, record_fake

from quavelet.core.blocks import AttitudeBlock, RawBlock
from quavelet.core.health import Health
from quavelet.core.units import NS_PER_S
from quavelet.mpu6050.decoder import DecoderState
from quavelet.mpu6050.timebase import TimeBase
from quavelet.recording.checkpoint import Checkpoint, Checkpoints, Replaying
from quavelet.recording.overview import OverviewSoFar
from quavelet.recording.reader import Position, RecordingReader
from quavelet.recording.replay import ReplayState

STATE = ReplayState(Position(), INFO, DecoderState(timebase=TimeBase(nominal_period_s=0.005).state()), None, Health())
DAY_S = 86_400


def fill(checkpoints: Checkpoints, *, until_s: float, each: int = 24_000) -> None:
    for at_s in range(int(until_s) + 1):
        if at_s * NS_PER_S >= checkpoints.wanted_ns:
            checkpoints.keep(Checkpoint(at_s * NS_PER_S, STATE, bytes(each)))


@pytest.mark.parametrize("each", [100, 24_000, 200_000])
def test_of_a_day_there_are_no_more_than_fit_and_each_place_has_one_near(each: int) -> None:
    checkpoints = Checkpoints()
    fill(checkpoints, until_s=DAY_S, each=each)
    assert len(checkpoints) <= 2000
    assert len(checkpoints) * each <= 40_000_000
    for at_s in (0, 9, 3600, DAY_S // 2 + 7, DAY_S):
        at_ns = at_s * NS_PER_S
        assert 0 <= at_ns - checkpoints.before(at_ns).at_ns <= checkpoints.step_ns + NS_PER_S
    assert checkpoints.before(-5).at_ns == 0
    assert checkpoints.step_ns <= (80 if each <= 24_000 else 1280) * NS_PER_S


@given(most=st.integers(2, 30), until_s=st.integers(0, 2000), at_s=st.integers(0, 3000))
def test_the_checkpoint_given_is_the_last_one_before(most: int, until_s: int, at_s: int) -> None:
    checkpoints = Checkpoints(most=most)
    fill(checkpoints, until_s=until_s, each=1)
    assert len(checkpoints) <= most
    found_ns = checkpoints.before(at_s * NS_PER_S).at_ns
    assert found_ns <= at_s * NS_PER_S
    assert min(at_s, until_s) * NS_PER_S - found_ns <= checkpoints.step_ns + NS_PER_S


def attitude(t_ns: list[int]) -> AttitudeBlock:
    n = len(t_ns)
    return AttitudeBlock(
        t_ns=np.array(t_ns, dtype=np.int64),
        period_s=np.full(n, 0.005),
        gap_ns=np.zeros(n, dtype=np.int64),
        flags=np.zeros(n, dtype=np.uint32),
        q=np.tile([1.0, 0.0, 0.0, 0.0], (n, 1)),
        sigma_rad=np.zeros((n, 3)),
        gyro_rad_s=np.zeros((n, 3)),
        accel_m_s2=np.zeros((n, 3)),
        temp_degc=np.zeros(n),
        gyro_bias_rad_s=np.zeros((n, 3)),
        still=np.zeros(n, dtype=np.bool_),
    )


def raw(t_ns: int, gap_ns: int) -> RawBlock:
    return RawBlock(
        t_ns=np.array([t_ns]),
        period_s=np.array([0.005]),
        gap_ns=np.array([gap_ns]),
        flags=np.zeros(1, dtype=np.uint32),
        counts=np.zeros((1, 7), dtype=np.int16),
        scale=INFO.scale,
    )


@settings(max_examples=30, deadline=None)
@given(rows=st.integers(1, 1000), each=st.integers(1, 40), step_ms=st.integers(1, 3000))
def test_the_overview_has_all_of_it_in_few_points(rows: int, each: int, step_ms: int) -> None:
    so_far = OverviewSoFar(most_points=50)
    times = [1_000_000 * step_ms * row for row in range(rows)]
    for begin in range(0, rows, each):
        so_far.see(attitude([77 + t_ns for t_ns in times[begin : begin + each]]), since_ns=77)
    t_s = so_far.overview().t_s
    assert len(t_s) <= 50
    assert t_s == sorted(set(t_s))
    assert t_s[0] == 0.0
    steps = np.diff([*t_s, times[-1] / 1e9])
    assert steps.max(initial=0.0) <= max(0.05, 2.6 * times[-1] / 1e9 / 25) + 2 * step_ms / 1e3


def test_many_gaps_stand_as_fewer_that_cover_them() -> None:
    so_far = OverviewSoFar(most_gaps=20)
    for i in range(1, 1000):
        so_far.see_raw(raw(i * NS_PER_S, NS_PER_S // 4), since_ns=0)
    gaps = so_far.overview().gaps
    assert 1 <= len(gaps) <= 20
    assert gaps[0][0] == 0.75
    assert gaps[-1][1] == 999.0
    assert all(before[1] < after[0] for before, after in pairwise(gaps))


def test_what_is_kept_of_a_checkpoint_is_small(tmp_path: Path) -> None:
    replaying = Replaying(RecordingReader(record_fake(tmp_path / "a.qrec", n=600).path), make_pipeline=maker(PLAIN))
    while (block := replaying.read()) is not None:
        replaying.process([block])
    assert len(replaying.checkpoint().packed) < 40_000


def test_a_reader_goes_on_from_any_position_as_if_it_had_never_stopped(tmp_path: Path) -> None:
    path = record(tmp_path / "a.qrec", [INFO, *drains(6), INFO, *drains(4)])
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 1
    path.write_bytes(data[:-9])
    reader = RecordingReader(path)
    items, positions = [], []
    for item in reader:
        items.append(item)
        positions.append(reader.position)
    damage = reader.damage
    assert damage.found
    for done, position in enumerate(positions, start=1):
        other = RecordingReader(path)
        assert list(other.from_position(position)) == items[done:]
        assert other.damage == damage
