"""Home Assistant's device discovery, against a schema of its documented rules and the template language it uses."""

from __future__ import annotations

import json
from typing import Any, get_args

import jinja2
import jsonschema
import msgspec
import pytest
from output_plans import MESSAGE, STATUS

from quavelet.settings.outputs import MqttSettings
from quavelet.sinks.home_assistant import diagnostics_of, discovery, discovery_topic
from quavelet.sinks.identity import Identity, identity_of
from quavelet.sinks.message import Message, Yaw

# Facts from https://www.home-assistant.io/integrations/mqtt (Device discovery payload; Adding information about the
# origin), /integrations/sensor.mqtt, /integrations/binary_sensor.mqtt, /integrations/sensor (device classes and their
# units, state classes) and, where the pages leave it open, homeassistant/components/mqtt/schemas.py and sensor.py:
# device and origin are mandatory and take no other keys; every component has a platform, an entity also a unique_id;
# a device class takes its units only, and so does measurement_angle; diagnostic is the one category of a sensor.
TOPIC = {"type": "string", "pattern": "^[^#+\\0/$][^#+\\0]*$", "maxLength": 65535}
TEXT = {"type": "string", "minLength": 1}
SHARED = {
    "availability_topic": TOPIC,
    "availability": {"type": "array"},
    "availability_mode": {"enum": ["all", "any", "latest"]},
    "payload_available": TEXT,
    "payload_not_available": TEXT,
    "state_topic": TOPIC,
    "command_topic": TOPIC,
    "qos": {"enum": [0, 1, 2]},
    "encoding": TEXT,
}
ENTITY = {
    **{key: rule for key, rule in SHARED.items() if key != "command_topic"},
    "unique_id": {"type": "string", "pattern": "^[a-zA-Z0-9_-]+$"},
    "name": TEXT,
    "value_template": TEXT,
    "expire_after": {"type": "integer", "minimum": 1},
    "force_update": {"type": "boolean"},
    "entity_category": {"const": "diagnostic"},
    "enabled_by_default": {"type": "boolean"},
    "icon": {"type": "string", "pattern": "^mdi:[a-z0-9-]+$"},
    "json_attributes_topic": TOPIC,
    "json_attributes_template": TEXT,
}
UNITS = {
    "temperature": ["°C", "°F", "K"],
    "frequency": ["Hz", "kHz", "MHz", "GHz"],
    "duration": ["d", "h", "min", "s", "ms", "µs"],
}
SENSOR = {
    "type": "object",
    "properties": {
        **ENTITY,
        "platform": {"const": "sensor"},
        "device_class": {"enum": list(UNITS)},
        "state_class": {"enum": ["measurement", "measurement_angle", "total", "total_increasing"]},
        "unit_of_measurement": TEXT,
        "suggested_display_precision": {"type": "integer", "minimum": 0},
    },
    "required": ["platform", "unique_id", "state_topic"],
    "additionalProperties": False,
    "allOf": [
        {
            "if": {"properties": {"state_class": {"const": "measurement_angle"}}, "required": ["state_class"]},
            "then": {"properties": {"unit_of_measurement": {"const": "°"}}, "required": ["unit_of_measurement"]},
        },
        *(
            {
                "if": {"properties": {"device_class": {"const": name}}, "required": ["device_class"]},
                "then": {"properties": {"unit_of_measurement": {"enum": units}}, "required": ["unit_of_measurement"]},
            }
            for name, units in UNITS.items()
        ),
    ],
}
BINARY = {
    "type": "object",
    "properties": {
        **ENTITY,
        "platform": {"const": "binary_sensor"},
        "device_class": {"enum": ["problem", "moving", "motion", "vibration", "running", "connectivity"]},
        "payload_on": TEXT,
        "payload_off": TEXT,
        "off_delay": {"type": "integer", "minimum": 1},
    },
    "required": ["platform", "unique_id", "state_topic"],
    "additionalProperties": False,
}
SCHEMA = {
    "$schema": "https://json-schema.org/draft/2020-12/schema",
    "type": "object",
    "properties": {
        **SHARED,
        "device": {
            "type": "object",
            "properties": {
                "identifiers": {"type": "array", "items": TEXT, "minItems": 1},
                "connections": {"type": "array"},
                **dict.fromkeys(
                    ["manufacturer", "model", "model_id", "name", "hw_version", "serial_number", "sw_version"], TEXT
                ),
                **dict.fromkeys(["via_device", "suggested_area", "configuration_url"], TEXT),
            },
            "anyOf": [{"required": ["identifiers"]}, {"required": ["connections"]}],
            "additionalProperties": False,
        },
        "origin": {
            "type": "object",
            "properties": dict.fromkeys(["name", "sw_version", "support_url"], TEXT),
            "required": ["name"],
            "additionalProperties": False,
        },
        "components": {
            "type": "object",
            "minProperties": 1,
            "additionalProperties": {
                "if": {"properties": {"platform": {"const": "sensor"}}},
                "then": SENSOR,
                "else": BINARY,
            },
        },
    },
    "required": ["device", "origin", "components"],
    "additionalProperties": False,
}
IDENTITY = identity_of(STATUS, host="pi", topic="quavelet/pi/imu", encoding="json")
DIAGNOSTICS = diagnostics_of(STATUS, lost=4)


