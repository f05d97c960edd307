"""The block law, for every stage: however the rows are split, and wherever the state is saved and restored into a
fresh stage, the output is the same to the last bit."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec import structs

from quavelet.attitude.doubt import Residual
from quavelet.attitude.fusion import FusionFilter
from quavelet.attitude.fusion_literal import LiteralFusionFilter, LiteralParams
from quavelet.attitude.fusion_params import FusionParams
from quavelet.attitude.heading import HeadingParams
from quavelet.attitude.params import FilterParams
from quavelet.attitude.pid import PidFilter, PidParams
from quavelet.attitude.yaw_zero import YawZero, YawZeroState
from quavelet.calibration.calibrate import Calibrate
from quavelet.calibration.model import BiasCurve, ImuCalibration, MagnetometerCalibration
from quavelet.calibration.still_bias import StillBias
from quavelet.core.blocks import (
    AttitudeBlock,
    Flag,
    FloatArray,
    ImuBlock,
    RawBlock,
    Scale,
    YawFrom,
    array_fields,
    concat,
)
from quavelet.denoise.params import DenoiseParams
from quavelet.denoise.stage import Denoise
from quavelet.mpu6050.magnetometer.asked import MagnetometerParams
from quavelet.pipeline import Pipeline, build_pipeline
from quavelet.settings import Settings, StartSettings

SCALE = Scale(gyro_rad_s_per_lsb=np.radians(1 / 65.5), accel_m_s2_per_lsb=9.80665 / 8192, temp_degc_per_lsb=1 / 340,
              temp_degc_at_zero=36.53)  # fmt: skip
TILTED = ImuCalibration(
    gyro_matrix=((1.01, 0.002, -0.003), (0.001, 0.98, 0.004), (0.0, -0.002, 1.02)),
    accel_offset_m_s2=(0.1, -0.2, 0.3),
    accel_matrix=((0.99, 0.001, 0.0), (0.002, 1.01, 0.003), (-0.001, 0.0, 1.005)),
    magnetometer=MagnetometerCalibration(
        hard_iron_ut=(1.0, -2.0, 0.5),
        hard_iron_sigma_ut=(0.3, 0.3, 0.3),
        soft_iron=((1.02, 0.01, -0.02), (0.01, 0.97, 0.03), (-0.02, 0.03, 1.01)),
        field_ut=48.0,
        field_sigma=0.01,
    ),
)
WARM = replace(
    TILTED,
    gyro_bias_curve=BiasCurve(
        reference_degc=25.0,
        coefficients_rad_s=((0.01, 0.02, 0.03), (1e-3, -2e-3, 3e-4), (1e-5, 2e-5, -1e-5)),
        lowest_degc=20.0,
        highest_degc=26.2,
        sigma_rad_s=1e-3,
        slope_sigma_rad_s_degc=1e-5,
    ),
    gyro_per_force=((1e-4, 0.0, 2e-4), (0.0, -1e-4, 0.0), (1e-5, 0.0, 1e-4)),
    highest_degc=26.235,
)
RESIDUAL = Residual(tilt_rad=0.03, gyro_bias_rad_s=2e-4, gyro_bias_rad_s_degc=0.0, gyro_scale=0.02)


def raw_block(seed: int, n: int) -> RawBlock:
    """Counts of a board that is still, moves, is still again; with gaps short and long, and clipping."""
    rng = np.random.default_rng(seed)
    period_s = rng.choice([0.005, 0.01, 0.02])
    moving = (np.arange(n) // max(1, n // rng.integers(1, 6))) % 2 == rng.integers(0, 2)
    gyro = rng.normal(300.0, 3.0, (n, 3)) + moving[:, None] * 4000.0 * np.sin(np.arange(n) / 20.0)[:, None]
    accel = rng.normal([0.0, 800.0, 8100.0], 30.0, (n, 3)) + moving[:, None] * rng.normal(0.0, 1500.0, (n, 3))
    counts = np.column_stack([accel, np.full(n, -3500), gyro]).clip(-32768, 32767).astype(np.int16)
    gap = rng.random(n) < 0.02
    gap_ns = np.where(gap, rng.choice([0, 30_000_000, 400_000_000, 3_000_000_000], n), 0).astype(np.int64)
    step_ns = round(period_s * 1e9) + gap_ns
    return RawBlock(
        t_ns=np.cumsum(step_ns),
        period_s=period_s * rng.uniform(0.999, 1.001, n),
        gap_ns=gap_ns,
        flags=np.where(gap, int(Flag.GAP | Flag.OVERFLOW), 0).astype(np.uint32),
        counts=counts,
        scale=SCALE,
        field_ut=field_of(rng, n),
    )


def field_of(rng: np.random.Generator, n: int) -> FloatArray:
    """Every second row a measurement, some of them beside a magnet."""
    field_ut = np.array([20.0, 5.0, -44.0]) + rng.normal(0.0, 0.3, (n, 3))
    field_ut[(np.arange(n) // 50) % 6 == 5] += [25.0, 0.0, 10.0]
    field_ut[1::2] = np.nan
    return field_ut


def imu_block(seed: int, n: int, *, bias_unknown: bool = True) -> ImuBlock:
    calibration = ImuCalibration() if bias_unknown else ImuCalibration(gyro_bias_rad_s=(0.01, 0.02, -0.01))
    return Calibrate(calibration).process(raw_block(seed, n))


def levelled_block(seed: int, n: int) -> ImuBlock:
    return StillBias(window_s=0.5).process(imu_block(seed, n))


def stuck_at_times_block(seed: int, n: int) -> ImuBlock:
    block = levelled_block(seed, n)
    stuck = np.sin(np.arange(n) / 17.0 + seed) > 0.7
    return replace(block, flags=np.where(stuck, block.flags | np.uint32(Flag.STUCK), block.flags))


def denoised(**params):
    asked = DenoiseParams(**params)
    return stuck_at_times_block, lambda: Denoise(
        asked.build(), sample_rate_hz=200.0, keeps_slow_motion=asked.keeps_slow_motion
    )


QUICK = Settings(start=StartSettings(still_s=0.5), filter=FilterParams(kind="pid", kp=1.0, ki=0.1, kd=0.3))
NORTH = Settings(
    magnetometer=MagnetometerParams(use="auto"),
    start=StartSettings(gyro_bias_dps=(4.6, 4.6, 4.6)),
    filter=FilterParams(kind="pid", kp=10.0),
    heading=HeadingParams(hard_iron_ut=(1.0, -2.0, 0.5), declination_deg=3.0, tau_s=0.5),
)


BIAS_GIVEN = Settings(start=StartSettings(gyro_bias_dps=(4.6, 4.6, 4.6)))


def attitude_block(seed: int, n: int) -> AttitudeBlock:
    """Relative up to a first fix, or, in every second one, throughout."""
    block = build_pipeline(BIAS_GIVEN if seed % 2 else NORTH, calibration=TILTED).process(raw_block(seed, n))
    return replace(block, sigma_rad=block.sigma_rad * [1.0, 1.5, 1.0])


def zeroed() -> YawZero:
    stage = YawZero()
    stage.restore(YawZeroState(zero_rad=2.0, before_rad=0.1))
    return stage


def undone() -> YawZero:
    stage = zeroed()
    stage.undo()
    return stage


def zeroed_pipeline() -> Pipeline:
    pipeline = build_pipeline(BIAS_GIVEN, calibration=TILTED)
    pipeline.process(raw_block(3, 300))
    pipeline.zero_yaw()
    return pipeline


def replace_heading(settings: Settings, **params) -> Settings:
    return structs.replace(settings, heading=HeadingParams(**params))


def replace_denoise(settings: Settings, **params) -> Settings:
    return structs.replace(settings, denoise=DenoiseParams(**params))


STAGES = {
    "calibrate": (raw_block, lambda: Calibrate(TILTED)),
    "calibrate over temperature": (raw_block, lambda: Calibrate(WARM)),
    "still bias": (imu_block, lambda: StillBias(window_s=0.5)),
    "still bias of what is left": (imu_block, lambda: StillBias(window_s=0.5, refine=True)),
    "pid, bias unknown then known": (levelled_block, lambda: PidFilter(PidParams(), residual=RESIDUAL)),
    "pid with all terms": (
        lambda seed, n: imu_block(seed, n, bias_unknown=False),
        lambda: PidFilter(PidParams(kp=1.0, ki=0.1, kd=0.5, method="exp"), residual=RESIDUAL),
    ),
    "wavelet": denoised(kind="wavelet"),
    "wavelet, improved, each level's noise": denoised(
        kind="wavelet", wavelet="haar", levels=3, shrink="improved", alpha=1.5, noise="level", threshold="level_scaled"
    ),
    "wavelet, power": denoised(kind="wavelet", levels=1, shrink="power", k=3.0),
    "low-pass": denoised(kind="lowpass"),
    "details alone": denoised(kind="details"),
    "details, shrunk": denoised(kind="details-shrunk"),
    "median": denoised(kind="median", window=7),
    "hampel": denoised(kind="hampel"),
    "smoother": denoised(kind="smoother"),
    "the whole pipeline, denoised": (
        raw_block,
        lambda: build_pipeline(replace_denoise(QUICK, kind="wavelet", levels=1), calibration=TILTED),
    ),
    "fusion, bias unknown then known": (levelled_block, lambda: FusionFilter(FusionParams(), residual=RESIDUAL)),
    "fusion by gravity alone": (
        lambda seed, n: imu_block(seed, n, bias_unknown=False),
        lambda: FusionFilter(FusionParams(model="gravity", norm_gate=0.03), residual=RESIDUAL),
    ),
    "fusion as written": (levelled_block, lambda: LiteralFusionFilter(LiteralParams(), residual=RESIDUAL)),
    "gated, bias unknown then known": (levelled_block, lambda: FilterParams(relearn_s=5.0).build(residual=RESIDUAL)),
    "gated, a known bias that is wrong": (
        lambda seed, n: imu_block(seed, n, bias_unknown=False),
        lambda: FilterParams(method="exp").build(residual=RESIDUAL),
    ),
    "velocity": (levelled_block, lambda: FilterParams(kind="velocity", tau_s=2.0).build(residual=RESIDUAL)),
    "gyro": (levelled_block, lambda: FilterParams(kind="gyro").build(residual=RESIDUAL)),
    "accelerometer": (levelled_block, lambda: FilterParams(kind="accelerometer").build(residual=RESIDUAL)),
    "the whole pipeline with heading": (raw_block, lambda: build_pipeline(NORTH, calibration=TILTED)),
    "the whole pipeline with heading by the chip's calibration": (
        raw_block,
        lambda: build_pipeline(replace_heading(NORTH, declination_deg=3.0, tau_s=0.5), calibration=TILTED),
    ),
    "yaw zero that was not asked for": (attitude_block, YawZero),
    "yaw zero": (attitude_block, zeroed),
    "yaw zero undone": (attitude_block, undone),
    "the whole pipeline, yaw set to zero": (raw_block, zeroed_pipeline),
    "the whole pipeline": (raw_block, lambda: build_pipeline(QUICK, calibration=TILTED)),
    "the whole pipeline, calibrated over temperature": (raw_block, lambda: build_pipeline(QUICK, calibration=WARM)),
    "the pipeline as it is by default": (raw_block, lambda: build_pipeline(Settings(), calibration=TILTED)),
}


def assert_identical(a, b):
    for name in array_fields(type(a)):
        x, y = getattr(a, name), getattr(b, name)
        assert x.dtype == y.dtype, name
        assert x.tobytes() == y.tobytes(), name


@pytest.mark.parametrize("stage", STAGES)
@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 10**6), data=st.data())
def test_any_split_and_any_restore_give_the_same_bits(stage, seed, data):
    make_block, make_stage = STAGES[stage]
    n = data.draw(st.integers(1, 400))
    block = make_block(seed, n)
    whole = make_stage().process(block)
    cuts = sorted(data.draw(st.lists(st.integers(0, n), max_size=8)))
    current, pieces = make_stage(), []
    for start, end in zip([0, *cuts], [*cuts, n], strict=True):
        if data.draw(st.booleans()):
            saved, current = current.state(), make_stage()
            current.restore(saved)
        pieces.append(current.process(block[start:end]))
    assert_identical(whole, concat(pieces))


@pytest.mark.parametrize("stage", STAGES)
def test_one_sample_at_a_time_is_the_same_as_all_at_once(stage):
    make_block, make_stage = STAGES[stage]
    block = make_block(7, 1500)
    whole, current = make_stage().process(block), make_stage()
    assert_identical(whole, concat([current.process(block[k : k + 1]) for k in range(len(block))]))


@pytest.mark.parametrize("stage", STAGES)
def test_a_state_is_not_changed_by_going_on(stage):
    """A saved state must be a value: restoring it twice gives the same both times."""
    make_block, make_stage = STAGES[stage]
    block = make_block(11, 600)
    current = make_stage()
    current.process(block[:300])
    saved = current.state()
    first = current.process(block[300:])
    current.restore(saved)
    assert_identical(first, current.process(block[300:]))


def test_the_law_is_tested_where_it_matters():
    """The blocks really go through stillness, a known bias, gaps and settling; else the law above is empty."""
    block = levelled_block(7, 1500)
    out = PidFilter(PidParams(), residual=RESIDUAL).process(block)
    for flag in (Flag.GAP, Flag.BIAS_UNKNOWN, Flag.SETTLING):
        set_rows = (out.flags & flag) != 0
        assert set_rows.any(), flag
        assert not set_rows.all(), flag
    assert out.still.any()
    assert not out.still.all()


def test_a_zero_of_yaw_holds_and_is_dropped_within_the_blocks_of_the_law():
    held = dropped = 0
    for seed in range(6):
        block, stage = attitude_block(seed, 400), zeroed()
        out = stage.process(block)
        changed = (out.q != block.q).any(axis=1)
        held, dropped = held + int(changed.sum()), dropped + (not stage.is_set)
    assert held > 200 and 0 < dropped < 6


def test_heading_is_found_and_withheld_within_the_blocks_of_the_law():
    flags, origins = 0, set[int]()
    for seed in range(5):
        out = build_pipeline(NORTH, calibration=TILTED).process(raw_block(seed, 400))
        flags |= int(np.bitwise_or.reduce(out.flags[out.yaw_from == YawFrom.TRUE], initial=0))
        origins |= set(out.yaw_from.tolist())
    assert origins == {YawFrom.RELATIVE, YawFrom.TRUE}
    assert flags & Flag.FIELD_DISTURBED
