"""The programs of the room's README run, and what they print is of use."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

import quavelet.core.clock
from quavelet.core.clock import VirtualClock
from quavelet.settings import load_settings

ROOM = Path(__file__).resolve().parents[2] / "src/quavelet/mpu6050"
README = (ROOM / "README.md").read_text(encoding="utf-8")
LOW_POWER, OFFSETS = re.findall(r"```python\n(.*?)```", README, re.DOTALL)


@pytest.fixture
def printed(monkeypatch):
    monkeypatch.setattr(quavelet.core.clock, "MonotonicClock", VirtualClock)

    def run(program: str) -> str:
        lines: list[str] = []
        exec(compile(program, "README.md", "exec"), {"print": lambda *words: lines.append(" ".join(map(str, words)))})
        return "\n".join(lines)

    return run


def test_program_for_a_battery_reads_gravity_and_hears_of_motion(printed):
    text = printed(LOW_POWER)
    assert text.startswith("m/s^2: (")
    assert text.endswith("moved")
    assert "still" in printed(LOW_POWER.replace("fake:walk", "fake:still"))


def test_program_for_offsets_prints_a_settings_file(printed, tmp_path):
    path = tmp_path / "imu.toml"
    path.write_text(printed(OFFSETS))
    plan = load_settings(path).settings.offsets.plan()
    assert plan is not None
    assert plan.gyro != plan.gyro_factory


def test_every_module_the_readme_names_is_there():
    for name in re.findall(r"`([a-z_]+)\.[A-Za-z_]+`", README):
        assert (ROOM / f"{name}.py").exists() or name == "quavelet", name
