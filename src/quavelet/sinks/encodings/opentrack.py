"""OpenTrack's "UDP over network": x, y, z in cm, yaw, pitch, roll in degrees, six little-endian doubles a datagram."""

from __future__ import annotations

import struct

from quavelet.sinks.encodings.ship_axes import ship_attitude
from quavelet.sinks.message import Message

_SIX = struct.Struct("<6d")


class OpenTrack:
    """An encoding; there is no field for doubt: what may not be used is withheld, and the view stands.

    Yaw counts from where it does in the message and grows to the right; OpenTrack's centre key takes out the rest.
    """

    def encode(self, message: Message) -> bytes:
        ship = ship_attitude(message)
        if ship is None or not ship.attitude_ok:
            return b""
        return _SIX.pack(0.0, 0.0, 0.0, ship.yaw_deg, ship.pitch_deg, ship.roll_deg)
