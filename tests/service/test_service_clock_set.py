"""The program in real time, while CLOCK_REALTIME as it sees it is set: by a shim, as nobody may set this one."""

from __future__ import annotations

import os
import shutil
import signal
import socket
import struct
import subprocess
import sys
import time
from itertools import pairwise
from pathlib import Path

import msgspec
import pytest

from quavelet.core.units import NS_PER_S
from quavelet.recording.mcap import offset_of
from quavelet.recording.reader import RecordingReader
from quavelet.sinks.message import Message

COMPILER = shutil.which("cc") or shutil.which("gcc")
SHIM = Path(__file__).with_name("wall_clock_shim.c")
pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(COMPILER is None, reason="no C compiler: apt install gcc libc6-dev"),
]


@pytest.mark.parametrize("step_s", [3600, -3600, 20 * 365 * 86_400])
def test_the_program_goes_on_while_its_clock_is_set(step_s: int, tmp_path: Path) -> None:
    assert COMPILER is not None
    shim, offset, records = tmp_path / "shim.so", tmp_path / "offset", tmp_path / "records"
    subprocess.run([COMPILER, "-shared", "-fPIC", "-O1", "-o", str(shim), str(SHIM)], check=True)
    offset.write_bytes(struct.pack("=q", 0))
    records.mkdir()
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
        sock.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4_000_000)
        sock.bind(("127.0.0.1", 0))
        config = tmp_path / "imu.toml"
        config.write_text(
            f'[recording]\ndirectory = "{records}"\nkeep_free_mb = 0.0\n'
            f'[output.db]\nto = "udp:127.0.0.1:{sock.getsockname()[1]}"\nencoding = "influx"\nrate_hz = 10.0\n'
        )
        out, talk = tmp_path / "out", tmp_path / "talk"
        environment = {
            **os.environ,
            "PYTHONPATH": os.pathsep.join(sys.path),
            "LD_PRELOAD": str(shim),
            "WALL_CLOCK_FILE": str(offset),
        }
        command = [sys.executable, "-c", "from quavelet.cli.app import main; main()"]
        options = ["run", "--bus", "fake:tilt", "--config", str(config), "--json"]
        with out.open("wb") as stdout, talk.open("wb") as stderr:
            program = subprocess.Popen([*command, *options], env=environment, stdout=stdout, stderr=stderr)
            try:
                # Real time: the program has no clock but the machine's.
                time.sleep(6.0)
                with offset.open("r+b") as file:
                    file.write(struct.pack("=q", step_s * NS_PER_S))
                time.sleep(4.0)
                program.send_signal(signal.SIGTERM)
                assert program.wait(timeout=20.0) == 0, talk.read_text()
            finally:
                program.kill()
                program.wait()
        sock.setblocking(False)
        told_s = []
        try:
            while True:
                told_s.append(int(sock.recv(65_536).split()[-1]) / NS_PER_S)
        except BlockingIOError:
            pass
    said = [line for line in talk.read_text().splitlines() if "time of day was set" in line]
    assert len(said) == 1 and f"set {'forward' if step_s > 0 else 'back'} by" in said[0]
    (jump,) = [b - a for a, b in pairwise(told_s) if abs(b - a) > 600.0]
    assert jump == pytest.approx(step_s, abs=2.0)
    messages = [msgspec.json.decode(line, type=Message) for line in out.read_bytes().splitlines()]
    times_ns = [message.t_ns for message in messages]
    assert times_ns == sorted(set(times_ns))
    assert times_ns[-1] - times_ns[0] < 20 * NS_PER_S
    assert not any(message.gap_ns > NS_PER_S // 2 for message in messages)
    before, after = sorted(records.iterdir())
    moved_ns = offset_of(RecordingReader(after).header) - offset_of(RecordingReader(before).header)
    assert moved_ns / NS_PER_S == pytest.approx(step_s, abs=0.1)
