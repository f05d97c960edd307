"""Cutting a block and joining the parts loses, doubles and mixes up nothing."""

from __future__ import annotations

from dataclasses import fields, replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from quavelet.core.blocks import AttitudeBlock, Block, Flag, ImuBlock, RawBlock, Scale, concat

SCALE = Scale(0.001, 0.002, 1 / 340, 36.53)
WIDTHS = {
    RawBlock: {"counts": (7, np.int16)},
    ImuBlock: {
        "gyro_rad_s": (3, float),
        "accel_m_s2": (3, float),
        "temp_degc": (0, float),
        "gyro_bias_rad_s": (3, float),
        "still": (0, bool),
    },
    AttitudeBlock: {
        "q": (4, float),
        "sigma_rad": (3, float),
        "gyro_rad_s": (3, float),
        "accel_m_s2": (3, float),
        "temp_degc": (0, float),
        "gyro_bias_rad_s": (3, float),
        "still": (0, bool),
    },
}
KINDS = pytest.mark.parametrize("kind", list(WIDTHS))


def block_of(kind: type[Block], n: int, seed: int = 0) -> Block:
    """A block in which no two rows, and no two columns of a row, are the same."""
    rng = np.random.default_rng(seed)
    values = {
        "t_ns": np.cumsum(rng.integers(1, 10**9, n)),
        "period_s": rng.uniform(size=n),
        "gap_ns": rng.integers(0, 10**9, n),
        "flags": rng.integers(0, 512, n).astype(np.uint32),
    }
    for name, (width, dtype) in WIDTHS[kind].items():
        noise = rng.integers(-30000, 30000, (n, width) if width else n)
        values[name] = noise % 2 == 0 if dtype is bool else noise.astype(dtype)
    extra = {"scale": SCALE} if kind is RawBlock else {"delay_ns": 70} if kind is AttitudeBlock else {}
    return kind(**values, **extra)


def assert_same(a: Block, b: Block) -> None:
    assert type(a) is type(b)
    for field in fields(a):
        one, other = getattr(a, field.name), getattr(b, field.name)
        if isinstance(one, np.ndarray):
            assert one.dtype == other.dtype, field.name
            np.testing.assert_array_equal(one, other, err_msg=field.name)
        else:
            assert one == other, field.name


@KINDS
@given(n=st.integers(0, 40), cuts=st.lists(st.integers(0, 40), max_size=6), seed=st.integers(0, 99))
def test_a_block_cut_anywhere_and_joined_again_is_the_same(kind, n, cuts, seed):
    block = block_of(kind, n, seed)
    edges = sorted(min(cut, n) for cut in cuts)
    parts = [block[a:b] for a, b in zip([0, *edges], [*edges, n], strict=True)]
    assert sum(len(part) for part in parts) == n
    assert_same(concat(parts), block)


@KINDS
@given(order=st.permutations(range(6)))
def test_rows_stay_whole_whatever_the_order_of_joining(kind, order):
    block = block_of(kind, 6)
    shuffled = concat([block[k : k + 1] for k in order])
    for name in ["t_ns", "period_s", "gap_ns", "flags", *WIDTHS[kind]]:
        for row, k in enumerate(order):
            np.testing.assert_array_equal(getattr(shuffled, name)[row], getattr(block, name)[k], err_msg=name)


@KINDS
@given(bounds=st.tuples(*2 * [st.none() | st.integers(-50, 50)], st.none() | st.sampled_from([1, 2, -1])))
def test_a_slice_of_a_block_has_the_rows_of_the_same_slice_of_a_list(kind, bounds):
    block = block_of(kind, 20)
    rows = list(range(20))[slice(*bounds)]
    part = block[slice(*bounds)]
    assert len(part) == len(rows)
    np.testing.assert_array_equal(part.t_ns, [block.t_ns[k] for k in rows])


@KINDS
def test_a_slice_copies_nothing_and_a_join_shares_nothing(kind):
    block = block_of(kind, 10)
    for name in ["t_ns", "period_s", "gap_ns", "flags", *WIDTHS[kind]]:
        assert np.shares_memory(getattr(block[2:5], name), getattr(block, name)), name
        assert not np.shares_memory(getattr(concat([block]), name), getattr(block, name)), name


@pytest.mark.parametrize(
    ("kind", "name"),
    [(kind, name) for kind, own in WIDTHS.items() for name in ["period_s", "gap_ns", "flags", *own]],
)
def test_a_column_of_another_length_is_refused_by_name(kind, name):
    block = block_of(kind, 5)
    for wrong in (getattr(block, name)[:4], np.concatenate([getattr(block, name)] * 2)):
        with pytest.raises(ValueError, match=rf"{kind.__name__}\.{name} has {len(wrong)} rows where t_ns has 5"):
            replace(block, **{name: wrong})


def test_nothing_cannot_be_joined():
    with pytest.raises(ValueError, match="nothing to join"):
        concat([])


@pytest.mark.parametrize(
    ("kind", "change"),
    [(RawBlock, {"scale": replace(SCALE, gyro_rad_s_per_lsb=0.004)}), (AttitudeBlock, {"delay_ns": 71})],
)
def test_blocks_of_different_scale_or_delay_are_not_mixed_up(kind, change):
    a, b = block_of(kind, 3), replace(block_of(kind, 3, seed=1), **change)
    (name,) = change
    for blocks in ([a, b], [a, b, a], [b, a[:0]]):
        with pytest.raises(ValueError, match=f"different {name} cannot be joined"):
            concat(blocks)
    assert getattr(concat([b, b]), name) == change[name]


def test_the_names_and_bits_of_flags_that_messages_and_recordings_carry_do_not_change():
    assert {str(flag.name): int(flag) for flag in Flag} == {
        "GAP": 1,
        "OVERFLOW": 2,
        "MISALIGNED": 4,
        "BUS_ERROR": 8,
        "GYRO_CLIPPED": 16,
        "ACCEL_CLIPPED": 32,
        "CLOCK_UNSURE": 64,
        "BIAS_UNKNOWN": 128,
        "SETTLING": 256,
        "CHIP_UPSET": 512,
        "IMPLAUSIBLE": 1024,
        "STUCK": 2048,
        "HEADING_SUSPECT": 4096,
        "UNCALIBRATED_TEMPERATURE": 8192,
        "FIELD_LOST": 16384,
        "FIELD_DISTURBED": 32768,
    }


@given(flags=st.sets(st.sampled_from(list(Flag))), strange=st.sampled_from([0, 1 << 29, 1 << 31]))
def test_every_bit_that_is_set_is_named_once_and_in_order(flags, strange):
    value = sum(flags) | strange
    for given_as in (value, np.uint32(value)):
        names = Flag.names(given_as)
        assert [Flag[name.upper()] for name in names] == sorted(flags)
        assert all(name == name.lower() for name in names)
