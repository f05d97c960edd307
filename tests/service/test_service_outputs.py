"""The outputs of a service: what the settings ask for is there before the chip is, and changes without it noticing."""

from __future__ import annotations

import os
import socket
import threading
from pathlib import Path

import msgspec
import pytest
from service_bed import Bed
from waiting import eventually

from hw_fakes import Sway
from quavelet.core.clock import VirtualClock
from quavelet.core.errors import SettingsError
from quavelet.loop.hub import Hub
from quavelet.service.outputs import Outputs, socket_path
from quavelet.service.status import is_synchronised, memory_mb
from quavelet.settings import BusSettings, MqttSettings, OutputSettings, ServiceSettings, Settings
from quavelet.sinks.asking import ask_status, decode_status
from quavelet.sinks.message import Message
from quavelet.sinks.outputs import ENCODINGS
from quavelet.sinks.status import Status

BOUND_S = 20.0
PLAIN = Settings(bus=BusSettings(name="fake:bed"))


def with_outputs(**outputs: OutputSettings) -> Settings:
    return msgspec.structs.replace(PLAIN, output=outputs)


def receiver() -> socket.socket:
    sock = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    sock.settimeout(BOUND_S)
    sock.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4_000_000)
    sock.bind(("127.0.0.1", 0))
    return sock


def to(sock: socket.socket) -> str:
    return f"udp:127.0.0.1:{sock.getsockname()[1]}"


def times(sock: socket.socket, n: int) -> list[int]:
    return [msgspec.json.decode(sock.recv(65_536), type=Message).t_ns for _ in range(n)]


def threads() -> set[str]:
    return {thread.name for thread in threading.enumerate()}


def test_without_an_output_or_a_socket_there_is_no_thread_for_them() -> None:
    bed = Bed(settings=PLAIN)
    seen: list[set[str]] = []
    bed.clock.at(1.0, lambda: seen.append(threads()))
    bed.run(until_s=2)
    assert not any("network" in name for name in seen[0])


def test_each_output_gets_the_messages_that_its_settings_leave_in() -> None:
    with receiver() as a, receiver() as b:
        bed = Bed(Sway(), settings=with_outputs(a=OutputSettings(to=to(a)), b=OutputSettings(to=to(b), rate_hz=10.0)))
        bed.run(until_s=4)
        sent = [message.t_ns for message in bed.messages]
        assert times(a, len(sent)) == sent
        tenth = times(b, 20)
        assert set(tenth) < set(sent)
        status = {output.name: output for output in bed.service.status().outputs}
        assert status["a"].sent == len(sent)
        assert status["b"].sent + status["b"].left_out == len(sent)
        assert bed.service.status().latency.count == status["a"].sent + status["b"].sent


def test_an_output_that_is_changed_on_reload_gives_way_and_the_others_go_on() -> None:
    with receiver() as stays, receiver() as old, receiver() as new:
        before = with_outputs(stays=OutputSettings(to=to(stays)), x=OutputSettings(to=to(old)))
        after = with_outputs(stays=OutputSettings(to=to(stays)), x=OutputSettings(to=to(new)))
        bed = Bed(Sway(), settings=before, load=lambda: after)

        def outputs_are_level() -> None:
            """The network's thread runs in real time: what was sent before goes to whoever was there then."""
            assert eventually(lambda: bed.service.status().outputs[0].sent == len(bed.messages))

        def new_one_is_open() -> None:
            state = f"sending to {to(new).removeprefix('udp:')}"
            assert eventually(lambda: bed.service.status().outputs[1].state == state)

        bed.clock.at(2.995, outputs_are_level)
        bed.clock.at(3.0, bed.service.reload)
        bed.clock.at(4.0, new_one_is_open)
        bed.run(until_s=6)
        sent = [message.t_ns for message in bed.messages]
        assert times(stays, len(sent)) == sent
        assert times(old, 1) == sent[:1]
        late = times(new, 1)
        assert late[0] >= 3_000_000_000
        assert [output.name for output in bed.service.status().outputs] == ["stays", "x"]


