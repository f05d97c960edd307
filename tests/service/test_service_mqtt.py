"""The program itself beside a real broker: what stands there while it runs, and after it has gone."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path

import msgspec
import pytest
from mosquitto_broker import Broker, Listener, needs_mosquitto
from waiting import eventually

from quavelet.sinks.identity import Identity
from quavelet.sinks.message import Message

pytestmark = needs_mosquitto


@pytest.mark.parametrize("end", [signal.SIGTERM, pytest.param(signal.SIGKILL, marks=pytest.mark.slow)])
def test_the_program_is_online_while_it_runs_and_offline_however_it_ends(end: signal.Signals, tmp_path: Path) -> None:
    with Broker(tmp_path) as broker, Listener(broker) as listener:
        assert listener.is_ready()
        config = tmp_path / "mast.toml"
        config.write_text(
            f'[output.home]\nto = "mqtt:127.0.0.1:{broker.port}"\nrate_hz = 10.0\nmqtt.topic = "boat/mast"\n'
        )
        command = [sys.executable, "-c", "from quavelet.cli.app import main; main()"]
        options = ["run", "--bus", "fake:tilt", "--config", str(config), "--json"]
        environment = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
        with subprocess.Popen(
            [*command, *options], env=environment, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE
        ) as program:
            try:
                assert eventually(lambda: listener.newest("boat/mast/status") == "online", within_s=20.0)
                assert eventually(lambda: len(listener.heard("boat/mast/attitude")) > 5)
            finally:
                program.send_signal(end)
            assert program.stderr is not None
            talk = program.stderr.read().decode()
        assert eventually(lambda: listener.newest("boat/mast/status") == "offline"), talk
        identity = msgspec.json.decode(listener.payloads("boat/mast/identity")[0], type=Identity)
        messages = [msgspec.json.decode(text, type=Message) for text in listener.payloads("boat/mast/attitude")]
    assert (identity.name, identity.src, identity.fake) == ("mast", "fake:tilt", True)
    assert [one.src for one in messages] == ["fake:tilt"] * len(messages)
    times = [one.t_ns for one in messages]
    assert times == sorted(set(times))
