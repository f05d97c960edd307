"""Whatever stands in the state file, it is refused in one sentence, or it is a state and the filter goes on from it."""

from pathlib import Path
from zlib import crc32

import msgspec
import numpy as np
import pytest
from full_disk import files_up_to
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from quavelet.core.blocks import RawBlock, Scale
from quavelet.core.units import NS_PER_MS, STANDARD_GRAVITY_M_S2
from quavelet.pipeline import Pipeline, build_pipeline
from quavelet.service.resume import Resuming
from quavelet.service.saved_state import (
    MAGIC,
    NoState,
    SavedState,
    pack_pipeline,
    read_state,
    unpack_pipeline,
    write_state,
)
from quavelet.settings import FilterParams, Settings

KINDS = ("gated", "velocity", "pid", "p", "gyro", "accelerometer", "fusion", "fusion-literal")
SCALE = Scale(np.deg2rad(500.0) / 32768, 4 * STANDARD_GRAVITY_M_S2 / 32768, 1 / 340, 36.53)


def block(n: int, *, start_ns: int = 0) -> RawBlock:
    """A board that lies still, with noise of a count or two."""
    counts = np.random.default_rng(5).integers(-3, 4, size=(n, 7)).astype(np.int16)
    counts += np.array([300, -500, 8100, -3000, 60, -20, 15], dtype=np.int16)
    return RawBlock(
        t_ns=start_ns + 5 * NS_PER_MS * np.arange(n, dtype=np.int64),
        period_s=np.full(n, 0.005),
        gap_ns=np.zeros(n, dtype=np.int64),
        flags=np.zeros(n, dtype=np.uint32),
        counts=counts,
        scale=SCALE,
    )


def pipeline(kind: str = "gated") -> Pipeline:
    return build_pipeline(Settings(filter=FilterParams(kind=kind)))  # type: ignore[arg-type]


def saved(of: Pipeline) -> SavedState:
    rows = of.calibrated(block(200))
    means = [tuple(column.mean(axis=0).tolist()) for column in (rows.accel_m_s2, rows.gyro_rad_s)]
    return SavedState(
        version="0",
        boot_id="b",
        boottime_ns=0,
        chip="c",
        digest="d",
        still=True,
        force_m_s2=means[0],
        rate_rad_s=means[1],
        pipeline=pack_pipeline(of.state()),
    )


def settled(kind: str) -> Pipeline:
    made = pipeline(kind)
    made.process(block(2400))
    return made


GOOD = saved(settled("gated"))


@pytest.mark.parametrize("kind", KINDS)
def test_the_memory_of_every_filter_comes_back_to_the_bit(kind: str, tmp_path: Path) -> None:
    before, after = settled(kind), pipeline(kind)
    write_state(tmp_path / "s", saved(before))
    after.restore(unpack_pipeline(read_state(tmp_path / "s").pipeline, like=after.state()))
    more = block(300, start_ns=12_000_000_000)
    assert np.array_equal(before.process(more).q, after.process(more).q)


@pytest.mark.parametrize("kind", KINDS)
def test_the_memory_of_another_filter_is_refused(kind: str) -> None:
    other = pipeline("pid" if kind not in ("pid", "p", "gyro") else "gated")
    with pytest.raises(NoState):
        unpack_pipeline(pack_pipeline(settled(kind).state()), like=other.state())


@given(data=st.binary(max_size=300))
@settings(max_examples=200, deadline=None)
def test_any_bytes_are_refused(data: bytes, tmp_path_factory: pytest.TempPathFactory) -> None:
    path = tmp_path_factory.getbasetemp() / "any.state"
    for content in (data, MAGIC + data, MAGIC + crc32(data).to_bytes(4, "little") + data):
        path.write_bytes(content)
        with pytest.raises(NoState):
            read_state(path)


