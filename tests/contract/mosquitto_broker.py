"""A real mosquitto on a port of its own, and its own client as the one who listens."""

from __future__ import annotations

import asyncio
import json
import os
import shutil
import signal
import socket
import subprocess
import time
from collections.abc import Callable
from pathlib import Path
from typing import Self

import pytest
from waiting import eventually

MOSQUITTO = shutil.which("mosquitto") or shutil.which("mosquitto", path="/usr/sbin")
needs_mosquitto = pytest.mark.skipif(
    MOSQUITTO is None or shutil.which("mosquitto_sub") is None,
    reason="no mosquitto: apt install mosquitto mosquitto-clients",
)


_READY = "is-the-listener-there"


def free_port() -> int:
    with socket.socket() as one:
        one.bind(("127.0.0.1", 0))
        return int(one.getsockname()[1])


class Broker:
    """Started and killed as often as wanted, always on the same port; it keeps nothing on disk.

    config   further lines of mosquitto.conf; "listener" is there already
    """

    def __init__(self, folder: Path, *, config: tuple[str, ...] = ("allow_anonymous true",)) -> None:
        self.folder = folder
        self.port = free_port()
        self._config = folder / "mosquitto.conf"
        lines = [f"listener {self.port} 127.0.0.1", "persistence false", *config]
        self._config.write_text("\n".join(lines) + "\n")
        self._process: subprocess.Popen[bytes] | None = None

    def start(self) -> None:
        assert MOSQUITTO is not None
        command = [MOSQUITTO, "-c", str(self._config)]
        with (self.folder / "mosquitto.log").open("ab") as log:
            self._process = subprocess.Popen(command, stdout=log, stderr=log)
        assert eventually(self._listens), self.log()

    def kill(self) -> None:
        if self._process is not None:
            self._process.kill()
            self._process.wait()
            self._process = None

    def log(self) -> str:
        """What it has said."""
        return (self.folder / "mosquitto.log").read_text()

    def cpu_s(self) -> float:
        """Processor time it has used."""
        assert self._process is not None
        fields = Path(f"/proc/{self._process.pid}/stat").read_text().rpartition(")")[2].split()
        return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")

    def freeze(self) -> None:
        """Its port goes on accepting, as the system does that, and nothing is answered."""
        assert self._process is not None
        self._process.send_signal(signal.SIGSTOP)

    def thaw(self) -> None:
        assert self._process is not None
        self._process.send_signal(signal.SIGCONT)

    def _listens(self) -> bool:
        with socket.socket() as one:
            one.settimeout(0.2)
            return one.connect_ex(("127.0.0.1", self.port)) == 0

    def __enter__(self) -> Self:
        self.start()
        return self

    def __exit__(self, *error: object) -> None:
        self.kill()


class Listener:
    """mosquitto_sub, written to a file: it takes all that comes and never keeps the broker waiting."""

    def __init__(self, broker: Broker, topic: str = "#", *, options: tuple[str, ...] = ()) -> None:
        self._port = broker.port
        self._file = broker.folder / f"heard-{time.monotonic_ns()}.jsonl"
        command = ["mosquitto_sub", "-V", "5", "-h", "127.0.0.1", "-p", str(broker.port), "-q", "1"]
        with self._file.open("wb") as out:
            self._process = subprocess.Popen([*command, "-t", topic, "-F", "%j", *options], stdout=out)

    def is_ready(self) -> bool:
        """Whether it comes to be subscribed: it hears what is said to it."""
        words = ["mosquitto_pub", "-h", "127.0.0.1", "-p", str(self._port), "-t", _READY, "-m", "?"]

        def hears() -> bool:
            subprocess.run(words, check=True)
            time.sleep(0.02)
            return _READY in self._file.read_text()

        return eventually(hears)

    def heard(self, topic: str | None = None) -> list[dict[str, object]]:
        """All publications so far, on all topics or on one: "topic", "payload", "retain" and so on."""
        lines = self._file.read_text().splitlines(keepends=True)
        all_of_them = [json.loads(line) for line in lines if line.endswith("\n")]
        return [one for one in all_of_them if topic in (None, one["topic"]) and one["topic"] != _READY]

    def payloads(self, topic: str) -> list[str]:
        return [str(one.get("payload", "")) for one in self.heard(topic)]

    def newest(self, topic: str) -> str | None:
        """What was last said there."""
        return next(reversed(self.payloads(topic)), None)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self._process.kill()
        self._process.wait()


def certificates(folder: Path) -> None:
    """ca.pem; localhost.pem and .key signed by it for localhost; elsewhere.pem for another host; other-ca.pem."""

    def openssl(*words: str) -> None:
        subprocess.run(["openssl", *words], check=True, capture_output=True, cwd=folder)

    for ca in ("ca", "other-ca"):
        openssl(
            "req", "-x509", "-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:prime256v1", "-nodes", "-days", "2",
            "-keyout", f"{ca}.key", "-out", f"{ca}.pem", "-subj", f"/CN={ca}",
            "-addext", "keyUsage=critical,keyCertSign,cRLSign",
        )  # fmt: skip
    for host in ("localhost", "elsewhere", "client"):
        openssl(
            "req", "-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:prime256v1", "-nodes",
            "-keyout", f"{host}.key", "-out", f"{host}.csr", "-subj", f"/CN={host}",
        )  # fmt: skip
        (folder / "names").write_text(f"subjectAltName=DNS:{host}\nauthorityKeyIdentifier=keyid\n")
        openssl(
            "x509", "-req", "-in", f"{host}.csr", "-CA", "ca.pem", "-CAkey", "ca.key", "-CAcreateserial",
            "-days", "2", "-out", f"{host}.pem", "-extfile", "names",
        )  # fmt: skip


async def soon(what: Callable[[], bool], *, within_s: float = 10.0) -> bool:
    """`eventually` beside what else the event loop does."""
    deadline_s = time.monotonic() + within_s
    while not what():
        if time.monotonic() > deadline_s:
            return False
        await asyncio.sleep(0.02)
    return True
