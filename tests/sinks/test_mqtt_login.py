"""Password and certificates from files: refused in words that never hold the secret."""

from __future__ import annotations

import logging
import os
from pathlib import Path

import msgspec
import pytest

from quavelet.core.errors import SettingsError
from quavelet.settings.outputs import MqttSettings
from quavelet.sinks.transports.mqtt_login import read_password, tls_context

SECRET = "correct horse"


def login(path: Path) -> MqttSettings:
    return MqttSettings(user="imu", password_file=str(path))


@pytest.mark.parametrize("ending", ["", "\n", "\r\n"])
def test_a_password_written_with_an_editor_is_the_password_alone(ending: str, tmp_path: Path) -> None:
    path = tmp_path / "password"
    path.write_bytes((SECRET + ending).encode())
    assert read_password(login(path)) == SECRET


def test_a_password_that_every_user_can_read_is_told_and_not_shown(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    path = tmp_path / "password"
    path.write_text(SECRET)
    path.chmod(0o640)
    with caplog.at_level(logging.WARNING):
        read_password(login(path))
        assert not caplog.messages
        path.chmod(0o644)
        read_password(login(path))
    assert "every user of this machine can read it" in caplog.text
    assert SECRET not in caplog.text


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"", "holds no password"),
        (b"\n", "holds no password"),
        (b"correct horse\nuser\n", "holds no password"),
        (b"correct \0horse", "holds no password"),
        (b"correct horse" * 10_000, "holds no password"),
        (b"correct horse\xff", "is not UTF-8"),
        (None, "cannot be read (No such file or directory)"),
    ],
)
def test_a_wrong_password_file_is_refused_without_its_content(
    content: bytes | None, words: str, tmp_path: Path
) -> None:
    path = tmp_path / "password"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(SettingsError) as told:
        read_password(login(path))
    assert words in str(told.value)
    assert str(path) in str(told.value)
    chain: BaseException | None = told.value
    while chain is not None:
        assert "horse" not in repr(chain)
        chain = chain.__cause__


def test_a_path_with_a_nul_is_a_mistake_in_the_settings(tmp_path: Path) -> None:
    nul = f"{tmp_path}/a\0b"
    for settings in (MqttSettings(ca_file=nul), MqttSettings(certificate=nul, key_file=nul)):
        with pytest.raises(SettingsError):
            tls_context(settings)
    with pytest.raises(SettingsError):
        read_password(MqttSettings(user="imu", password_file=nul))


def test_a_pipe_or_a_device_keeps_nobody_waiting(tmp_path: Path) -> None:
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    for other in (str(pipe), "/dev/zero", str(tmp_path)):
        with pytest.raises(SettingsError, match=r"password_file .* is no file"):
            read_password(MqttSettings(user="imu", password_file=other))
        with pytest.raises(SettingsError, match=r"ca_file .* is no file"):
            tls_context(MqttSettings(ca_file=other))
        with pytest.raises(SettingsError, match=r"certificate .* is no file"):
            tls_context(MqttSettings(certificate=other, key_file=other))


def test_a_certificate_that_is_none_is_told_with_its_file(tmp_path: Path) -> None:
    wrong = tmp_path / "ca.pem"
    wrong.write_text("-----BEGIN NONSENSE-----\n")
    with pytest.raises(SettingsError, match=r"ca_file .*ca\.pem: is of no use"):
        tls_context(MqttSettings(ca_file=str(wrong)))
    with pytest.raises(SettingsError, match=r"certificate .*ca\.pem and key_file .*are of no use"):
        tls_context(MqttSettings(certificate=str(wrong), key_file=str(wrong)))


@pytest.mark.parametrize(
    "wrong",
    [
        {"topic": "imu/+/x"},
        {"topic": "imu/#"},
        {"topic": "imu\0"},
        {"topic": "imu\n"},
        {"topic": "/imu"},
        {"topic": "imu/"},
        {"topic": "a//b"},
        {"topic": "$SYS/imu"},
        {"topic": "\ud800"},
        {"topic": "x" * 70_000},
        {"discovery_prefix": "home/#"},
        {"discovery_prefix": ""},
        {"client_id": "a/b"},
        {"client_id": ""},
        {"user": "a\0b"},
        {"user": "a\nb"},
        {"user": "\ud800"},
        {"user": "x" * 70_000},
    ],
)
def test_no_name_can_reach_into_another_topic_or_break_the_packet(wrong: dict[str, str]) -> None:
    with pytest.raises((SettingsError, msgspec.ValidationError)):
        MqttSettings(**wrong)
