"""Two chips, two services on one machine, with the same folders: neither touches what is the other's."""

from __future__ import annotations

import json
import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest

from quavelet.recording.reader import RecordingReader
from quavelet.settings import parse_settings

BUSES = {"imu0": "fake:tilt", "imu1": "fake:turntable"}
PATIENCE_S = 30.0


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Settings of two instances that differ in their bus only; short, since a socket's path is."""
    (tmp_path / "run").mkdir()
    (tmp_path / "rec").mkdir()
    for name, bus in BUSES.items():
        (tmp_path / f"{name}.toml").write_text(
            f'[bus]\nname = "{bus}"\n[recording]\ndirectory = "{tmp_path}/rec"\nkeep_free_mb = 0.0\n'
        )
    return tmp_path


@pytest.fixture
def services(folder: Path) -> Iterator[dict[str, subprocess.Popen[bytes]]]:
    environment = {**os.environ, "RUNTIME_DIRECTORY": str(folder / "run"), "STATE_DIRECTORY": str(folder / "run")}
    program = [sys.executable, "-c", "from quavelet.cli.app import main; main()", "run", "--json"]
    with ExitStack() as stack:
        running = {}
        for name in BUSES:
            out = stack.enter_context((folder / f"{name}.jsonl").open("wb"))
            log = stack.enter_context((folder / f"{name}.log").open("wb"))
            command = [*program, "--config", str(folder / f"{name}.toml")]
            running[name] = subprocess.Popen(command, env=environment, stdout=out, stderr=log)
        yield running
        for process in running.values():
            process.kill()
            process.wait()


def asked(path: Path) -> dict[str, object]:
    with socket.socket(socket.AF_UNIX) as connection:
        connection.settimeout(PATIENCE_S)
        connection.connect(str(path))
        connection.sendall(b"status\n")
        answer = b""
        while more := connection.recv(65536):
            answer += more
    told: dict[str, object] = json.loads(answer)
    return told


def wait_for(condition: Callable[[], bool], folder: Path) -> None:
    end = time.monotonic() + PATIENCE_S
    while not condition():
        assert time.monotonic() < end, "".join(path.read_text() for path in folder.glob("*.log"))
        time.sleep(0.05)


def test_two_services_share_folders_and_nothing_in_them(
    folder: Path, services: dict[str, subprocess.Popen[bytes]]
) -> None:
    sockets = {name: folder / "run" / f"{name}.sock" for name in BUSES}
    wait_for(lambda: all(path.exists() for path in sockets.values()), folder)
    wait_for(lambda: all((folder / f"{name}.jsonl").stat().st_size > 20_000 for name in BUSES), folder)
    told = {name: asked(path) for name, path in sockets.items()}
    assert {name: (status["name"], status["src"]) for name, status in told.items()} == {
        name: (name, bus) for name, bus in BUSES.items()
    }

    services["imu0"].send_signal(signal.SIGTERM)
    assert services["imu0"].wait(PATIENCE_S) == 0
    assert not sockets["imu0"].exists()
    assert asked(sockets["imu1"])["name"] == "imu1"
    services["imu1"].send_signal(signal.SIGTERM)
    assert services["imu1"].wait(PATIENCE_S) == 0

    files = {path.name for path in (folder / "run").iterdir() if not path.name.startswith(".")}
    assert {name.partition(".")[0] for name in files} <= set(BUSES)
    recordings = sorted((folder / "rec").iterdir())
    assert [path.name.partition("-")[0] for path in recordings] == ["imu0", "imu1"]
    for path, bus in zip(recordings, BUSES.values(), strict=True):
        reader = RecordingReader(path)
        assert parse_settings(reader.header.settings, where=path.name).bus.name == bus
