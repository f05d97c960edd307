"""stdout is data and nothing else, whatever happens to its reader; a run ends in good order."""

import json
import os
import pty
import signal
import subprocess
from itertools import pairwise
from pathlib import Path

import msgspec
import pytest
from program import NOISE, PROGRAM, quavelet

from hw_fakes import TYPICAL
from quavelet.cli import exits
from quavelet.sinks.message import Message

FIELDS = set(Message.__struct_fields__)


def messages(lines: list[str]) -> list[Message]:
    """Every line is a message with all fields and no other."""
    for line in lines:
        assert set(json.loads(line)) == FIELDS
    return [msgspec.json.decode(line, type=Message) for line in lines]


@pytest.mark.parametrize(
    "command",
    [("run", "--bus", "fake:sway", "--json"), ("run", "--bus", "fake:tilt"), ("demo",)],
    ids=lambda command: " ".join(command),
)
def test_every_line_on_stdout_is_a_message(command: tuple[str, ...]) -> None:
    done = quavelet(*command, "--virtual-time", "--duration", 3)
    assert done.code == exits.OK
    assert 270 <= len(messages(done.lines)) <= 300
    assert {message.src for message in messages(done.lines)} == {command[2] if "--bus" in command else "fake:tilt"}
    assert any("samples from fake:" in line for line in done.said)


def test_a_turn_of_the_table_ends_where_it_began_but_for_the_gyroscopes_scale() -> None:
    done = quavelet("run", "--bus", "fake:turntable", "--virtual-time", "--duration", 30)
    turn = messages(done.lines)
    assert 2950 <= len(turn) <= 3000
    assert max(m.yaw_deg for m in turn) > 175 and min(m.yaw_deg for m in turn) < -175
    assert abs(turn[-1].yaw_deg - 360 * (TYPICAL.gyro_scale[2] - 1)) < 0.5
    assert abs(turn[-1].yaw_deg) < 3 * turn[-1].sigma_deg[2]
    assert turn[-1].flags == []
    assert all(b.t_ns > a.t_ns for a, b in pairwise(turn))


def test_a_replay_gives_the_same_messages_but_for_their_source(recording: Path) -> None:
    live = messages(recording.with_suffix(".jsonl").read_text().splitlines())
    replayed = messages(quavelet("replay", recording).lines)
    assert replayed == [msgspec.structs.replace(m, src=f"replay:{m.src}") for m in live]


def test_every_message_keeps_the_schema_that_config_prints() -> None:
    schema = json.loads(quavelet("config", "--schema").out)
    described = schema["$defs"]["Message"]
    assert set(described["properties"]) == FIELDS
    done = quavelet("run", "--bus", "fake:still", "--virtual-time", "--duration", 0.5)
    for line in done.lines:
        message = json.loads(line)
        assert set(described["required"]) <= set(message) <= set(described["properties"])
        msgspec.convert(message, Message, strict=True)


@pytest.mark.parametrize(
    "command",
    [
        ("run", "--bus", "fake:still", "--virtual-time"),
        ("run", "--bus", "fake:still"),
        ("demo", "--virtual-time"),
        ("replay", "RECORDING"),
        ("doctor", "--bus", "fake:still", "--virtual-time"),
    ],
    ids=lambda command: " ".join(command),
)
def test_a_reader_that_leaves_after_a_line_is_no_failure(command: tuple[str, ...], recording: Path) -> None:
    words = [str(recording) if word == "RECORDING" else word for word in command]
    with subprocess.Popen([PROGRAM, *words], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as running:
        assert running.stdout and running.stderr
        assert running.stdout.readline()
        running.stdout.close()
        said = running.stderr.read()
        assert running.wait(timeout=30) == exits.OK, said
    assert not any(noise in said for noise in (*NOISE, "BrokenPipe")), said


def test_a_reader_that_was_never_there_is_no_failure() -> None:
    read, write = os.pipe()
    os.close(read)
    done = subprocess.run([PROGRAM, "config"], stdout=write, stderr=subprocess.PIPE, text=True, check=False)
    os.close(write)
    assert (done.returncode, done.stderr) == (exits.OK, "")


@pytest.mark.parametrize(("closed", "stream"), [(1, "stdout"), (2, "stderr")])
def test_a_closed_stream_is_no_failure_and_nothing_goes_astray(closed: int, stream: str) -> None:
    command = f"exec {PROGRAM} run --bus fake:still --virtual-time --duration 1 {closed}>&-"
    done = subprocess.run(["sh", "-c", command], capture_output=True, text=True, check=False)
    assert done.returncode == exits.OK, done.stderr
    if stream == "stdout":
        assert "samples from fake:still" in done.stderr
    else:
        assert len(messages(done.stdout.splitlines())) > 50


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_run_in_real_time_ends_on_a_signal_with_its_summary(number: signal.Signals, tmp_path: Path) -> None:
    path = tmp_path / "signal.qrec"
    command = [PROGRAM, "run", "--bus", "fake:tilt", "--record", str(path)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as running:
        assert running.stdout
        first = running.stdout.readline()
        running.send_signal(number)
        rest, said = running.communicate(timeout=30)
    assert running.returncode == exits.OK, said
    assert messages([first, *rest.splitlines()])
    assert "samples from fake:tilt" in said and "loop: " in said
    assert quavelet("replay", path).code == exits.OK


def test_a_terminal_gets_the_panel_and_no_json() -> None:
    ours, theirs = pty.openpty()
    command = [PROGRAM, "run", "--bus", "fake:tilt", "--virtual-time", "--duration", "3"]
    environment = {**os.environ, "TERM": "xterm", "COLUMNS": "80"}
    with subprocess.Popen(command, stdout=theirs, stderr=subprocess.PIPE, env=environment) as running:
        os.close(theirs)
        shown = b""
        try:
            while part := os.read(ours, 4096):
                shown += part
        except OSError:
            pass  # EIO: nobody writes to the terminal any more
        assert running.wait(timeout=30) == exits.OK
    os.close(ours)
    assert b"NOT A REAL CHIP" in shown
    assert b"roll" in shown
    assert b'"v":1' not in shown
