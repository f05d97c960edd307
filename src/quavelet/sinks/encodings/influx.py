"""InfluxDB line protocol, one line a message, with the time of day in ns."""

from __future__ import annotations

from collections.abc import Iterable
from math import isfinite

from quavelet.core.wall_clock import OffsetNs
from quavelet.sinks.message import Message

_IN_TAG = str.maketrans({",": r"\,", "=": r"\=", " ": r"\ ", "\\": "/"})
"""A backslash becomes a slash: at the end of a tag it would take the comma after it for its own."""


class Influx:
    """An encoding of the measurement `attitude`, tags name, src and yaw.

    Doubt is in the fields `flags` (names with commas, "" when all is well) and `doubtful`; yaw is a tag, so that no
    graph joins angles of different origin. A field that is not a number is left out.
    """

    def __init__(self, *, name: str, offset_ns: OffsetNs) -> None:
        self._name = name
        self._offset_ns = offset_ns

    def encode(self, message: Message) -> bytes:
        tags = {"name": self._name, "src": message.src, "yaw": message.yaw}
        keys = "".join(f",{key}={tag(value)}" for key, value in tags.items() if value)
        fields = [f"{key}={value!r}" for key, value in _numbers(message) if isfinite(value)]
        fields += [
            f"still={str(message.still).lower()}",
            f"doubtful={str(bool(message.flags)).lower()}",
            f"flags={string(','.join(message.flags))}",
            f"gap_ns={message.gap_ns}i",
            f"delay_ns={message.delay_ns}i",
        ]
        line = f"attitude{keys} {','.join(fields)} {message.t_ns + self._offset_ns()}\n"
        return line.encode("utf-8", "replace")


def tag(value: str) -> str:
    """A tag's value, escaped; characters that end a line or cannot be seen become _."""
    return _printable(value).translate(_IN_TAG)


def string(value: str) -> str:
    """A field's string in its quotes."""
    escaped = _printable(value).replace("\\", "\\\\").replace('"', '\\"')
    return f'"{escaped}"'


def _printable(value: str) -> str:
    return "".join(c if c.isprintable() else "_" for c in value)


def _numbers(message: Message) -> Iterable[tuple[str, float]]:
    yield "roll_deg", message.roll_deg
    yield "pitch_deg", message.pitch_deg
    yield "yaw_deg", message.yaw_deg
    yield "temp_degc", message.temp_degc
    yield from zip(("q_w", "q_x", "q_y", "q_z"), message.q, strict=True)
    for values, name, unit in (
        (message.sigma_deg, "sigma", "deg"),
        (message.gyro_rad_s, "gyro", "rad_s"),
        (message.accel_m_s2, "accel", "m_s2"),
        (message.gyro_bias_rad_s, "gyro_bias", "rad_s"),
    ):
        for axis, value in zip("xyz", values, strict=True):
            yield f"{name}_{axis}_{unit}", value
