"""The outputs, [output.NAME]: where each goes, in which words, and how often."""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal

import msgspec

from quavelet.core.errors import SettingsError
from quavelet.settings.service import NAME, check_socket_path, host_and_port, without_login

EncodingName = Literal["json", "nmea", "signalk", "influx", "opentrack", "mavlink"]
Way = Literal["stdout", "unix", "tcp", "udp", "mqtt", "mqtts"]

MOST_OUTPUTS = 32
WAYS: tuple[Way, ...] = ("stdout", "unix", "tcp", "udp", "mqtt", "mqtts")
DEFAULT_PORT: dict[Way, int] = {"mqtt": 1883, "mqtts": 8883}
_BINARY_WAYS: dict[str, tuple[Way, ...]] = {"opentrack": ("udp",), "mavlink": ("udp", "tcp", "unix")}
"""OpenTrack takes datagrams only; MAVLink has frames of its own, so it may be a stream too."""


@dataclass(frozen=True, slots=True)
class Destination:
    """`to` taken apart: `path` of a Unix socket, or `host` and `port`."""

    way: Way
    path: str = ""
    host: str = ""
    port: int = 0


class MqttSettings(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The broker of an output to "mqtt:" or "mqtts:".

    topic              "auto": quavelet/HOST/NAME with the service's name
    user               who we are to the broker; "": nobody
    password_file      a file that holds nothing but the password; "": none. Readable by the service's user alone
    ca_file            certificates that the broker's must be signed by (mqtts); "": those of the system
    certificate        our own, PEM, with its key in key_file; "": none
    key_file           the key of the certificate, PEM
    qos                how hard is tried: at most once, at least once, exactly once
    client_id          "auto": one of its own for every output of every machine
    home_assistant     announce the sensors to Home Assistant
    discovery_prefix   below which Home Assistant looks for them
    expire_after_s     without a message for so long Home Assistant shows them as unavailable
    """

    topic: str = "auto"
    user: str = ""
    password_file: str = ""
    ca_file: str = ""
    certificate: str = ""
    key_file: str = ""
    qos: Literal[0, 1, 2] = 1
    client_id: str = "auto"
    home_assistant: bool = True
    discovery_prefix: str = "homeassistant"
    expire_after_s: float = 10.0

    def __post_init__(self) -> None:
        for key, text in (("topic", self.topic), ("discovery_prefix", self.discovery_prefix)):
            if not re.fullmatch(r"[A-Za-z0-9_.:-]+(/[A-Za-z0-9_.:-]+)*", text) or len(text) > 200:
                raise SettingsError(f"{key} = {text!r} is no topic: use letters, digits, _ - . : and / between them")
        if not self.user.isprintable() or len(self.user) > 128:
            raise SettingsError("user does not fit: give at most 128 printable characters")
        if not re.fullmatch(r"[A-Za-z0-9_-]{1,64}", self.client_id):
            raise SettingsError(f"client_id = {self.client_id!r} does not fit: use 1 to 64 letters, digits, _ and -")
        if bool(self.certificate) != bool(self.key_file):
            raise SettingsError("certificate and key_file go together: give both or none")
        if self.password_file and not self.user:
            raise SettingsError("password_file needs a user: give user too")
        if not 2.0 <= self.expire_after_s <= 3600.0:
            raise SettingsError(f"expire_after_s = {self.expire_after_s:g} does not fit: give 2 to 3600 s")


class OutputSettings(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """One output, by a name of its own.

    to              "stdout", "unix:PATH", "tcp:HOST:PORT" (it listens there; port 0: any free one), "udp:HOST:PORT",
                    "mqtt:HOST[:PORT]" or "mqtts:HOST[:PORT]"
    encoding        in which words
    rate_hz         at most so many messages a second; 0: all
    dead_band_deg   a message is left out while the board has turned by less and nothing else changed; one a second goes
                    all the same. 0: none is left out
    readers         of unix and tcp: at most so many at once
    mqtt            of mqtt and mqtts
    """

    to: str
    encoding: EncodingName = "json"
    rate_hz: float = 0.0
    dead_band_deg: float = 0.0
    readers: int = 8
    mqtt: MqttSettings = MqttSettings()

    def __post_init__(self) -> None:
        way = self.destination.way
        ways = _BINARY_WAYS.get(self.encoding, WAYS)
        if way not in ways:
            raise SettingsError(f"encoding = '{self.encoding}' does not go with to = '{way}': use {' or '.join(ways)}")
        if not 0.0 <= self.rate_hz <= 1000.0:
            raise SettingsError(f"rate_hz = {self.rate_hz:g} does not fit: give 0 (all) to 1000")
        if not 0.0 <= self.dead_band_deg <= 90.0:
            raise SettingsError(f"dead_band_deg = {self.dead_band_deg:g} does not fit: give 0 (off) to 90")
        if not 1 <= self.readers <= 64:
            raise SettingsError(f"readers = {self.readers} does not fit: give 1 to 64")
        if self.mqtt != MqttSettings() and not self.is_mqtt:
            raise SettingsError(f"the table mqtt does not go with to = '{way}': it is for mqtt and mqtts only")
        if self.is_mqtt and self.mqtt.home_assistant:
            self._check_home_assistant()

    @property
    def destination(self) -> Destination:
        """`to` taken apart. Raises SettingsError where it is none."""
        word, _, rest = self.to.partition(":")
        if self.to == "stdout":
            return Destination("stdout")
        way = next((way for way in WAYS[1:] if way == word), None)
        if way is None or not rest:
            raise SettingsError(
                f"to = {without_login(self.to)!r} is no place for an output: give stdout, unix:PATH, "
                "tcp:HOST:PORT, udp:HOST:PORT, mqtt:HOST or mqtts:HOST"
            )
        if way == "unix":
            check_socket_path("to", rest)
            return Destination("unix", path=rest)
        host, port = host_and_port(rest, key="to", port=DEFAULT_PORT.get(way))
        if port == 0 and way != "tcp":
            raise SettingsError(f"to = {self.to!r}: there is no port 0, give 1 to 65535")
        return Destination(way, host=host, port=port)

    def _check_home_assistant(self) -> None:
        if self.encoding != "json":
            raise SettingsError(
                f"encoding = '{self.encoding}' is not for Home Assistant, which reads json: "
                "write mqtt.home_assistant = false"
            )
        if 0.0 < self.rate_hz * self.mqtt.expire_after_s < 2.0:
            raise SettingsError(
                f"rate_hz = {self.rate_hz:g} is too slow for mqtt.expire_after_s = {self.mqtt.expire_after_s:g}: Home "
                f"Assistant would show the sensors as unavailable; give expire_after_s {2.0 / self.rate_hz:g} or more"
            )

    @property
    def is_mqtt(self) -> bool:
        return self.to.partition(":")[0] in DEFAULT_PORT


def output_faults(outputs: dict[str, OutputSettings]) -> list[str]:
    """What is wrong with the outputs' names, with their number, and with two together; a sentence each."""
    faults = [
        f"[output.{name!r}]: an output's name has 1 to 32 letters, digits, _ and -"
        for name in outputs
        if not NAME.fullmatch(name)
    ]
    if len(outputs) > MOST_OUTPUTS:
        faults.append(f"{len(outputs)} outputs are too many: give at most {MOST_OUTPUTS}")
    stdout = [name for name, output in outputs.items() if output.to == "stdout"]
    if len(stdout) > 1:
        faults.append(f"outputs {' and '.join(map(repr, stdout))} all go to stdout: leave one")
    return [*faults, *_listener_faults(outputs), *_broker_faults(outputs)]


def _listener_faults(outputs: dict[str, OutputSettings]) -> Iterable[str]:
    """Of outputs that would listen at one place."""
    places: dict[str, str] = {}
    for name, output in outputs.items():
        at = output.destination
        if at.way == "unix" or (at.way == "tcp" and at.port):
            other = places.setdefault(output.to, name)
            if other != name:
                yield f"outputs {other!r} and {name!r} both listen at {output.to}: give one another"


def _broker_faults(outputs: dict[str, OutputSettings]) -> Iterable[str]:
    """Of outputs that would write over each other at one broker."""
    topics: dict[tuple[str, str], str] = {}
    announced: dict[tuple[str, str], str] = {}
    for name, output in outputs.items():
        if not output.is_mqtt:
            continue
        mqtt, host = output.mqtt, output.destination.host
        other = topics.setdefault((host, mqtt.topic), name)
        if other != name:
            yield f"outputs {other!r} and {name!r} have one topic at {host}: give one an mqtt.topic of its own"
        elif mqtt.home_assistant:
            other = announced.setdefault((host, mqtt.discovery_prefix), name)
            if other != name:
                yield f"outputs {other!r} and {name!r} announce one board: write mqtt.home_assistant = false in one"
