"""The page of a calibration says first what became of it, and has a part for all that was measured."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest

from quavelet.bench.session_evidence import Chip, Evidence, StillRun
from quavelet.bench.session_report import write_report
from quavelet.bench.session_result import Result, work_out
from quavelet.bench.session_verdict import verdict
from quavelet.calibration.record import ChipIdentity
from quavelet.core.blocks import Scale
from quavelet.core.units import RAD_PER_DEG, STANDARD_GRAVITY_M_S2

FIELD_UT, HARD_IRON_UT = 48.0, (14.0, -22.0, 9.0)
PERIOD_S = 0.01


@pytest.fixture(scope="module")
def result() -> Result:
    """A board that lay still for two minutes, and was turned through all directions."""
    rng = np.random.default_rng(3)
    scale = Scale(
        accel_m_s2_per_lsb=STANDARD_GRAVITY_M_S2 / 8192.0,
        gyro_rad_s_per_lsb=RAD_PER_DEG / 65.5,
        temp_degc_per_lsb=1 / 340,
        temp_degc_at_zero=36.53,
    )
    counts = np.round(rng.normal([0, 0, 8192, 60, -20, 5], [25, 25, 25, 3, 3, 3], (12_000, 6))).astype(np.int16)
    ways = rng.normal(size=(600, 3))
    field = FIELD_UT * ways / np.linalg.norm(ways, axis=1)[:, None] + HARD_IRON_UT
    evidence = Evidence(
        chip=Chip(
            identity=ChipIdentity(who_am_i=0x68, name="MPU-6050", bus="linux:1", address=0x68),
            gyro_range_dps=500,
            accel_range_g=4,
            scale=scale,
        ),
        still=[StillRun(period_s=PERIOD_S, counts=counts.tobytes())],
        field_ut=[tuple(row) for row in field.tolist()],
    )
    return work_out(evidence, utc="2026-01-02T03:04:05Z", version="0")


def page_of(result: Result, path, **said: str | None) -> str:
    told = {"src": "linux:1", "verdict": "good", "saved": "board.toml", "reason": "", **said}
    write_report(path / "page.html", result, verdict(result), **told)
    return (path / "page.html").read_text()


def words_of(page: str) -> list[str]:
    return [re.sub("<[^>]*>", "", text) for text in re.findall(r"<p>.*?</p>", page)]


@pytest.mark.parametrize(
    ("said", "first"),
    [
        ({}, "Good, and saved as board.toml."),
        ({"verdict": "worse", "saved": "a.toml"}, "Worse, and all the same saved as a.toml."),
        ({"saved": None, "reason": "not good enough: magnetometer"}, "Not good enough: magnetometer."),
    ],
)
def test_the_first_words_say_what_became_of_it(result, tmp_path, said, first):
    assert words_of(page_of(replace(result, noise=(), field=None), tmp_path, **said))[0] == first


def test_noise_and_field_are_drawn_with_their_figures(result, tmp_path):
    page = page_of(result, tmp_path)
    titles = re.findall('aria-label="([^"]*)"', page)
    assert titles == [
        *(f"Magnetic field, {pair}" for pair in ("x and y", "x and z", "y and z")),
        *(f"Allan deviation of the {sensor} at rest" for sensor in ("gyroscope", "accelerometer")),
    ]
    text = re.sub("<[^>]*>", " ", page)
    assert re.search(r"The field here is 48\.\d uT strong", text)
    for axis, hard in zip("xyz", HARD_IRON_UT, strict=True):
        assert re.search(rf" {axis}\s+{re.escape(f'{hard:+.2f}')} ", text)
    density = 3 * RAD_PER_DEG / 65.5 * (2.0 * PERIOD_S) ** 0.5
    found = re.search(r"The gyroscope&#x27;s density in SI: x (\S+), y \S+, z \S+ rad/s/rtHz", text)
    assert found is not None
    assert float(found[1]) == pytest.approx(density, rel=0.1)
    figures = {name: value for one in verdict(result) for name, value in one.figures.items()}
    assert figures["density_dps_rthz"] == pytest.approx(density / RAD_PER_DEG, rel=0.1)
    assert figures["after_percent"] < 1.0 < figures["before_percent"]
    assert len(page) < 500_000, "to be sent to somebody"
