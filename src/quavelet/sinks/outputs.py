"""Which encoding and which transport a name in the settings means."""

from __future__ import annotations

from collections.abc import Callable

from quavelet.core.errors import SettingsError
from quavelet.settings.outputs import Way
from quavelet.sinks.encoding import Encoding
from quavelet.sinks.encodings.influx import Influx
from quavelet.sinks.encodings.json import Json
from quavelet.sinks.encodings.mavlink import Mavlink
from quavelet.sinks.encodings.nmea import Nmea
from quavelet.sinks.encodings.opentrack import OpenTrack
from quavelet.sinks.encodings.signalk import SignalK
from quavelet.sinks.output import Output
from quavelet.sinks.plan import OutputPlan
from quavelet.sinks.transport import Transport
from quavelet.sinks.transports.mqtt import MqttTransport
from quavelet.sinks.transports.tcp import TcpTransport
from quavelet.sinks.transports.udp import UdpTransport
from quavelet.sinks.transports.unix import UnixTransport

ENCODINGS: dict[str, Callable[[OutputPlan], Encoding]] = {
    "json": Json,
    "nmea": lambda plan: Nmea(offset_ns=plan.offset_ns),
    "signalk": lambda plan: SignalK(name=plan.service, offset_ns=plan.offset_ns),
    "influx": lambda plan: Influx(name=plan.service, offset_ns=plan.offset_ns),
    "opentrack": lambda plan: OpenTrack(),  # noqa: ARG005
    "mavlink": lambda plan: Mavlink(),  # noqa: ARG005
}

TRANSPORTS: dict[Way, Callable[[OutputPlan], Transport]] = {
    "mqtt": MqttTransport,
    "mqtts": MqttTransport,
    "tcp": TcpTransport,
    "udp": UdpTransport,
    "unix": UnixTransport,
}
"""stdout is not here: it is no business of the network's thread, since a pipe may block."""


def make_encoding(plan: OutputPlan) -> Encoding:
    """The encoding of an output. Raises SettingsError where it, or what it needs, is not there."""
    made = ENCODINGS.get(plan.settings.encoding)
    if made is None:
        raise SettingsError(f"output.{plan.name}: encoding '{plan.settings.encoding}' is not there: use another")
    return made(plan)


def make_transport(plan: OutputPlan) -> Transport:
    """The transport of an output. Raises SettingsError where it, or what it needs, is not there."""
    made = TRANSPORTS.get(plan.settings.destination.way)
    if made is None:
        raise SettingsError(f"output.{plan.name}: to = '{plan.settings.to}' is not there: use another")
    return made(plan)


def make_output(plan: OutputPlan) -> Output:
    """An output for the network. Raises SettingsError as the two above."""
    return Output(plan, make_encoding(plan), make_transport(plan))
