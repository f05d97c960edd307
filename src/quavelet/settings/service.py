"""What belongs to the program as a service: its name, its local socket, what it keeps and what it records."""

from __future__ import annotations

import re
from typing import Literal

import msgspec

from quavelet.core.errors import SettingsError

AUTO = "auto"
NAME = re.compile(r"[A-Za-z0-9_-]{1,32}")
LONGEST_SOCKET_PATH = 107
"""Bytes of a Unix socket's path, by unix(7)."""


class ServiceSettings(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What others know the program by, and what it keeps.

    name              what it is called; "auto": as the settings file, without ".toml", or "imu"
    socket            the local socket that `quavelet status` and `watch` ask: a path, or "" for none; "auto": NAME.sock
                      in systemd's $RUNTIME_DIRECTORY, else in $XDG_RUNTIME_DIR/quavelet, else none
    state_file        where the attitude is kept over a restart of the program: a path, or "" for nowhere; "auto":
                      NAME.state in systemd's $RUNTIME_DIRECTORY, which is memory, else nowhere
    metrics           "HOST:PORT" where Prometheus may ask for figures, as "127.0.0.1:9650"; "": nowhere
    wait_for_device   keep trying while the chip does not answer at the start
    """

    name: str = AUTO
    socket: str = AUTO
    state_file: str = AUTO
    metrics: str = ""
    wait_for_device: bool = False

    def __post_init__(self) -> None:
        if not NAME.fullmatch(self.name):
            raise SettingsError(f"name = {self.name!r} does not fit: use 1 to 32 letters, digits, _ and -")
        check_socket_path("socket", self.socket)
        if "\0" in self.state_file:
            raise SettingsError("state_file is no path: leave the NUL out")
        if self.metrics:
            host_and_port(self.metrics, key="metrics")


class RecordingSettings(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Recording all the time, into files of bounded size.

    directory      where they go; "": no recording
    format         "qrec"  what the chip gave, byte for byte: all else can be computed again from it
                   "mcap"  the messages, for Foxglove and ROS; nothing can be computed again. Needs the package mcap
    file_mb        a new one is begun after so many MB (10^6 bytes)
    file_minutes   and after so many minutes
    total_mb       the oldest are deleted so that all together never take more; at least twice file_mb
    keep_free_mb   and so that others have so many MB of the disk left; 0: as long as it takes any
    fsync_s        the disk is waited for every so many seconds: what a power cut may cost. 0: when the system sees fit
    """

    directory: str = ""
    format: Literal["qrec", "mcap"] = "qrec"
    file_mb: float = 100.0
    file_minutes: float = 60.0
    total_mb: float = 1000.0
    keep_free_mb: float = 100.0
    fsync_s: float = 10.0

    def __post_init__(self) -> None:
        if "\0" in self.directory:
            raise SettingsError("directory is no path: leave the NUL out")
        for key, value, least, most in (
            ("file_mb", self.file_mb, 0.1, 1e6),
            ("file_minutes", self.file_minutes, 0.1, 1e6),
            ("total_mb", self.total_mb, 2 * self.file_mb, 1e8),
            ("keep_free_mb", self.keep_free_mb, 0.0, 1e8),
            ("fsync_s", self.fsync_s, 0.0, 3600.0),
        ):
            if not least <= value <= most:
                raise SettingsError(f"{key} = {value:g} does not fit: give {least:.10g} to {most:.10g}")


def check_socket_path(key: str, path: str) -> None:
    """Raises SettingsError where no Unix socket can have that path."""
    if "\0" in path or len(path.encode("utf-8", "surrogatepass")) > LONGEST_SOCKET_PATH:
        raise SettingsError(f"{key} = {path!r} is no path of a socket: give at most {LONGEST_SOCKET_PATH} bytes")


def without_login(text: str) -> str:
    """The text as it may be shown: a URL may have been meant, with a password before the host."""
    return re.sub(r".*@", "***@", text, flags=re.DOTALL)


def host_and_port(text: str, *, key: str, port: int | None = None) -> tuple[str, int]:
    """ "HOST:PORT" or "[IPv6]:PORT" apart; `port` is taken where none is given. Raises SettingsError naming `key`."""
    match = re.fullmatch(r"(?:\[([0-9A-Fa-f:.%\w]+)\]|([A-Za-z0-9._-]+))(?::([0-9]{1,5}))?", text, re.ASCII)
    if match is None or not (match[3] or port):
        raise SettingsError(
            f"{key} = {without_login(text)!r} is no HOST:PORT: write it as 192.168.1.20:5555 or [fe80::1]:5555"
        )
    number = int(match[3]) if match[3] else port or 0
    if number > 65535:
        raise SettingsError(f"{key} = {text!r}: there is no port {number}, give 1 to 65535")
    host = match[1] or match[2]
    if len(host) > 253:
        raise SettingsError(f"{key}: a host's name has at most 253 characters, not {len(host)}")
    return host, number
