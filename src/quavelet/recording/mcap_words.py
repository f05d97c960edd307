"""What an MCAP file's messages are made of, and their JSON schemas.

`foxglove.FrameTransform` and `foxglove.Log` are Foxglove's, `sensor_msgs/msg/Imu` and `MagneticField` have ROS's fields
and units; a time is `sec` and `nsec` in all of them, as Foxglove has it. `SCHEMAS` is by the schema's name.
"""

from __future__ import annotations

import msgspec

from quavelet.core.units import NS_PER_S

Nine = tuple[float, float, float, float, float, float, float, float, float]
Schema = dict[str, object]

UNKNOWN: Nine = (0.0,) * 9
"""A covariance nobody knows (sensor_msgs/Imu)."""
NOT_MEASURED: Nine = (-1.0, *UNKNOWN[1:])
"""A covariance of what is not measured at all."""


class Time(msgspec.Struct, frozen=True):
    """Since 1970, UTC."""

    sec: int
    nsec: int


class Vector(msgspec.Struct, frozen=True):
    x: float
    y: float
    z: float


class Rotation(msgspec.Struct, frozen=True):
    x: float
    y: float
    z: float
    w: float


class FrameTransform(msgspec.Struct, frozen=True):
    """`rotation` takes a vector of the child's frame to the parent's."""

    timestamp: Time
    parent_frame_id: str
    child_frame_id: str
    rotation: Rotation
    translation: Vector = Vector(0.0, 0.0, 0.0)


class Header(msgspec.Struct, frozen=True):
    stamp: Time
    frame_id: str


class Imu(msgspec.Struct, frozen=True):
    """rad/s and m/s^2, +g up at rest; covariances row by row about x y z, the orientation's about the world's."""

    header: Header
    orientation: Rotation
    orientation_covariance: Nine
    angular_velocity: Vector
    linear_acceleration: Vector
    angular_velocity_covariance: Nine = UNKNOWN
    linear_acceleration_covariance: Nine = UNKNOWN


class MagneticField(msgspec.Struct, frozen=True):
    """Tesla."""

    header: Header
    magnetic_field: Vector
    magnetic_field_covariance: Nine = UNKNOWN


class Log(msgspec.Struct, frozen=True):
    """`level` is 2 for information, 3 for a warning."""

    timestamp: Time
    level: int
    message: str
    name: str = "quavelet"
    file: str = ""
    line: int = 0


def time_of(t_ns: int) -> Time:
    """Of ns since 1970."""
    return Time(*divmod(t_ns, NS_PER_S))


def _object(title: str, **properties: Schema) -> Schema:
    return {"title": title, "type": "object", "properties": properties, "required": list(properties)}


def _numbers(title: str, names: str) -> Schema:
    number: Schema = {"type": "number"}
    return _object(title, **dict.fromkeys(names, number))


_TIME: Schema = {
    "title": "time",
    "type": "object",
    "properties": {
        "sec": {"type": "integer", "minimum": 0},
        "nsec": {"type": "integer", "minimum": 0, "maximum": NS_PER_S - 1},
    },
    "required": ["sec", "nsec"],
}
_TEXT: Schema = {"type": "string"}
_NINE: Schema = {"type": "array", "items": {"type": "number"}, "minItems": 9, "maxItems": 9}
_HEADER = _object("std_msgs/msg/Header", stamp=_TIME, frame_id=_TEXT)
_ROS_VECTOR = _numbers("geometry_msgs/msg/Vector3", "xyz")

SCHEMAS: dict[str, Schema] = {
    "foxglove.FrameTransform": _object(
        "foxglove.FrameTransform",
        timestamp=_TIME,
        parent_frame_id=_TEXT,
        child_frame_id=_TEXT,
        translation=_numbers("foxglove.Vector3", "xyz"),
        rotation=_numbers("foxglove.Quaternion", "xyzw"),
    ),
    "foxglove.Log": _object(
        "foxglove.Log",
        timestamp=_TIME,
        level={"type": "integer", "enum": [0, 1, 2, 3, 4, 5]},
        message=_TEXT,
        name=_TEXT,
        file=_TEXT,
        line={"type": "integer", "minimum": 0},
    ),
    "sensor_msgs/msg/Imu": _object(
        "sensor_msgs/msg/Imu",
        header=_HEADER,
        orientation=_numbers("geometry_msgs/msg/Quaternion", "xyzw"),
        orientation_covariance=_NINE,
        angular_velocity=_ROS_VECTOR,
        angular_velocity_covariance=_NINE,
        linear_acceleration=_ROS_VECTOR,
        linear_acceleration_covariance=_NINE,
    ),
    "sensor_msgs/msg/MagneticField": _object(
        "sensor_msgs/msg/MagneticField",
        header=_HEADER,
        magnetic_field=_ROS_VECTOR,
        magnetic_field_covariance=_NINE,
    ),
}
