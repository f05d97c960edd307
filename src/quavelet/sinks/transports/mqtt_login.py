"""How we show ourselves to a broker, and it to us: password, certificates. Nothing here is ever printed or logged."""

from __future__ import annotations

import logging
import ssl
import stat
from pathlib import Path

from quavelet.core.errors import SettingsError
from quavelet.settings.outputs import MqttSettings

_log = logging.getLogger(__name__)

_LONGEST_PASSWORD = 65535
"""Bytes of MQTT's binary data (MQTT 5.0, 1.5.6)."""


def read_password(mqtt: MqttSettings) -> str | None:
    """What the password's file holds but its last newline, None where no file is given.

    Raises SettingsError where it cannot be read or holds none; says so when others than its owner can read it.
    """
    if not mqtt.password_file:
        return None
    path = Path(mqtt.password_file)
    _check_file("password_file", mqtt.password_file)
    try:
        with path.open("rb") as file:
            mode = path.stat().st_mode
            # A little more than fits, so that a wrong file is told and not read to its end.
            content = file.read(_LONGEST_PASSWORD + 2)
    except (OSError, ValueError) as error:
        reason = error.strerror if isinstance(error, OSError) else "no path"
        raise SettingsError(
            f"password_file {path}: cannot be read ({reason}): let the service's user read it"
        ) from error
    if mode & stat.S_IROTH:
        _log.warning("password_file %s: every user of this machine can read it: chmod 640 it", path)
    try:
        password = content.decode("utf-8").removesuffix("\n").removesuffix("\r")
    except UnicodeDecodeError:
        # Not from the error: it holds the bytes.
        raise SettingsError(f"password_file {path}: is not UTF-8: write the password alone, as text") from None
    if not password or "\n" in password or "\0" in password or len(content) > _LONGEST_PASSWORD:
        raise SettingsError(f"password_file {path}: holds no password: write it alone, on one line")
    return password


def tls_context(mqtt: MqttSettings) -> ssl.SSLContext:
    """TLS 1.2 or newer; the broker's certificate and its host's name are always checked.

    Raises SettingsError where a file cannot be used.
    """
    _check_file("ca_file", mqtt.ca_file)
    _check_file("certificate", mqtt.certificate)
    _check_file("key_file", mqtt.key_file)
    try:
        context = ssl.create_default_context(cafile=mqtt.ca_file or None)
    except (OSError, ValueError) as error:
        raise SettingsError(
            f"ca_file {mqtt.ca_file}: is of no use ({_reason(error)}): give certificates in PEM"
        ) from error
    context.sslsocket_class = _Socket
    context.minimum_version = ssl.TLSVersion.TLSv1_2
    if mqtt.certificate:
        # With a password asked for, OpenSSL would wait for the terminal.
        try:
            context.load_cert_chain(mqtt.certificate, mqtt.key_file, password=_no_password)
        except (OSError, ValueError) as error:
            raise SettingsError(
                f"certificate {mqtt.certificate} and key_file {mqtt.key_file}: are of no use ({_reason(error)}): "
                "give both in PEM, the key without a password"
            ) from error
    return context


def _check_file(key: str, path: str) -> None:
    """Raises SettingsError for what is there and is no file: a pipe or a device may keep whoever reads it for ever."""
    try:
        is_other = bool(path) and Path(path).exists() and not Path(path).is_file()
    except (OSError, ValueError):
        # Told by the one who opens it.
        return
    if is_other:
        raise SettingsError(f"{key} {path}: is no file: give the path of one")


class _Socket(ssl.SSLSocket):
    """One that is closed when the other side does not prove who it is; paho leaves it to the garbage collector."""

    def do_handshake(self, block: bool = False) -> None:
        try:
            super().do_handshake(block)
        except (OSError, ValueError):
            self.close()
            raise


def _no_password() -> str:
    return ""


def _reason(error: Exception) -> str:
    if isinstance(error, ssl.SSLError):
        return error.reason or "not PEM"
    return (error.strerror if isinstance(error, OSError) else None) or str(error)
