"""A real mosquitto that wants a password or a certificate, or cannot show a good one itself."""

from __future__ import annotations

import asyncio
import logging
import shutil
import subprocess
from pathlib import Path

import pytest
from mosquitto_broker import Broker, certificates, needs_mosquitto, soon
from mqtt_rig import connected, opened, payloads, plan_for, run, state_of
from output_plans import mqtt_plan

pytestmark = needs_mosquitto
SECRET = "correct horse"


def logging_in(tmp_path: Path, *, password: str) -> dict[str, object]:
    path = tmp_path / "password"
    path.write_text(password)
    path.chmod(0o600)
    return {"user": "imu", "password_file": str(path)}


@pytest.fixture
def guarded(tmp_path: Path) -> Broker:
    """A broker that wants a password, and lets "imu" write below t only."""
    if shutil.which("mosquitto_passwd") is None:
        pytest.skip("no mosquitto_passwd: apt install mosquitto")
    subprocess.run(["mosquitto_passwd", "-b", "-c", str(tmp_path / "users"), "imu", SECRET], check=True)
    (tmp_path / "acl").write_text("user imu\ntopic readwrite t/#\n")
    for name in ("users", "acl"):
        (tmp_path / name).chmod(0o644)
    return Broker(
        tmp_path,
        config=("allow_anonymous false", f"password_file {tmp_path}/users", f"acl_file {tmp_path}/acl", "user root"),
    )


def test_a_wrong_password_is_told_once_without_it_and_mended_without_a_restart(
    guarded: Broker, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    async def scenario() -> None:
        plan = plan_for(guarded, home_assistant=False, **logging_in(tmp_path, password="wrong horse"))
        async with opened(plan) as transport:
            assert await soon(lambda: "password" in state_of(transport))
            await asyncio.sleep(0.7)
            logging_in(tmp_path, password=SECRET)
            await connected(transport)
            transport.send(b"1")
            assert await soon(lambda: transport.stats().sent == 1)

    with caplog.at_level(logging.DEBUG), guarded:
        run(scenario())
    warned = [record for record in caplog.records if record.levelno >= logging.WARNING]
    assert len(warned) == 1
    assert "horse" not in caplog.text


def test_what_the_access_list_refuses_is_lost_and_told_and_the_rest_goes_on(
    guarded: Broker, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    async def scenario() -> None:
        allowed = mqtt_plan(f"mqtt:127.0.0.1:{guarded.port}", topic="t", **logging_in(tmp_path, password=SECRET))
        async with opened(allowed) as transport:
            # Home Assistant's document is outside of t.
            assert await soon(lambda: "homeassistant" in state_of(transport))
            await payloads(transport, 0, 20)
            assert await soon(lambda: transport.stats().sent == 20)
        refused = mqtt_plan(f"mqtt:127.0.0.1:{guarded.port}", topic="other", **logging_in(tmp_path, password=SECRET))
        async with opened(refused) as transport:
            await payloads(transport, 0, 20)
            assert await soon(lambda: transport.stats().lost == 20)
            assert transport.stats().sent == 0
            assert "access list" in state_of(transport)

    with caplog.at_level(logging.WARNING), guarded:
        run(scenario())
    assert "refuses what is published" in caplog.text


@pytest.fixture
def tls(tmp_path: Path) -> Broker:
    """A broker with a certificate for localhost."""
    return tls_broker(tmp_path, "localhost")


def tls_broker(folder: Path, host: str, *more: str) -> Broker:
    if shutil.which("openssl") is None:
        pytest.skip("no openssl: apt install openssl")
    certificates(folder)
    files = (f"cafile {folder}/ca.pem", f"certfile {folder}/{host}.pem", f"keyfile {folder}/{host}.key")
    return Broker(folder, config=("allow_anonymous true", "user root", *files, *more))


def test_a_broker_whose_certificate_holds_is_connected_to(tls: Broker, tmp_path: Path) -> None:
    async def scenario() -> None:
        async with opened(plan_for(tls, to="mqtts:localhost", ca_file=str(tmp_path / "ca.pem"))) as transport:
            await connected(transport)
            await payloads(transport, 0, 50)
            assert await soon(lambda: transport.stats().sent == 50)

    with tls:
        run(scenario())


@pytest.mark.parametrize(
    ("to", "ca", "words"),
    [
        ("mqtts:localhost", "other-ca.pem", "certificate that does not hold"),
        ("mqtts:localhost", "", "certificate that does not hold"),
        ("mqtts:127.0.0.1", "ca.pem", "certificate that does not hold (IP address mismatch"),
        ("mqtt:localhost", "", "ends the connection at once"),
    ],
)
def test_a_broker_that_cannot_prove_who_it_is_gets_nothing_and_is_told_once(
    to: str, ca: str, words: str, tls: Broker, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    async def scenario() -> None:
        async with opened(plan_for(tls, to=to, ca_file=str(tmp_path / ca) if ca else "")) as transport:
            transport.send(b"1")
            assert await soon(lambda: words in state_of(transport)), state_of(transport)
            await asyncio.sleep(0.5)
            assert transport.stats().sent == 0

    with caplog.at_level(logging.WARNING), tls:
        run(scenario())
    assert len(caplog.messages) == 1


def test_a_certificate_for_another_host_does_not_hold(tmp_path: Path) -> None:
    async def scenario(broker: Broker) -> None:
        async with opened(plan_for(broker, to="mqtts:localhost", ca_file=str(tmp_path / "ca.pem"))) as transport:
            assert await soon(lambda: "Hostname mismatch" in state_of(transport)), state_of(transport)

    with tls_broker(tmp_path, "elsewhere") as broker:
        run(scenario(broker))


def test_a_broker_that_wants_a_certificate_of_ours_takes_it_and_only_it(tmp_path: Path) -> None:
    async def scenario(broker: Broker) -> None:
        ca = str(tmp_path / "ca.pem")
        ours = {"certificate": str(tmp_path / "client.pem"), "key_file": str(tmp_path / "client.key")}
        async with opened(plan_for(broker, to="mqtts:localhost", ca_file=ca)) as transport:
            assert await soon(lambda: "waiting for the broker: " in state_of(transport))
            await asyncio.sleep(0.5)
            assert state_of(transport) != "connected"
        async with opened(plan_for(broker, to="mqtts:localhost", ca_file=ca, **ours)) as transport:
            await connected(transport)

    with tls_broker(tmp_path, "localhost", "require_certificate true") as broker:
        run(scenario(broker))
