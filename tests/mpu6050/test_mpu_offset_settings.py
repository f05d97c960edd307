"""Offsets that were measured, kept in the settings file and used: right after a brown-out too, or refused by name."""

from __future__ import annotations

import tomllib
from dataclasses import replace
from pathlib import Path

import msgspec
import numpy as np
import pytest
from chip_rig import ADDRESS
from hypothesis import given
from hypothesis import strategies as st

from hw_fakes import NOISE_ONLY, FakeBus, FakeMpu6050, Still
from hw_fakes.chip import personalities as fakes
from hw_fakes.faults.plan import parse
from quavelet.cli.config import as_toml
from quavelet.core.blocks import concat
from quavelet.core.clock import VirtualClock
from quavelet.core.errors import CalibrationError, SettingsError
from quavelet.core.health import Health
from quavelet.core.units import NS_PER_S
from quavelet.imu import Imu
from quavelet.mpu6050.access import RegisterAccess
from quavelet.mpu6050.offset_plan import OffsetPlan
from quavelet.mpu6050.offset_settings import OffsetSettings, measured_as_toml
from quavelet.mpu6050.offsets import write_offsets
from quavelet.mpu6050.variants import VARIANTS
from quavelet.settings import LoadedSettings, Settings, load_settings, parse_settings

G = 9.80665
BIASED = replace(
    NOISE_ONLY,
    gyro_bias_rad_s=tuple(np.radians((-7.3, 2.71, 15.9)).tolist()),
    accel_bias_m_s2=(0.043 * G, -0.0171 * G, 0.0793 * G),
)
PLAN = OffsetPlan(0x68, (-2100, 801, 1200), (0, 0, 0), (-2188, 837, 1038), (239, -89, -522))
TEXT = measured_as_toml(PLAN)


