"""Who publishes: the document that stays on the broker, so that a fleet's topics, chips and times can be told apart."""

from __future__ import annotations

import hashlib
import hmac
import re
from pathlib import Path
from typing import Literal

import msgspec

from quavelet.settings.service import AUTO
from quavelet.sinks.plan import OutputPlan
from quavelet.sinks.status import ClockStatus, Status

_MACHINE_ID = Path("/etc/machine-id")


class Identity(msgspec.Struct, frozen=True, kw_only=True):
    """One chip of one machine, retained at TOPIC/identity. New fields may be added.

    id         the same after every restart: of the machine, the bus and the address on it
    name       of the service, on the machine `host`
    topic      below which all its messages are; encoding that of TOPIC/attitude
    src        the bus; fake: whether it is no real chip
    chip       what WHO_AM_I names, "" before it answered
    boot_id    another one means that CLOCK_MONOTONIC began again
    clock      CLOCK_REALTIME minus CLOCK_MONOTONIC: t_ns plus it is the world's time, to be compared between machines
               as far as `synchronised` says
    """

    v: Literal[1] = 1
    id: str
    name: str
    host: str
    topic: str
    encoding: str
    src: str
    fake: bool
    chip: str
    address: int
    version: str
    boot_id: str
    clock: ClockStatus


def identity_of(status: Status, *, host: str, topic: str, encoding: str) -> Identity:
    """The identity of the service that `status` is of."""
    return Identity(
        id=device_id(host=host, src=status.src, address=status.address),
        name=status.name,
        host=host,
        topic=topic,
        encoding=encoding,
        src=status.src,
        fake=status.fake,
        chip=status.chip,
        address=status.address,
        version=status.version,
        boot_id=status.boot_id,
        clock=status.clock,
    )


def device_id(*, host: str, src: str, address: int, machine_id: Path = _MACHINE_ID) -> str:
    """The chip's place by machine, bus and address: a new chip there goes on as the old one's sensors.

    The machine is known by its machine-id, which must not be shown (machine-id(5)), so a keyed hash of it is; where
    there is none by its host name.
    """
    try:
        machine = machine_id.read_text(encoding="ascii").strip() or host
    except (OSError, UnicodeDecodeError):
        machine = host
    place = f"quavelet {src} 0x{address:02x}"
    return "quavelet_" + hmac.new(machine.encode(), place.encode(), hashlib.sha256).hexdigest()[:12]


def topic_of(plan: OutputPlan, *, host: str) -> str:
    """Below which topic the output publishes: quavelet/HOST/NAME where none is given."""
    topic = plan.settings.mqtt.topic
    return f"quavelet/{_level(host)}/{plan.service}" if topic == AUTO else topic


def client_id_of(plan: OutputPlan, *, host: str, device: str) -> str:
    """One of its own for every output of every machine: a broker ends the elder of two connections of one id."""
    given = plan.settings.mqtt.client_id
    return f"quavelet-{_level(host)}-{plan.service}-{plan.name}-{device[-6:]}" if given == AUTO else given


def _level(host: str) -> str:
    """A host's name as one level of a topic: nothing in it may be a wildcard or a separator."""
    return re.sub(r"[^A-Za-z0-9_-]", "-", host.partition(".")[0])[:63] or "host"
