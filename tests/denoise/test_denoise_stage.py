"""The stage: samples stay whole, gaps are not smeared over, the delay is stated, and settings that cannot be."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec import structs

from quavelet.core.blocks import Flag, ImuBlock, RawBlock, Scale, array_fields, concat
from quavelet.core.errors import SettingsError
from quavelet.core.euler import to_euler
from quavelet.denoise.params import DenoiseParams
from quavelet.denoise.rows import whole
from quavelet.denoise.stage import Denoise
from quavelet.pipeline import build_pipeline
from quavelet.settings import FilterParams, Settings, StartSettings, load_settings
from quavelet.sinks.message import message_of

KINDS = ("wavelet", "lowpass", "median", "hampel", "smoother")
"""Those that keep slow motion."""
DELAYS = {"wavelet": 15, "lowpass": 15, "median": 2, "hampel": 2, "smoother": 0}
PERIOD_NS = 5_000_000
SCALE = Scale(gyro_rad_s_per_lsb=np.radians(1 / 65.5), accel_m_s2_per_lsb=9.80665 / 8192,
              temp_degc_per_lsb=1 / 340, temp_degc_at_zero=36.53)  # fmt: skip


def stage(kind: str, **params) -> Denoise:
    return Denoise(DenoiseParams(kind=kind, **params).build(), sample_rate_hz=200.0)


def samples(seed: int, n: int) -> ImuBlock:
    rng = np.random.default_rng(seed)
    return ImuBlock(
        t_ns=np.arange(n, dtype=np.int64) * PERIOD_NS,
        period_s=rng.uniform(0.0049, 0.0051, n),
        gap_ns=np.zeros(n, dtype=np.int64),
        flags=rng.choice(np.array([0, Flag.CLOCK_UNSURE, Flag.GYRO_CLIPPED], dtype=np.uint32), n),
        gyro_rad_s=rng.normal(size=(n, 3)),
        accel_m_s2=rng.normal([0.0, 0.0, 9.8], 0.1, (n, 3)),
        temp_degc=rng.normal(size=n),
        gyro_bias_rad_s=np.zeros((n, 3)),
        still=rng.random(n) < 0.5,
    )


def raw_block(counts: np.ndarray) -> RawBlock:
    """Counts (N, 7) of a chip at 500 deg/s and 4 g."""
    zeros = np.zeros(len(counts))
    return RawBlock(t_ns=np.arange(len(counts)) * PERIOD_NS, period_s=zeros + 0.005, gap_ns=zeros.astype(np.int64),
                    flags=zeros.astype(np.uint32), counts=counts, scale=SCALE)  # fmt: skip


def flagged(block: ImuBlock, rows: list[int], flag: Flag) -> ImuBlock:
    flags = block.flags.copy()
    flags[rows] |= np.uint32(flag)
    return replace(block, flags=flags)


def six(block: ImuBlock) -> np.ndarray:
    return np.concatenate([block.gyro_rad_s, block.accel_m_s2], axis=1)


@pytest.mark.parametrize("kind", KINDS)
@settings(max_examples=20, deadline=None)
@given(seed=st.integers(0, 10**6), n=st.integers(1, 120), where=st.sets(st.integers(0, 119), max_size=5))
def test_each_run_between_gaps_is_filtered_by_itself_and_no_sample_is_lost_or_mixed(kind, seed, n, where):
    """However short the runs: one sample between two gaps too."""
    cuts = sorted(k for k in where if 0 < k < n)
    block = flagged(samples(seed, n), cuts, Flag.GAP)
    denoise = stage(kind)
    out = denoise.process(block)
    last_run = n - (cuts[-1] if cuts else 0)
    assert len(out) == n - min(last_run, DELAYS[kind])
    out = concat([out, denoise.finish()])
    for name in set(array_fields(ImuBlock)) - {"gyro_rad_s", "accel_m_s2"}:
        assert np.array_equal(getattr(out, name), getattr(block, name), equal_nan=True), name
    params = DenoiseParams(kind=kind)
    runs = [whole(params.build(), six(block[a:b])) for a, b in pairwise([0, *cuts, n])]
    # The noise is measured on from run to run, and known for none of so short ones.
    if n < 64 or kind != "wavelet":
        assert np.array_equal(six(out), np.concatenate(runs))


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("how", ["flag", "time", "stuck", "free"])
def test_a_step_at_a_gap_stays_a_step(kind, how):
    block = samples(1, 200)
    step = np.where(np.arange(200) < 100, 1.0, 5.0)[:, None] * np.ones(3)
    block = replace(block, gyro_rad_s=step, accel_m_s2=-step, flags=np.zeros(200, dtype=np.uint32))
    if how == "flag":
        block = flagged(block, [100], Flag.GAP)
    elif how == "time":
        block.gap_ns[100] = 1
    else:
        block = flagged(block, list(range(100, 200) if how == "stuck" else range(100)), Flag.STUCK)
    denoise = stage(kind)
    out = concat([denoise.process(block), denoise.finish()])
    assert np.allclose(out.gyro_rad_s, step, atol=1e-9)
    assert np.allclose(out.accel_m_s2, -step, atol=1e-9)


@pytest.mark.parametrize("kind", KINDS)
def test_what_waits_before_a_gap_comes_out_with_the_first_sample_after_it(kind):
    block = flagged(samples(2, 101), [100], Flag.GAP)
    denoise = stage(kind)
    before = denoise.process(block[:100])
    assert len(before) == 100 - DELAYS[kind]
    at_gap = denoise.process(block[100:])
    assert at_gap.t_ns[:DELAYS[kind]].tolist() == block.t_ns[100 - DELAYS[kind] : 100].tolist()  # fmt: skip
    assert len(at_gap) == DELAYS[kind] + (kind == "smoother")


@pytest.mark.parametrize("kind", ["wavelet", "lowpass"])
def test_both_sensors_are_delayed_alike_and_the_time_is_the_samples_own(kind):
    block = samples(3, 120)
    pulse = np.zeros((120, 3))
    pulse[60] = 1.0
    block = replace(block, gyro_rad_s=pulse, accel_m_s2=pulse.copy())
    out = stage(kind).process(block)
    for rows in (out.gyro_rad_s, out.accel_m_s2):
        assert out.t_ns[np.argmax(rows[:, 0])] == block.t_ns[60]


@pytest.mark.parametrize("kind", KINDS)
def test_a_bias_that_is_found_is_no_jump_of_the_rate(kind):
    """StillBias takes 5 deg/s off from one sample to the next; the turn is the same before and after."""
    block = samples(4, 200)
    found = np.arange(200)[:, None] >= 100
    bias = np.where(found, [0.09, -0.05, 0.02], 0.0)
    turn = np.array([0.5, 0.1, -0.3])
    measured = turn + np.array([0.09, -0.05, 0.02])
    denoise = stage(kind)
    out = denoise.process(replace(block, gyro_rad_s=measured - bias, gyro_bias_rad_s=bias))
    known = out.gyro_bias_rad_s[:, 0] != 0.0
    assert np.allclose(out.gyro_rad_s[known], turn, atol=1e-9)
    assert np.allclose(out.gyro_rad_s[~known], measured, atol=1e-9)


@pytest.mark.parametrize("kind", ["wavelet", "lowpass", "median", "smoother"])
def test_a_run_begins_no_noisier_than_it_came(kind):
    first = []
    for seed in range(300):
        rng = np.random.default_rng(seed)
        block = replace(samples(seed, 60), gyro_rad_s=rng.normal(size=(60, 3)), accel_m_s2=rng.normal(size=(60, 3)))
        first.append(six(stage(kind).process(block))[:20])
    assert np.std(first, axis=(0, 2)).max() < 1.06


def test_no_sample_at_all_and_one_sample():
    denoise = stage("wavelet")
    assert len(denoise.finish()) == 0
    assert len(denoise.process(samples(5, 0))) == 0
    one = samples(5, 1)
    assert len(denoise.process(one)) == 0
    assert np.allclose(six(denoise.finish()), six(one))
    assert len(denoise.finish()) == 0


@pytest.mark.parametrize("kind", KINDS)
def test_a_value_that_is_not_finite_is_refused_by_its_row(kind):
    block = samples(6, 30)
    block.accel_m_s2[17, 2] = np.nan
    with pytest.raises(ValueError, match="row 17 is not finite"):
        stage(kind).process(block)


def test_an_impulse_on_the_bus_does_not_reach_the_attitude_through_hampel():
    rng = np.random.default_rng(8)
    counts = rng.normal([0, 0, 8192, 0, 0, 0, 0], [20, 20, 20, 0, 3, 3, 3], (1200, 7)).astype(np.int16)
    counts[1000, 4] = 32767
    raw = raw_block(counts)
    roll = {}
    for kind in ("none", "hampel"):
        pipeline = build_pipeline(structs.replace(Settings(), denoise=DenoiseParams(kind=kind)))
        out = pipeline.process(raw)
        message = message_of(out, src="hand")
        assert message.delay_ns == (0 if kind == "none" else 2 * PERIOD_NS)
        assert message.t_ns == raw.t_ns[-1] - message.delay_ns
        assert len(out) == 1200 - message.delay_ns // PERIOD_NS
        roll[kind] = np.degrees(2 * np.abs(out.q[1000:, 1]).max())
    assert roll["none"] > 2.0
    assert roll["hampel"] < 0.5


def test_a_single_count_on_a_board_that_shows_no_noise_is_no_impulse():
    """A gyroscope behind a narrow low-pass reads the same count for long: its spread is then 0."""
    block = samples(9, 60)
    still = np.zeros((60, 3))
    still[30] = np.radians(1 / 65.5)
    block = replace(block, gyro_rad_s=still, accel_m_s2=still / np.radians(1 / 65.5) * 9.80665 / 8192)
    denoise = stage("hampel")
    assert np.array_equal(six(concat([denoise.process(block), denoise.finish()])), six(block))


@pytest.mark.parametrize(
    ("wrong", "says"),
    [
        ({"wavelet": "db77"}, "'db77' is not known"),
        ({"wavelet": "dmey"}, "only approximately"),
        ({"levels": 0}, "levels = 0"),
        ({"levels": 9}, "samples late"),
        ({"window": 4}, "odd"),
        ({"window": 4001}, "2000 samples late"),
        ({"sigmas": -1.0}, "sigmas"),
        ({"forgetting": 1.0}, "forgetting"),
        ({"shrink": "improved", "k": 0.0}, "positive"),
        ({"shrink": "power", "k": 0.5}, "power form"),
    ],
)
@pytest.mark.parametrize("kind", ["none", "median"])
def test_a_setting_that_cannot_be_is_refused_whatever_the_kind(kind, wrong, says):
    with pytest.raises(SettingsError, match=says):
        DenoiseParams(kind=kind, **wrong)


def test_the_file_and_the_key_are_named(tmp_path):
    path = tmp_path / "q.toml"
    path.write_text('[denoise]\nkind = "wavelet"\nwavelet = "db77"\n')
    with pytest.raises(SettingsError, match=r"q\.toml: denoise: wavelet 'db77' is not known"):
        load_settings(path)
    path.write_text('[denoise]\nkind = "kalman"\n')
    with pytest.raises(SettingsError, match=r"q\.toml: denoise\.kind: "):
        load_settings(path)
    path.write_text('[denoise]\nkind = "median"\nwindow = 13\n')
    assert load_settings(path).settings.denoise == DenoiseParams(kind="median", window=13)


@pytest.mark.parametrize(("kind", "filter_kind"), [("details", "pid"), ("details", "gyro"), ("details-shrunk", "pid")])
def test_the_readings_that_zero_the_low_band_lose_a_turn_and_are_flagged(kind, filter_kind):
    """Paper 000's readings A, B and D: a turn of 120 deg reads 0, and nobody is let believe it."""
    base = Settings()
    given = structs.replace(
        base,
        denoise=DenoiseParams(kind=kind),
        filter=FilterParams(kind=filter_kind),
        start=StartSettings(gyro_bias_dps=(1.0, 0.0, 2.0)),
    )
    counts = np.random.default_rng(1).normal([0, 0, 8192, 0, 65.5, 0, 131.0], [20, 20, 20, 0, 3, 3, 3], (2200, 7))
    counts[1000:2000, 6] += 24.0 * 65.5
    turning = raw_block(counts.astype(np.int16))
    out = build_pipeline(given).process(turning)
    yaw_deg = np.degrees(np.unwrap(to_euler(out.q)[:, 2]))
    assert abs(yaw_deg[-1] - yaw_deg[0]) < 1.0
    assert (out.flags & Flag.HEADING_SUSPECT).all()
    assert not (out.flags & Flag.BIAS_UNKNOWN).any()
    assert out.delay_ns == 15 * 5_000_000
    followed = build_pipeline(structs.replace(given, denoise=DenoiseParams())).process(turning)
    assert np.degrees(np.ptp(np.unwrap(to_euler(followed.q)[:, 2]))) == pytest.approx(120.0, abs=1.0)
