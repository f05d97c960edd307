"""sd_notify's datagram, as a socket of systemd's kind receives it."""

import os
import socket
from collections.abc import Iterator
from pathlib import Path

import pytest

from quavelet.service.notify import Notify


def listening(address: str) -> socket.socket:
    heard = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
    heard.bind(address)
    heard.settimeout(5.0)
    return heard


@pytest.fixture(params=["path", "abstract"])
def place(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[tuple[str, socket.socket]]:
    if request.param == "path":
        address = told = str(tmp_path / "notify")
    else:
        name = f"quavelet-test-{os.getpid()}-{tmp_path.name}"
        address, told = f"\0{name}", f"@{name}"
    with listening(address) as heard:
        yield told, heard


def test_fields_come_as_one_datagram_at_a_path_and_at_an_abstract_socket(place: tuple[str, socket.socket]) -> None:
    address, heard = place
    said: list[str] = []
    notify = Notify(address, talk=said.append)
    assert notify.wanted and notify.send(READY=1, STATUS="running")
    assert heard.recv(4096) == b"READY=1\nSTATUS=running"
    notify.close()
    assert said == []


def test_a_status_stays_on_its_line_however_it_is_written(place: tuple[str, socket.socket]) -> None:
    address, heard = place
    notify = Notify(address)
    notify.send(STATUS="broken:\nREADY=1\r" + 10_000 * "x" + "\udcff")
    told = heard.recv(65536)
    assert b"\n" not in told and len(told) < 600
    notify.close()


def test_what_systemd_asked_for_is_taken_out_of_the_environment() -> None:
    environment = {"NOTIFY_SOCKET": "@x", "WATCHDOG_USEC": "30000000", "WATCHDOG_PID": str(os.getpid()), "HOME": "/"}
    notify = Notify.from_environment(environment, talk=print)
    assert notify.wanted and notify.watchdog_us == 30_000_000
    assert environment == {"HOME": "/"}
    notify.close()


@pytest.mark.parametrize(
    "watch", [{"WATCHDOG_PID": "1"}, {"WATCHDOG_USEC": "soon"}, {"WATCHDOG_USEC": "-5"}, {"WATCHDOG_USEC": "9" * 40}]
)
def test_a_watchdog_of_another_process_or_of_no_number_is_none(watch: dict[str, str]) -> None:
    notify = Notify.from_environment({"NOTIFY_SOCKET": "@x", "WATCHDOG_USEC": "1000000", **watch}, talk=print)
    assert notify.watchdog_us == 0
    notify.close()


@pytest.mark.parametrize(
    "address", ["", "relative", "vsock:2:1", "/nowhere/at/all", "@" + 200 * "x", "/" + 200 * "x", "/a\0b"]
)
def test_where_nobody_listens_it_is_told_once_and_nothing_is_raised(address: str) -> None:
    said: list[str] = []
    notify = Notify(address, talk=said.append)
    for _ in range(3):
        notify.send(READY=1)
    notify.close()
    notify.close()
    assert len(said) == (1 if address else 0)


def test_a_listener_that_takes_nothing_stops_nobody(tmp_path: Path) -> None:
    said: list[str] = []
    with listening(str(tmp_path / "notify")):
        notify = Notify(str(tmp_path / "notify"), talk=said.append)
        sent = [notify.send(WATCHDOG=1) for _ in range(2000)]
        notify.close()
    assert not all(sent) and len(said) == 1
