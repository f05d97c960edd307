"""Signal K deltas against the published delta schema, written down here, and the specification's signs."""

from __future__ import annotations

import json
from math import pi, radians
from typing import Any

import pytest
from hypothesis import given
from sink_messages import T_NS, message, messages, offset_ns

from quavelet.core.units import NS_PER_S
from quavelet.sinks.encodings.ship_axes import ship_attitude
from quavelet.sinks.encodings.signalk import SignalK
from quavelet.sinks.message import Message

jsonschema = pytest.importorskip("jsonschema", reason="jsonschema is not installed: pip install jsonschema")

ANGLE = {"type": "number", "minimum": -pi, "maximum": pi}
VALUE_OF = {
    "navigation.attitude": {
        "type": ["object", "null"],
        "properties": {"roll": ANGLE, "pitch": {"type": "number", "minimum": -pi / 2, "maximum": pi / 2}, "yaw": ANGLE},
        "required": ["roll", "pitch"],
        "additionalProperties": False,
    },
    "navigation.rateOfTurn": {"type": ["number", "null"]},
    "navigation.headingMagnetic": {"type": ["number", "null"], "minimum": 0, "maximum": 2 * pi},
    "navigation.headingTrue": {"type": ["number", "null"], "minimum": 0, "maximum": 2 * pi},
    "notifications.navigation.attitude": {
        "type": "object",
        "properties": {
            "state": {"enum": ["normal", "alert", "warn", "alarm", "emergency"]},
            "method": {"type": "array", "items": {"enum": ["visual", "sound"]}},
            "message": {"type": "string"},
        },
        "required": ["state", "method", "message"],
        "additionalProperties": False,
    },
}
DELTA = {
    "type": "object",
    "properties": {
        "context": {"const": "vessels.self"},
        "updates": {
            "type": "array",
            "minItems": 1,
            "items": {
                "type": "object",
                "properties": {
                    "$source": {"type": "string", "pattern": r"^quavelet\.[A-Za-z0-9_.:/-]+\.[A-Za-z0-9_.:/-]+$"},
                    "timestamp": {"type": "string", "pattern": r"^\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d\.\d{3}Z$"},
                    "values": {
                        "type": "array",
                        "minItems": 1,
                        "items": {
                            "oneOf": [
                                {
                                    "properties": {"path": {"const": path}, "value": value},
                                    "required": ["path", "value"],
                                    "additionalProperties": False,
                                }
                                for path, value in VALUE_OF.items()
                            ]
                        },
                    },
                },
                "required": ["$source", "timestamp", "values"],
                "additionalProperties": False,
            },
        },
    },
    "required": ["context", "updates"],
    "additionalProperties": False,
}
VALIDATOR = jsonschema.Draft202012Validator(DELTA)
VALIDATOR.check_schema(DELTA)


def delta(told: Message, encoding: SignalK | None = None) -> dict[str, Any]:
    data = (encoding or SignalK(name="imu0", offset_ns=offset_ns)).encode(told)
    assert data.endswith(b"\n") and data.count(b"\n") == 1
    read: dict[str, Any] = json.loads(data, parse_constant=lambda word: pytest.fail(f"{word} went out"))
    return read


def values(told: Message, encoding: SignalK | None = None) -> dict[str, Any]:
    (update,) = delta(told, encoding)["updates"]
    found = {value["path"]: value["value"] for value in update["values"]}
    assert len(found) == len(update["values"])
    return found


@given(messages)
def test_every_message_is_a_delta_of_the_schema_with_the_signs_of_ships(told):
    VALIDATOR.validate(delta(told))
    ship, found = ship_attitude(told), values(told)
    assert ship is not None
    attitude = found["navigation.attitude"]
    if ship.attitude_ok:
        assert attitude["roll"] == pytest.approx(radians(ship.roll_deg), abs=1e-6)
        assert attitude["pitch"] == pytest.approx(radians(ship.pitch_deg), abs=1e-6)
    else:
        assert attitude is None
    turn = found["navigation.rateOfTurn"]
    assert turn == pytest.approx(ship.turn_rad_s, abs=1e-6) if ship.rate_ok else turn is None


@given(messages)
def test_there_is_no_heading_and_no_yaw_unless_it_is_known(told):
    ship, found = ship_attitude(told), values(told)
    assert ship is not None
    headings = {path: value for path, value in found.items() if path.startswith("navigation.heading")}
    if ship.heading_deg is None:
        assert headings == {}
        assert "yaw" not in (found["navigation.attitude"] or {})
    else:
        (path,) = headings
        assert path == f"navigation.heading{told.yaw.capitalize()}"
        assert headings[path] == pytest.approx(radians(ship.heading_deg), abs=1e-6)


def test_a_heading_that_is_lost_or_changes_its_name_does_not_stand_for_ever():
    encoding = SignalK(name="imu0", offset_ns=offset_ns)
    told = [
        message(yaw="magnetic"),
        message(yaw="magnetic", flags=["field_lost"]),
        message(yaw="magnetic"),
        message(yaw="true"),
        message(yaw="true"),
        message(yaw="relative"),
        message(yaw="relative"),
    ]
    headings = [
        {path[18:]: value for path, value in values(one, encoding).items() if path.startswith("navigation.heading")}
        for one in told
    ]
    east = pytest.approx(pi / 2, abs=1e-6)
    assert headings == [
        {"Magnetic": east},
        {"Magnetic": None},
        {"Magnetic": east},
        {"Magnetic": None, "True": east},
        {"True": east},
        {"True": None},
        {},
    ]


def test_a_heading_that_was_never_sent_is_not_taken_back():
    encoding = SignalK(name="imu0", offset_ns=offset_ns)
    told = [message(yaw="magnetic", flags=["field_lost"]), message(yaw="magnetic", flags=["field_lost"]), message()]
    assert not any("heading" in path for one in told for path in values(one, encoding))


def test_doubt_is_a_notification_when_it_changes_and_every_ten_seconds():
    encoding, told = SignalK(name="imu0", offset_ns=offset_ns), []
    for tenth in range(350):
        flags = ["settling"] if tenth < 20 else ["gap"] if tenth == 150 else []
        found = values(message(flags=flags, t_ns=T_NS + tenth * NS_PER_S // 10), encoding)
        if "notifications.navigation.attitude" in found:
            told.append((tenth, found["notifications.navigation.attitude"]["state"]))
    assert told == [
        (0, "warn"), (20, "normal"), (120, "normal"), (150, "alert"), (151, "normal"), (251, "normal"),
    ]  # fmt: skip


def test_source_and_time_are_those_of_the_chip_and_the_world():
    (update,) = delta(message(src='fake:tilt"},{'))["updates"]
    assert update["$source"] == "quavelet.imu0.fake:tilt____"
    assert update["timestamp"] == "2023-11-14T22:13:20.000Z"
