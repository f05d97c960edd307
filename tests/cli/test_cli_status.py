"""`quavelet status` and `watch` ask a service that runs, and say what to do where none can be asked."""

import json
import os
import signal
import subprocess
import time
from collections.abc import Iterator
from pathlib import Path

import msgspec
import pytest
from program import PROGRAM, quavelet

from quavelet.cli import exits
from quavelet.cli.status_words import in_words
from quavelet.loop.deadline import LoopStats
from quavelet.sinks.status import ClockStatus, LatencyStatus, OutputStatus, RecordingStatus, Status

BOUND_S = 30.0


@pytest.fixture(scope="module")
def service(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """The socket of a service on the fake chip that runs in real time."""
    folder = tmp_path_factory.mktemp("service")
    path = folder / "roof.sock"
    config = folder / "roof.toml"
    config.write_text(
        f'[bus]\nname = "fake:tilt"\n[service]\nsocket = "{path}"\n[output.plotter]\nto = "udp:127.0.0.1:9"\n'
        "[loop]\npriority = 0\n"
    )
    with subprocess.Popen([PROGRAM, "run", "--config", config, "--json"], stdout=subprocess.DEVNULL) as running:
        end_s = time.monotonic() + BOUND_S
        while not path.exists():
            assert time.monotonic() < end_s and running.poll() is None
            time.sleep(0.02)
        yield path
        running.send_signal(signal.SIGTERM)
        assert running.wait(BOUND_S) == 0
    assert not path.exists()


def test_status_says_on_one_screen_how_it_is(service: Path) -> None:
    done = quavelet("status", service)
    assert (done.code, done.err) == (exits.OK, "")
    assert done.lines[0].startswith("roof: ")
    assert "NOT A REAL CHIP" in done.lines[0]
    assert len(done.lines) <= 24
    assert any("plotter json udp:127.0.0.1:9: sending to" in line for line in done.lines)


def test_status_as_json_is_the_status(service: Path) -> None:
    done = quavelet("status", service, "--json")
    assert done.code == exits.OK
    status = msgspec.json.decode(done.out, type=Status)
    assert (status.name, status.src, status.outputs[0].name) == ("roof", "fake:tilt", "plotter")


def test_watch_gives_messages_and_ends_quietly_with_its_reader(service: Path) -> None:
    with subprocess.Popen(
        [PROGRAM, "watch", service, "--rate", "20"], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as watching:
        assert watching.stdout is not None and watching.stderr is not None
        times = [json.loads(watching.stdout.readline())["t_ns"] for _ in range(5)]
        watching.stdout.close()
        assert watching.wait(BOUND_S) == exits.OK
        assert watching.stderr.read() == ""
    assert times == sorted(set(times))


def test_a_service_that_is_not_there_is_one_sentence(tmp_path: Path) -> None:
    for command in ("status", "watch"):
        done = quavelet(command, tmp_path / "none.sock")
        assert (done.code, done.out) == (exits.FAILED, "")
        assert "is not there: start the service" in done.said[0]
    env = {**os.environ, "XDG_RUNTIME_DIR": str(tmp_path)}
    done = quavelet("status", "nobody-has-this-name", env=env)
    assert "no service nobody-has-this-name is found" in done.said[0]
    assert len(done.said) == 1


WELL = Status(
    name="imu0",
    src="linux:1",
    fake=False,
    chip="MPU-6050",
    address=0x68,
    version="1",
    uptime_s=100_000.0,
    state="running",
    rate_hz=200.0,
    health={"samples": 100, "a_counter_of_the_future": 3},
    loop=LoopStats(1_000, 0, 1, 1, 1, 1, 1, 1),
    latency=LatencyStatus(count=1, p50_ns=1, p99_ns=1, max_ns=1),
    clock=ClockStatus(offset_ns=0, synchronised=True),
    pid=1,
)
OUTPUT = OutputStatus(name="x", to="unix:/run/x.sock", encoding="json", state="listening on /run/x.sock")


def replaced(**fields: object) -> list[str]:
    return list(in_words(msgspec.structs.replace(WELL, **fields)))


def test_a_service_that_is_well_is_said_to_be() -> None:
    assert list(in_words(WELL))[-1] == "all well"
    assert replaced(outputs=[OUTPUT], recording=RecordingStatus(state="recording"))[-1] == "all well"


@pytest.mark.parametrize(
    ("fields", "words"),
    [
        ({"state": "waiting for the chip"}, "quavelet doctor --bus linux:1"),
        ({"state": "lost: no sample comes"}, "quavelet doctor --bus linux:1"),
        ({"health": {"fifo_overflows": 2}}, "2 x the chip's FIFO overflowed"),
        ({"loop": LoopStats(900, 100, 1, 1, 1, 1, 1, 1)}, "many deadlines are missed"),
        ({"outputs": [msgspec.structs.replace(OUTPUT, state="failed: no route")]}, "output.x does not work"),
        ({"outputs": [msgspec.structs.replace(OUTPUT, lost=7)]}, "lower output.x.rate_hz"),
        ({"outputs": [msgspec.structs.replace(OUTPUT, refused=7)]}, "raise output.x.readers"),
        ({"recording": RecordingStatus(state="stopped: disk full")}, "is the disk full"),
        ({"clock": ClockStatus(offset_ns=0, synchronised=False)}, "timedatectl"),
    ],
)
def test_what_is_wrong_is_said_with_what_to_do(fields: dict[str, object], words: str) -> None:
    lines = replaced(**fields)
    assert "to look after:" in lines
    assert words in "\n".join(lines[lines.index("to look after:") :])


def test_nothing_in_a_status_can_steer_the_terminal() -> None:
    lines = replaced(outputs=[msgspec.structs.replace(OUTPUT, to="unix:/run/\x1b[2J\n")])
    assert all(line.isprintable() for line in lines)