def test_outputs_that_cannot_be_are_refused_on_reload_and_the_old_ones_stay(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delitem(ENCODINGS, "nmea")
    with receiver() as sock:
        bad = with_outputs(x=OutputSettings(to=to(sock), encoding="nmea"))
        bed = Bed(Sway(), settings=with_outputs(x=OutputSettings(to=to(sock))), load=lambda: bad)
        bed.clock.at(3.0, bed.service.reload)
        bed.run(until_s=5)
        assert any("refused, the old ones stay in force: output.x: encoding 'nmea'" in line for line in bed.said)
        sent = [message.t_ns for message in bed.messages]
        assert times(sock, len(sent)) == sent


def test_the_service_can_be_asked_while_it_waits_for_the_chip_and_after(tmp_path: Path) -> None:
    path = tmp_path / "imu.sock"
    service = ServiceSettings(socket=str(path), wait_for_device=True, name="roof")
    bed = Bed(settings=msgspec.structs.replace(PLAIN, service=service))
    bed.plugged = False
    asked: list[Status] = []

    def ask() -> None:
        for _ in range(2_000):
            if path.exists():
                break
            threading.Event().wait(0.005)
        asked.append(decode_status(path, ask_status(path)))

    bed.clock.at(3.0, ask)
    bed.clock.at(5.0, lambda: setattr(bed, "plugged", True))
    bed.clock.at(20.0, ask)
    bed.run(until_s=21)
    waiting, running = asked
    assert (waiting.name, waiting.state, waiting.chip, waiting.message) == ("roof", "waiting for the chip", "", None)
    assert (running.state, running.chip, running.fake) == ("running", "MPU-6050", True)
    assert running.message is not None and running.rate_hz == pytest.approx(200.0, rel=0.06)
    assert running.health["samples"] > 1_000
    assert running.loop.ticks > 1_000
    assert running.pid == os.getpid()
    assert not path.exists()


def test_where_the_socket_is(tmp_path: Path) -> None:
    def place(socket: str = "auto", **environ: str) -> Path | None:
        settings = msgspec.structs.replace(PLAIN, service=ServiceSettings(socket=socket))
        return socket_path(settings, name="imu0", environ=environ)

    assert place() is None
    assert place(RUNTIME_DIRECTORY="/run/quavelet") == Path("/run/quavelet/imu0.sock")
    assert place(RUNTIME_DIRECTORY="/run/a:/run/b") == Path("/run/a/imu0.sock")
    assert place(XDG_RUNTIME_DIR=str(tmp_path)) == tmp_path / "quavelet" / "imu0.sock"
    assert (tmp_path / "quavelet").stat().st_mode & 0o777 == 0o700
    assert place(XDG_RUNTIME_DIR="/nowhere/at/all") is None
    assert place("", RUNTIME_DIRECTORY="/run/quavelet") is None
    assert place("/tmp/x.sock", RUNTIME_DIRECTORY="/run/quavelet") == Path("/tmp/x.sock")


def test_a_password_is_never_in_the_status(tmp_path: Path) -> None:
    secret = tmp_path / "password"
    secret.write_text("hunter2")
    mqtt = MqttSettings(user="imu", password_file=str(secret))
    settings = with_outputs(home=OutputSettings(to="mqtt:127.0.0.1:1", mqtt=mqtt))
    try:
        bed = Bed(settings=settings)
    except SettingsError:
        pytest.skip("there is no transport for MQTT")
    bed.run(until_s=2)
    text = msgspec.json.encode(bed.service.status())
    assert b"hunter2" not in text and b"password" not in text


def test_an_output_on_stdout_is_written_as_it_asks(tmp_path: Path) -> None:
    path = tmp_path / "out"
    settings = with_outputs(a=OutputSettings(to="stdout", rate_hz=10.0))
    outputs = Outputs(
        settings,
        name="imu",
        messages=Hub(),
        clock=VirtualClock(),
        offset_ns=int,
        talk=print,
        status=lambda: None,
        environ={},  # type: ignore[arg-type, return-value]
    )
    bed = Bed(Sway(), settings=PLAIN)
    bed.run(until_s=4)
    with path.open("wb") as stream:
        sink = outputs.stdout(stream)
        for message in bed.messages:
            sink.write(message)
        sink.close()
    assert len(path.read_bytes().splitlines()) == pytest.approx(len(bed.messages) / 10, abs=2)


def test_what_the_host_tells_is_told() -> None:
    assert 10.0 < memory_mb() < 10_000.0
    assert is_synchronised() in (True, False, None)