@given(cut=st.integers(0, 10_000), bit=st.integers(0, 80_000), n=st.integers(0, 3))
@settings(max_examples=100, deadline=None)
def test_any_damage_to_a_good_file_is_refused(
    cut: int, bit: int, n: int, tmp_path_factory: pytest.TempPathFactory
) -> None:
    path = tmp_path_factory.getbasetemp() / "damaged.state"
    write_state(path, GOOD)
    data = bytearray(path.read_bytes())
    data[bit // 8 % len(data)] ^= 1 << bit % 8
    path.write_bytes(bytes(data[: len(data) - cut] if n else data))
    with pytest.raises(NoState):
        read_state(path)


NUMBERS = st.one_of(st.floats(), st.integers(-(2**63), 2**63 - 1), st.none(), st.text(max_size=3), st.just([]))


@given(data=st.data())
@settings(max_examples=120, deadline=None, suppress_health_check=[HealthCheck.too_slow])
def test_a_forged_memory_is_refused_or_gone_on_from_and_never_an_error(data: st.DataObject) -> None:
    """Checksum and form are right; any of its values may be anything."""
    plain = msgspec.msgpack.decode(GOOD.pipeline)
    for _ in range(data.draw(st.integers(1, 3))):
        _spoil(plain, data)
    said: list[str] = []
    fresh = pipeline()
    resuming = Resuming(
        fresh,
        msgspec.structs.replace(GOOD, pipeline=msgspec.msgpack.encode(plain)),
        judge=lambda _: "",
        asleep_ns=lambda: 0,
        talk=said.append,
    )
    first = resuming.process(block(240, start_ns=3_000_000_000))
    assert len(said) == 1
    assert np.isfinite(first.q).all() and np.isfinite(first.sigma_rad).all()
    resuming.process(block(600, start_ns=5_000_000_000))


def _spoil(plain: object, data: st.DataObject) -> None:
    """Put something else in the place of one value, however deep."""
    while True:
        assert isinstance(plain, (dict, list))
        keys = list(plain) if isinstance(plain, dict) else list(range(len(plain)))
        if not keys:
            return
        key = data.draw(st.sampled_from(keys))
        below = plain[key]
        if isinstance(below, (dict, list)) and below and data.draw(st.integers(0, 9)):
            plain = below
            continue
        plain[key] = data.draw(
            st.binary(min_size=len(below), max_size=len(below)) if isinstance(below, bytes) else NUMBERS
        )
        return


def test_a_disk_that_is_full_leaves_the_state_before_and_nothing_else(tmp_path: Path) -> None:
    path = tmp_path / "imu.state"
    write_state(path, GOOD)
    with files_up_to(1000), pytest.raises(OSError):
        write_state(path, replace_time(GOOD, 5))
    assert read_state(path) == GOOD
    assert list(tmp_path.iterdir()) == [path]


def test_a_state_that_is_refused_leaves_the_pipeline_as_it_was() -> None:
    bad = msgspec.structs.replace(GOOD, pipeline=b"\xc0")
    said: list[str] = []
    fresh, plain = pipeline(), pipeline()
    resuming = Resuming(fresh, bad, judge=lambda _: "", asleep_ns=lambda: 0, talk=said.append)
    rows = block(240, start_ns=3_000_000_000)
    assert np.array_equal(resuming.process(rows).q, plain.process(rows).q)
    assert "afresh" in said[0]


def test_how_the_first_samples_are_cut_makes_no_difference() -> None:
    rows = block(240, start_ns=3_000_000_000)
    made = [Resuming(pipeline(), GOOD, judge=lambda _: "", asleep_ns=lambda: 0, talk=lambda _: None) for _ in "ab"]
    whole = made[0].process(rows)
    parts = [made[1].process(rows[a:b]) for a, b in ((0, 0), (0, 7), (7, 90), (90, 101), (101, 102), (102, 240))]
    assert np.array_equal(np.concatenate([part.q for part in parts]), whole.q)
    assert np.array_equal(np.concatenate([part.flags for part in parts]), whole.flags)


def test_a_state_with_a_gap_says_so_in_its_first_row() -> None:
    said: list[str] = []
    resuming = Resuming(
        pipeline(), replace_time(GOOD, 1_000), judge=lambda _: "", asleep_ns=lambda: 0, talk=said.append
    )
    first = resuming.process(block(240, start_ns=3_000_000_000))
    assert first.gap_ns[0] == 3_000_000_000 - 1_000 and not first.gap_ns[1:].any()


def replace_time(state: SavedState, boottime_ns: int) -> SavedState:
    return msgspec.structs.replace(state, boottime_ns=boottime_ns)
