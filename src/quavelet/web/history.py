"""The last ten minutes for who comes later: a row every 0.1 s, kept as JSON, so that giving it costs little."""

from __future__ import annotations

from collections import deque

import msgspec

from quavelet.core.units import DEG_PER_RAD
from quavelet.sinks.message import Message
from quavelet.sinks.thinning import Thinning
from quavelet.web.frames import text_frame

RATE_HZ = 10.0
ROWS = 6000
"""Ten minutes."""
CHUNK = 100
"""Rows that are put into JSON together, as soon as they are there."""
COLUMNS = (
    "t_ns",
    "roll_deg",
    "pitch_deg",
    "yaw_deg",
    "sigma_yaw_deg",
    "gyro_x_dps",
    "gyro_y_dps",
    "gyro_z_dps",
    "temp_degc",
    "gap_ns",
)
Row = tuple[float, ...]


class History:
    """Rows of the messages, oldest first; what those between two rows say of gaps is in the later one."""

    def __init__(self) -> None:
        self.clear()

    def clear(self) -> None:
        """Begin anew, as after a jump in time."""
        self._thinning = Thinning(rate_hz=RATE_HZ)
        self._chunks: deque[tuple[bytes, ...]] = deque(maxlen=ROWS // CHUNK)
        self._rows: list[Row] = []

    def add(self, message: Message) -> None:
        taken = self._thinning.take(message)
        if taken is None:
            return
        self._rows.append(row_of(taken))
        if len(self._rows) == CHUNK:
            self._chunks.append(_columns(self._rows))
            self._rows.clear()

    def frame(self) -> bytes:
        """All rows, column by column."""
        chunks = [*self._chunks, *([_columns(self._rows)] if self._rows else [])]
        columns = (
            b'"%b":[%b]' % (name.encode(), b",".join(chunk[i] for chunk in chunks)) for i, name in enumerate(COLUMNS)
        )
        return text_frame(b'{"is":"history",%b}' % b",".join(columns))


def row_of(message: Message) -> Row:
    """One row, rounded to what can be seen."""
    x, y, z = (round(DEG_PER_RAD * rate, 2) for rate in message.gyro_rad_s)
    return (
        message.t_ns,
        round(message.roll_deg, 2),
        round(message.pitch_deg, 2),
        round(message.yaw_deg, 2),
        round(message.sigma_deg[2], 3),
        x,
        y,
        z,
        round(message.temp_degc, 2),
        message.gap_ns,
    )


def _columns(rows: list[Row]) -> tuple[bytes, ...]:
    """Each column of these rows as JSON, without the brackets."""
    return tuple(msgspec.json.encode(column)[1:-1] for column in zip(*rows, strict=True))
