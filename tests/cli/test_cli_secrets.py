"""No password is shown or logged, whatever command is given it."""

from __future__ import annotations

import os
import subprocess
import time
from pathlib import Path

import pytest
from program import PROGRAM, quavelet

from quavelet.cli import exits
from quavelet.core.errors import SettingsError
from quavelet.settings import load_settings

SECRET = "Tr0ub4dor-and-3"


@pytest.fixture
def config(tmp_path: Path) -> Path:
    """Settings with an output to a broker that is not there."""
    password = tmp_path / "password"
    password.write_text(f"{SECRET}\n")
    path = tmp_path / "imu.toml"
    path.write_text(
        '[bus]\nname = "fake:tilt"\n[output.home]\nto = "mqtt:127.0.0.1:1"\n'
        f'[output.home.mqtt]\nuser = "imu"\npassword_file = "{password}"\n'
    )
    return path


def test_the_settings_are_shown_with_the_passwords_path_only(config: Path) -> None:
    for more in ((), ("--json",)):
        done = quavelet("config", "--config", config, *more)
        assert done.code == exits.OK, done.err
        assert "password" in done.out
        assert SECRET not in done.out + done.err


def test_a_run_with_a_broker_that_is_away_does_not_tell_the_password(config: Path, tmp_path: Path) -> None:
    recording = tmp_path / "a.qrec"
    done = quavelet("--verbose", "run", "--config", config, "--duration", 1, "--json", "--record", recording)
    assert SECRET not in done.out + done.err
    assert SECRET.encode() not in recording.read_bytes()


def test_the_status_of_a_service_does_not_tell_the_password(config: Path, tmp_path: Path) -> None:
    environment = {**os.environ, "RUNTIME_DIRECTORY": str(tmp_path)}
    with (tmp_path / "log").open("wb") as log:
        service = subprocess.Popen(
            [PROGRAM, "--verbose", "run", "--config", config], env=environment, stdout=subprocess.DEVNULL, stderr=log
        )
        try:
            end = time.monotonic() + 30
            while not (tmp_path / "imu.sock").exists() and time.monotonic() < end:
                time.sleep(0.05)
            while time.monotonic() < end:
                asked = [quavelet("status", tmp_path / "imu.sock", *more) for more in ((), ("--json",))]
                if all(done.code == exits.OK and "home" in done.out for done in asked):
                    break
        finally:
            service.terminate()
            service.wait(20)
    assert all("127.0.0.1:1" in done.out for done in asked), asked
    assert not any(SECRET in done.out + done.err for done in asked)
    assert SECRET not in (tmp_path / "log").read_text()


@pytest.mark.parametrize(
    "line", [f'to = "mqtt://imu:{SECRET}@here"', f'to = "mqtt:imu:{SECRET}@here:1"', f'to = "mqtts:{SECRET}@here"']
)
def test_a_password_in_an_address_is_refused_and_not_shown(line: str, tmp_path: Path) -> None:
    path = tmp_path / "imu.toml"
    path.write_text(f"[output.home]\n{line}\n")
    with pytest.raises(SettingsError) as told:
        load_settings(path)
    assert SECRET not in str(told.value)
    assert "***@here" in str(told.value)


def test_a_password_in_the_file_itself_is_refused_and_not_shown(tmp_path: Path) -> None:
    path = tmp_path / "imu.toml"
    path.write_text(f'[output.home]\nto = "mqtt:here"\n[output.home.mqtt]\nuser = "imu"\npassword = "{SECRET}"\n')
    with pytest.raises(SettingsError) as told:
        load_settings(path)
    (line,) = str(told.value).splitlines()
    assert "unknown key output.home.mqtt.password: did you mean password_file?" in line
    assert SECRET not in line


def test_all_mistakes_are_told_a_line_each(tmp_path: Path) -> None:
    path = tmp_path / "imu.toml"
    path.write_text("[chip]\ndlpf = 9\n[loop]\nrate_hz = 0.0\npriorty = 1\n")
    done = quavelet("run", "--config", path)
    assert done.code == exits.SETTINGS
    assert [line.startswith(f"quavelet: {path}: ") for line in done.said] == [True] * 3