def document(identity: Identity = IDENTITY, *, yaw: Yaw = "relative", **mqtt: Any) -> dict[str, Any]:
    found: dict[str, Any] = json.loads(discovery(identity, mqtt=MqttSettings(**mqtt), yaw=yaw))
    return found


def shown(part: dict[str, Any], *, message: Message = MESSAGE) -> str:
    """What the entity shows, by Home Assistant's own template engine; "None" is unknown."""
    published = message if part["state_topic"] == "quavelet/pi/imu/attitude" else DIAGNOSTICS
    template = jinja2.Environment(undefined=jinja2.StrictUndefined).from_string(part["value_template"])
    return template.render(value_json=json.loads(msgspec.json.encode(published)))


def test_the_schema_refuses_what_home_assistant_refuses() -> None:
    jsonschema.Draft202012Validator.check_schema(SCHEMA)
    for break_it in (
        lambda d: d.pop("origin"),
        lambda d: d["device"].pop("identifiers"),
        lambda d: d["components"]["roll"].pop("platform"),
        lambda d: d["components"]["roll"].pop("unique_id"),
        lambda d: d["components"]["roll"].update(unit_of_measurement="deg"),
        lambda d: d["components"]["roll"].update(state_topic="quavelet/+/imu"),
        lambda d: d["components"]["temperature"].update(unit_of_measurement="C"),
        lambda d: d["components"]["gaps"].update(entity_category="config"),
        lambda d: d["components"]["problem"].update(expire_after=2.5),
        lambda d: d["components"]["problem"].update(state_class="measurement"),
    ):
        broken = document()
        break_it(broken)
        with pytest.raises(jsonschema.ValidationError):
            jsonschema.validate(broken, SCHEMA)


@pytest.mark.parametrize("yaw", get_args(Yaw))
@pytest.mark.parametrize("chip", ["", "MPU-6500"])
@pytest.mark.parametrize("mqtt", [{}, {"qos": 0, "expire_after_s": 2.5}, {"expire_after_s": 3600.0}])
def test_home_assistant_takes_the_document(yaw: Yaw, chip: str, mqtt: dict[str, Any]) -> None:
    identity = msgspec.structs.replace(IDENTITY, chip=chip)
    found = document(identity, yaw=yaw, **mqtt)
    jsonschema.validate(found, SCHEMA)
    assert found["device"].get("model", "") == chip, "a chip that has not answered has no name"


def test_every_entity_shows_its_value() -> None:
    parts = document()["components"]
    assert {key: shown(part) for key, part in parts.items()} == {
        "roll": "1.5",
        "pitch": "-2.25",
        "yaw": "30.0",
        "still": "ON",
        "sample_rate": "200.04",
        "temperature": "31.25",
        "gaps": "3",
        "resets": "3",
        "problem": "OFF",
    }


def test_yaw_says_what_it_counts_from_and_is_unknown_the_moment_it_counts_from_elsewhere() -> None:
    magnetic = msgspec.structs.replace(MESSAGE, yaw="magnetic")
    relative_yaw, magnetic_yaw = (document(yaw=yaw)["components"]["yaw"] for yaw in ("relative", "magnetic"))
    assert (relative_yaw["name"], magnetic_yaw["name"]) == ("Yaw (relative)", "Yaw (magnetic)")
    assert (shown(relative_yaw), shown(relative_yaw, message=magnetic)) == ("30.0", "None")
    assert (shown(magnetic_yaw), shown(magnetic_yaw, message=magnetic)) == ("None", "30.0")


def test_entities_keep_their_ids_whatever_is_known_of_the_chip() -> None:
    def ids(identity: Identity, yaw: Yaw) -> list[str]:
        return [part["unique_id"] for part in document(identity, yaw=yaw)["components"].values()]

    unknown = msgspec.structs.replace(IDENTITY, chip="", version="9", host="renamed")
    assert ids(IDENTITY, "relative") == ids(unknown, "true")
    assert len(set(ids(IDENTITY, "relative"))) == len(ids(IDENTITY, "relative"))
    assert discovery_topic(IDENTITY, mqtt=MqttSettings()) == f"homeassistant/device/{IDENTITY.id}/config"


def test_a_fake_chip_is_called_so() -> None:
    assert "fake" in document()["device"]["name"]
    assert "fake" not in document(msgspec.structs.replace(IDENTITY, fake=False))["device"]["name"]


@pytest.mark.parametrize(
    ("state", "flags", "problem"),
    [
        ("running", [], False),
        ("settling", [], False),
        ("waiting for the chip", [], True),
        ("lost: nothing answers at 0x68", [], True),
        ("running", ["heading_suspect"], True),
    ],
)
def test_the_problem_sensor_is_on_when_something_is_wrong(state: str, flags: list[str], problem: bool) -> None:
    status = msgspec.structs.replace(STATUS, state=state, message=msgspec.structs.replace(MESSAGE, flags=flags))
    assert diagnostics_of(status, lost=0).problem is problem


def test_before_the_first_message_the_diagnostics_know_nothing_they_do_not_know() -> None:
    none = diagnostics_of(msgspec.structs.replace(STATUS, message=None, rate_hz=None), lost=0)
    assert (none.rate_hz, none.temp_degc, none.flags) == (None, None, [])
