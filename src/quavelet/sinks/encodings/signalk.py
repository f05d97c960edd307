"""Signal K delta, one line of JSON a message: `navigation.attitude`, `rateOfTurn`, `headingMagnetic`, `headingTrue`.

The specification's signs are those of ship_axes.py: roll to starboard, bow up, yaw and turn to starboard; rad, rad/s.
"""

from __future__ import annotations

from math import radians, trunc

import msgspec

from quavelet.core.wall_clock import OffsetNs
from quavelet.sinks.encodings.doubt import Told, in_words, plain
from quavelet.sinks.encodings.ship_axes import ShipAttitude, ship_attitude
from quavelet.sinks.encodings.wall_time import iso_time
from quavelet.sinks.message import Message

Value = float | dict[str, float] | dict[str, str | list[str]] | None
_HEADINGS = {"magnetic": "navigation.headingMagnetic", "true": "navigation.headingTrue"}


class SignalK:
    """An encoding; `name` and the message's src make the `$source`.

    Doubt: a value that may not be used is null; yaw is part of the attitude only where it is a heading; a heading once
    sent becomes null when it is no longer known. Flags are a notification on `navigation.attitude`, of state alert, or
    warn where the attitude is null, sent when they change and every 10 s.
    """

    def __init__(self, *, name: str, offset_ns: OffsetNs) -> None:
        self._name = plain(name)
        self._offset_ns = offset_ns
        self._told = Told()
        self._heading_path: str | None = None
        self._encoder = msgspec.json.Encoder()

    def encode(self, message: Message) -> bytes:
        ship = ship_attitude(message)
        if ship is None:
            return b""
        values: dict[str, Value] = {
            "navigation.attitude": _attitude(ship) if ship.attitude_ok else None,
            "navigation.rateOfTurn": round(ship.turn_rad_s, 6) if ship.rate_ok else None,
        }
        values.update(self._headings(message, ship))
        words = in_words(message)
        if self._told.due(words, t_ns=message.t_ns):
            state = "normal" if not message.flags else "alert" if ship.attitude_ok else "warn"
            notice: dict[str, str | list[str]] = {"state": state, "message": words}
            notice["method"] = ["visual"] if message.flags else []
            values["notifications.navigation.attitude"] = notice
        update = {
            "$source": f"quavelet.{self._name}.{plain(message.src)}",
            "timestamp": iso_time(message.t_ns + self._offset_ns()),
            "values": [{"path": path, "value": value} for path, value in values.items()],
        }
        return self._encoder.encode({"context": "vessels.self", "updates": [update]}) + b"\n"

    def _headings(self, message: Message, ship: ShipAttitude) -> dict[str, Value]:
        """The heading, and null for one that was sent under the other name or is no longer known."""
        path, values = _HEADINGS.get(message.yaw), dict[str, Value]()
        if self._heading_path is not None:
            values[self._heading_path] = None
        if path is not None and ship.heading_deg is not None:
            values[path] = _rad(ship.heading_deg)
        self._heading_path = path if path in values else None
        return values


def _attitude(ship: ShipAttitude) -> dict[str, float]:
    angles = {"roll": _rad(ship.roll_deg), "pitch": _rad(ship.pitch_deg)}
    if ship.heading_deg is not None:
        angles["yaw"] = _rad(ship.yaw_deg)
    return angles


def _rad(angle_deg: float) -> float:
    """Cut to the microradian: rounded, half a turn would be more than pi."""
    return trunc(1e6 * radians(angle_deg)) / 1e6