class Board:
    """A chip lying flat, with biases."""

    def __init__(self, personality=fakes.MPU6050, **kwargs):
        self.clock = VirtualClock()
        self.chip = FakeMpu6050(
            self.clock, motion=Still(), imperfections=BIASED, personality=personality, seed=2, **kwargs
        )
        self.bus = FakeBus({ADDRESS: self.chip}, clock=self.clock, name="fake:offsets")
        self.variant = VARIANTS[personality.who_am_i]

    def measured(self):
        access = RegisterAccess(self.bus, address=ADDRESS, clock=self.clock, health=Health())
        return write_offsets(access, variant=self.variant, clock=self.clock, lies_g=(0.0, 0.0, 1.0)).plan

    def shows(self, imu, seconds=2.0):
        """Means of what the source gives over the last half of some seconds: accelerometer in g, gyroscope in deg/s."""
        end_ns, blocks = self.clock.now_ns() + round(seconds * NS_PER_S), []
        while self.clock.now_ns() < end_ns:
            self.clock.advance_ns(10_000_000)
            blocks.append(imu.source.read())
        got = concat([block for block in blocks if len(block)])
        counts = got.counts[len(got) // 2 :].astype(float).mean(axis=0)
        return counts[:3] * got.scale.accel_m_s2_per_lsb / G, np.degrees(counts[4:] * got.scale.gyro_rad_s_per_lsb)

    def words(self):
        at = (*self.variant.accel_offsets, *(0x13, 0x15, 0x17))
        addresses = [getattr(a, "address", a) for a in at]
        return tuple(int.from_bytes(self.chip.registers[a : a + 2], "big", signed=True) for a in addresses)


def written(tmp_path: Path, text: str) -> Path:
    path = tmp_path / "imu.toml"
    path.write_text(text)
    return path


@pytest.mark.parametrize("personality", [fakes.MPU6050, fakes.MPU6500], ids=lambda p: p.name)
def test_offsets_measured_once_are_right_in_every_run_and_after_a_brown_out(personality, tmp_path):
    plan = Board(personality).measured()
    settings = load_settings(written(tmp_path, measured_as_toml(plan))).settings
    assert settings.offsets.plan() == plan
    board = Board(personality)
    factory = board.words()[:3]
    with Imu(board.bus, settings=settings, clock=board.clock) as imu:
        for fault in (None, "brown-out"):
            if fault:
                board.bus.adapter.faults.add(parse(fault))
            accel_g, gyro_dps = board.shows(imu)
            assert accel_g == pytest.approx((0, 0, 1), abs=3 / 2048)
            assert gyro_dps == pytest.approx((0, 0, 0), abs=2 / 32.8)
            assert board.words() == (*plan.accel, *plan.gyro)
            assert [word & 1 for word in board.words()[:3]] == [word & 1 for word in factory]
        assert imu.health.chip_restarts == 1


def test_without_offsets_the_chip_keeps_the_factorys():
    board = Board()
    before = board.words()
    with Imu(board.bus, settings=Settings(), clock=board.clock) as imu:
        accel_g, gyro_dps = board.shows(imu)
    assert board.words() == before
    assert gyro_dps == pytest.approx((-7.3, 2.71, 15.9), abs=0.05)
    assert accel_g == pytest.approx((0.043, -0.0171, 1.0793), abs=0.005)


def test_offsets_of_another_part_are_refused_before_a_sample_comes(tmp_path):
    board = Board(accel_trim=(-2102, 801, 1200))
    settings = load_settings(written(tmp_path, TEXT)).settings
    with (
        pytest.raises(CalibrationError, match="measured on one that holds"),
        Imu(board.bus, settings=settings, clock=board.clock) as imu,
    ):
        board.shows(imu)


words = st.integers(-32768, 32767)
three = st.tuples(words, words, words)


@given(st.integers(1, 255), three, three, three, three)
def test_a_plan_and_its_text_are_the_same(who_am_i, accel_factory, gyro_factory, accel, gyro):
    accel = tuple(a & ~1 | f & 1 for a, f in zip(accel, accel_factory, strict=True))
    plan = OffsetPlan(who_am_i, accel_factory, gyro_factory, accel, gyro)
    settings = parse_settings(tomllib.loads(measured_as_toml(plan)), where="text")
    assert settings.offsets.plan() == plan
    shown = as_toml(LoadedSettings(settings, dict.fromkeys(load_settings().origin, "text")))
    assert parse_settings(tomllib.loads(shown), where="shown") == settings


def test_config_shows_them_with_their_origin(tmp_path):
    path = written(tmp_path, TEXT)
    shown = as_toml(load_settings(path)).split("\n\n")
    (table,) = [lines.splitlines() for lines in shown if lines.startswith("[offsets]")]
    assert [line.partition("#")[0].strip() for line in table[1:3]] == [
        "who_am_i = 0x68",
        "accel_factory = [-2100,801,1200]",
    ]
    assert all(line.endswith(f"# {path}") for line in table[1:])


def test_none_is_the_default():
    assert Settings().offsets == OffsetSettings()
    assert OffsetSettings().plan() is None


@pytest.mark.parametrize(
    ("key", "value", "says"),
    [
        ("accel", "[]", "accel is missing"),
        ("gyro_factory", "[]", "gyro_factory is missing"),
        ("accel", "[-2188, 837]", r"accel = \[-2188, 837\] .* three"),
        ("gyro", "[0, 0, 40000]", r"gyro = .* 16 bits"),
        ("accel_factory", '["a", 1, 2]', r"offsets\.accel_factory\[0\]: Expected `int`"),
        ("accel", "[1.5, 2, 3]", r"offsets\.accel\[0\]: Expected `int`"),
        ("accel", "[-2187, 837, 1038]", r"bit 0 of accel"),
        ("who_am_i", "0", "who_am_i = 0 does not fit"),
        ("who_am_i", "300", "who_am_i = 300 does not fit"),
    ],
)
def test_what_cannot_be_is_an_error_that_names_file_and_key(key, value, says, tmp_path):
    lines = [f"{key} = {value}" if line.startswith(f"{key} ") else line for line in TEXT.splitlines()]
    path = written(tmp_path, "\n".join(lines))
    with pytest.raises(SettingsError, match=says) as caught:
        load_settings(path)
    assert str(path) in str(caught.value)
    assert "offsets" in str(caught.value)


def test_who_am_i_without_a_plan_is_refused():
    with pytest.raises(SettingsError, match="who_am_i = 104"):
        OffsetSettings(who_am_i=0x68)


def test_misspelt_key_is_named(tmp_path):
    with pytest.raises(SettingsError, match=r"unknown key offsets\.acel"):
        load_settings(written(tmp_path, "[offsets]\nacel = [1, 2, 3]\n"))


def test_settings_of_offsets_are_plain_data():
    settings = msgspec.convert(tomllib.loads(TEXT)["offsets"], OffsetSettings)
    assert msgspec.convert(msgspec.to_builtins(settings), OffsetSettings) == settings
