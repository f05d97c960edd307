"""NMEA 0183: PASHR, XDR, ROT and, where there is a north, HDM or HDT.

PASHR as Applanix, NovAtel and Trimble have it: time, true heading, T, roll, pitch, heave, accuracies of roll, pitch and
heading, GNSS quality (0: none), IMU status (1: satisfactory, 0: not). Signs as in ship_axes.py.
"""

from __future__ import annotations

from math import degrees

from quavelet.core.wall_clock import OffsetNs
from quavelet.sinks.encodings.doubt import Told, in_words
from quavelet.sinks.encodings.ship_axes import ShipAttitude, ship_attitude
from quavelet.sinks.encodings.wall_time import time_of_day
from quavelet.sinks.message import Message

TALKER = "II"
"""Integrated instrumentation."""
_TEXT = 60
"""Letters of a text that fit a sentence of 82."""


class Nmea:
    """An encoding of several sentences a message, each with its end of line.

    Doubt: any flag makes PASHR's status 0; roll and pitch that may not be used leave it empty and XDR unsent; a rate
    that may not be used is ROT,,V; a heading that is relative or doubtful is not sent, and PASHR has a true one only.
    TXT has source, kind of yaw and flags in words when they change, and every 10 s.
    """

    def __init__(self, *, offset_ns: OffsetNs) -> None:
        self._offset_ns = offset_ns
        self._told = Told()

    def encode(self, message: Message) -> bytes:
        ship = ship_attitude(message)
        if ship is None:
            return b""
        bodies = [_pashr(message, ship, time_of_day(message.t_ns + self._offset_ns()))]
        if ship.attitude_ok:
            pitch, roll = _number(ship.pitch_deg, 2), _number(ship.roll_deg, 2)
            bodies.append(f"{TALKER}XDR,A,{pitch},D,PITCH,A,{roll},D,ROLL")
        turn = f"{_number(60 * degrees(ship.turn_rad_s), 1)},A" if ship.rate_ok else ",V"
        bodies.append(f"{TALKER}ROT,{turn}")
        if ship.heading_deg is not None:
            letter = "M" if message.yaw == "magnetic" else "T"
            bodies.append(f"{TALKER}HD{letter},{_heading(ship.heading_deg, 1)},{letter}")
        words = in_words(message)
        if self._told.due(words, t_ns=message.t_ns):
            bodies.append(f"{TALKER}TXT,01,01,{'01' if message.flags else '02'},{words[:_TEXT]}")
        return b"".join(map(sentence, bodies))


def sentence(body: str) -> bytes:
    """`body` between $ and its checksum, the exclusive or of its bytes."""
    data, check = body.encode("ascii", "replace"), 0
    for byte in data:
        check ^= byte
    return b"$%b*%02X\r\n" % (data, check)


def _pashr(message: Message, ship: ShipAttitude, time: str) -> str:
    heading, roll, pitch = ",", "", ""
    accuracy = ["", "", ""]
    if ship.attitude_ok:
        roll, pitch = _number(ship.roll_deg, 2), _number(ship.pitch_deg, 2)
        accuracy[:2] = (f"{sigma:.3f}" for sigma in ship.sigma_deg[:2])
    if message.yaw == "true" and ship.heading_deg is not None:
        heading, accuracy[2] = f"{_heading(ship.heading_deg, 2)},T", f"{ship.sigma_deg[2]:.3f}"
    status = 0 if message.flags else 1
    return f"PASHR,{time},{heading},{roll},{pitch},,{','.join(accuracy)},0,{status}"


def _number(value: float, digits: int) -> str:
    """Rounded, and never -0.00."""
    return f"{round(value, digits) + 0.0:.{digits}f}"


def _heading(degrees_: float, digits: int) -> str:
    """Rounded, and never 360.0."""
    return f"{round(degrees_, digits) % 360.0:.{digits}f}"
