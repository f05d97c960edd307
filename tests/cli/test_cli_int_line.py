"""The data-ready line from the settings file: in use, told by the doctor, refused where it is none."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from program import quavelet

from quavelet.cli import exits

FAKE = ("--bus", "fake:still", "--virtual-time")


@pytest.fixture
def wired(tmp_path: Path) -> Path:
    path = tmp_path / "imu.toml"
    path.write_text('[bus]\nint_line = "fake:int"\n')
    return path


def test_a_run_with_a_line_gives_other_times_than_one_without_and_complains_of_nothing(wired: Path) -> None:
    plain = quavelet("run", *FAKE, "--duration", 3, "--json")
    pulsed = quavelet("run", *FAKE, "--duration", 3, "--json", "--config", wired)
    assert (plain.code, pulsed.code) == (exits.OK, exits.OK)
    assert not any(" x " in line for line in pulsed.said)
    times = [[json.loads(line)["t_ns"] for line in done.lines] for done in (plain, pulsed)]
    assert len(times[0]) > 200
    assert times[0][-50:] != times[1][-50:]


def test_the_doctor_tells_of_the_line(wired: Path) -> None:
    done = quavelet("doctor", *FAKE, "--config", wired)
    assert done.code == exits.OK, done.out
    assert any(line.startswith("ok   data-ready line") for line in done.lines)


def test_a_line_that_is_none_is_one_sentence(tmp_path: Path) -> None:
    path = tmp_path / "imu.toml"
    path.write_text('[bus]\nint_line = "pinctrl-rp1:17"\n')
    done = quavelet("run", *FAKE, "--config", path)
    assert (done.code, done.out) == (exits.SETTINGS, "")
    assert done.said == ["quavelet: there is no line 'pinctrl-rp1:17' at a fake bus: write fake:int"]
