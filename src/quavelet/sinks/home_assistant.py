"""Home Assistant's device discovery: one retained document that announces the board and all its sensors.

By its documentation of the MQTT integration, "Device discovery payload" (since 2024.11; the state class of angles that
go round since 2025.4).
"""

from __future__ import annotations

from collections.abc import Mapping
from math import ceil

import msgspec

from quavelet.settings.outputs import MqttSettings
from quavelet.sinks.identity import Identity
from quavelet.sinks.message import Yaw
from quavelet.sinks.status import ClockStatus, Status

DIAGNOSTICS_S = 30.0
"""Time between two documents at TOPIC/diagnostics."""

_Component = dict[str, str | int]
_Shared = Mapping[str, str | int]
_FAULTS = ("waiting", "lost")


class Diagnostics(msgspec.Struct, frozen=True, kw_only=True):
    """How the service is, at TOPIC/diagnostics. New fields may be added.

    state      in words, as `quavelet status` has it
    problem    the chip is not there, or what it gives is in doubt: then `flags` say why
    rate_hz    samples a second, None until measured
    gaps       places in the data where samples are missing; resets of the FIFO and of the chip
    lost       messages that this output lost
    clock      as in TOPIC/identity, of this moment
    """

    state: str
    problem: bool
    flags: list[str]
    rate_hz: float | None
    temp_degc: float | None
    gaps: int
    resets: int
    lost: int
    uptime_s: float
    clock: ClockStatus


def diagnostics_of(status: Status, *, lost: int) -> Diagnostics:
    """The diagnostics of the service that `status` is of."""
    message = status.message
    health = status.health
    flags = [] if message is None else message.flags
    return Diagnostics(
        state=status.state,
        problem=bool(flags) or status.state.startswith(_FAULTS),
        flags=flags,
        rate_hz=None if status.rate_hz is None else round(status.rate_hz, 3),
        temp_degc=None if message is None else round(message.temp_degc, 2),
        gaps=health.get("gaps", 0),
        resets=health.get("fifo_resets", 0) + health.get("chip_restarts", 0),
        lost=lost,
        uptime_s=round(status.uptime_s, 1),
        clock=status.clock,
    )


def discovery_topic(identity: Identity, *, mqtt: MqttSettings) -> str:
    """Where Home Assistant looks for the document; an empty one there takes the device away again."""
    return f"{mqtt.discovery_prefix}/device/{identity.id}/config"


def discovery(identity: Identity, *, mqtt: MqttSettings, yaw: Yaw) -> bytes:
    """The document, in JSON. `yaw` is what yaw counts from, which is part of its name and never left unsaid.

    The sensors expire `expire_after_s` after the last message, those of the diagnostics after three that did not come.
    """
    attitude: _Shared = {"state_topic": f"{identity.topic}/attitude", "expire_after": ceil(mqtt.expire_after_s)}
    slow = max(ceil(mqtt.expire_after_s), int(3 * DIAGNOSTICS_S))
    diagnostics: _Shared = {
        "state_topic": f"{identity.topic}/diagnostics",
        "expire_after": slow,
        "entity_category": "diagnostic",
    }
    turning: _Shared = {
        "unit_of_measurement": "°",
        "state_class": "measurement_angle",
        "suggested_display_precision": 1,
    }
    parts: dict[str, _Component] = {
        "roll": _sensor("Roll", "roll_deg", attitude, turning, icon="mdi:axis-x-rotation-clockwise"),
        "pitch": _sensor(
            "Pitch",
            "pitch_deg",
            attitude,
            turning,
            # Within +-90 deg: its mean is a plain one.
            state_class="measurement",
            icon="mdi:axis-y-rotation-clockwise",
        ),
        "yaw": _sensor(
            f"Yaw ({yaw})",
            "yaw_deg",
            attitude,
            turning,
            # Unknown from the moment it counts from elsewhere, until the document with the other name is there.
            value_template=f"{{{{ value_json.yaw_deg if value_json.yaw == '{yaw}' else None }}}}",
            icon="mdi:axis-z-rotation-counterclockwise",
        ),
        "still": _binary("Still", "still", attitude),
        "sample_rate": _sensor(
            "Sample rate",
            "rate_hz",
            diagnostics,
            device_class="frequency",
            unit_of_measurement="Hz",
            state_class="measurement",
        ),
        "temperature": _sensor(
            "Chip temperature",
            "temp_degc",
            diagnostics,
            device_class="temperature",
            unit_of_measurement="°C",
            state_class="measurement",
        ),
        "gaps": _sensor("Gaps", "gaps", diagnostics, state_class="total_increasing"),
        "resets": _sensor("Resets", "resets", diagnostics, state_class="total_increasing"),
        "problem": _binary(
            "Problem",
            "problem",
            diagnostics,
            device_class="problem",
            json_attributes_topic=f"{identity.topic}/diagnostics",
        ),
    }
    device = {
        "identifiers": [identity.id],
        "name": f"{identity.host} {identity.name}" + (" (fake)" if identity.fake else ""),
        "sw_version": identity.version,
        # Not known before it has answered.
        **({"model": identity.chip} if identity.chip else {}),
    }
    document = {
        "device": device,
        "origin": {"name": "quavelet", "sw_version": identity.version},
        "availability_topic": f"{identity.topic}/status",
        "qos": mqtt.qos,
        "components": {
            key: {**part, "unique_id": f"{identity.id}_{key}"} for key, part in parts.items()
        },
    }  # fmt: skip
    return msgspec.json.encode(document)


def _sensor(name: str, field: str, *shared: _Shared, **own: str | int) -> _Component:
    part: _Component = {"platform": "sensor", "name": name, "value_template": f"{{{{ value_json.{field} }}}}"}
    for more in shared:
        part.update(more)
    return {**part, **own}


def _binary(name: str, field: str, shared: _Shared, **own: str | int) -> _Component:
    value = f"{{{{ 'ON' if value_json.{field} else 'OFF' }}}}"
    return {"platform": "binary_sensor", "name": name, "value_template": value, **shared, **own}
