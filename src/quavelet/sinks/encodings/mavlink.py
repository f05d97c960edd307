"""MAVLink 2 by pymavlink: ATTITUDE and ATTITUDE_QUATERNION each message, HEARTBEAT, SYS_STATUS and STATUSTEXT at times.

The axes are those of ship_axes.py, forward, starboard, down to north, east, down. The only file that imports pymavlink.
"""

from __future__ import annotations

from collections.abc import Iterator
from types import ModuleType
from typing import TYPE_CHECKING

from quavelet.core.errors import SettingsError
from quavelet.core.units import NS_PER_MS, NS_PER_S, RAD_PER_DEG
from quavelet.sinks.encodings.doubt import Told, in_words
from quavelet.sinks.encodings.ship_axes import ShipAttitude, ship_attitude, ship_quaternion
from quavelet.sinks.message import Message

if TYPE_CHECKING:
    from pymavlink.dialects.v20 import common

_TEXT_BYTES = 50
_NOT_MEASURED = 65535


class Mavlink:
    """An encoding: a run of packets of component `component` of system `system`, with their own sequence.

    Doubt: where roll and pitch may not be used ATTITUDE is withheld. The heartbeat, each second, is CALIBRATING then,
    CRITICAL with any other flag, ACTIVE with none; SYS_STATUS has the gyroscope, the attitude and, where yaw has a
    north, the magnetometer as healthy or not. STATUSTEXT says flags and the kind of yaw in words when they change and
    every 10 s: a yaw that is relative has no other sign in MAVLink.
    Raises SettingsError where pymavlink is not installed.
    """

    def __init__(self, *, system: int = 1, component: int = 1) -> None:
        self._dialect = _library()
        self._mav = self._dialect.MAVLink(None, srcSystem=system, srcComponent=component)
        self._told = Told()
        self._second: int | None = None
        self._text = 0

    def encode(self, message: Message) -> bytes:
        ship = ship_attitude(message)
        if ship is None:
            return b""
        return b"".join(map(self._packet, self._messages(message, ship)))

    def _packet(self, message: common.MAVLink_message) -> bytes:
        packet = message.pack(self._mav)
        self._mav.seq = (self._mav.seq + 1) % 256
        return packet

    def _messages(self, message: Message, ship: ShipAttitude) -> Iterator[common.MAVLink_message]:
        d = self._dialect
        second = message.t_ns // NS_PER_S
        if second != self._second:
            self._second = second
            yield self._heartbeat(message, ship)
            yield self._sys_status(message, ship)
        if self._told.due(words := in_words(message), t_ns=message.t_ns):
            yield from self._texts(words, d.MAV_SEVERITY_WARNING if message.flags else d.MAV_SEVERITY_INFO)
        if ship.attitude_ok:
            # Ground stations count in milliseconds since boot, 32 bits: they begin anew after 49.7 days.
            t_ms = message.t_ns // NS_PER_MS & 0xFFFFFFFF
            roll, pitch, yaw = (RAD_PER_DEG * a for a in (ship.roll_deg, ship.pitch_deg, ship.yaw_deg))
            yield d.MAVLink_attitude_message(t_ms, roll, pitch, yaw, *ship.rate_rad_s)
            yield d.MAVLink_attitude_quaternion_message(t_ms, *ship_quaternion(message), *ship.rate_rad_s)

    def _heartbeat(self, message: Message, ship: ShipAttitude) -> common.MAVLink_message:
        d = self._dialect
        state = d.MAV_STATE_CRITICAL if message.flags else d.MAV_STATE_ACTIVE
        state = state if ship.attitude_ok else d.MAV_STATE_CALIBRATING
        heartbeat: common.MAVLink_message = d.MAVLink_heartbeat_message(
            d.MAV_TYPE_GENERIC, d.MAV_AUTOPILOT_INVALID, 0, 0, state, 3
        )
        return heartbeat

    def _sys_status(self, message: Message, ship: ShipAttitude) -> common.MAVLink_message:
        d = self._dialect
        present = d.MAV_SYS_STATUS_SENSOR_3D_GYRO | d.MAV_SYS_STATUS_SENSOR_3D_ACCEL | d.MAV_SYS_STATUS_AHRS
        healthy = d.MAV_SYS_STATUS_SENSOR_3D_GYRO if ship.rate_ok else 0
        healthy |= d.MAV_SYS_STATUS_AHRS if ship.attitude_ok else 0
        healthy |= 0 if {"stuck", "accel_clipped"} & set(message.flags) else d.MAV_SYS_STATUS_SENSOR_3D_ACCEL
        if message.yaw != "relative":
            present |= d.MAV_SYS_STATUS_SENSOR_3D_MAG
            healthy |= d.MAV_SYS_STATUS_SENSOR_3D_MAG if ship.heading_deg is not None else 0
        power = 0, _NOT_MEASURED, -1, -1
        status: common.MAVLink_message = d.MAVLink_sys_status_message(
            present, present, healthy, *power, 0, 0, 0, 0, 0, 0
        )
        return status

    def _texts(self, words: str, severity: int) -> Iterator[common.MAVLink_message]:
        """The words in parts of 50, which receivers join by their number; 0 would be a text of one part."""
        self._text = self._text % 65535 + 1
        data = words.encode("ascii")
        # A part of 50 bytes says that there is another, so an empty one ends a text that fills its last.
        for part in range(len(data) // _TEXT_BYTES + 1):
            text = data[part * _TEXT_BYTES : (part + 1) * _TEXT_BYTES]
            yield self._dialect.MAVLink_statustext_message(severity, text, self._text, part)


def _library() -> ModuleType:
    try:
        from pymavlink.dialects.v20 import common
    except ImportError as error:
        raise SettingsError(
            "encoding = 'mavlink' needs pymavlink: install it, with `pip install 'quavelet[mavlink]'`"
        ) from error
    return common
