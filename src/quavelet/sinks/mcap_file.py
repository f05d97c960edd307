"""The messages as MCAP while they come: `quavelet run --mcap FILE`, and [recording] with format = "mcap"."""

from __future__ import annotations

from typing import Protocol

from quavelet.core.units import RAD_PER_DEG
from quavelet.recording.mcap import Sample
from quavelet.sinks.message import Message


class SampleWriter(Protocol):
    """Where samples go: `McapWriter`, `RotatingMcap`."""

    def write(self, item: Sample, /) -> None: ...

    def close(self) -> None: ...


class McapFile:
    """A sink that writes each message to `writer`, and closes it at the end. A disk may block: not for the network."""

    def __init__(self, writer: SampleWriter) -> None:
        self._writer = writer

    def write(self, message: Message) -> None:
        x, y, z = message.sigma_deg
        self._writer.write(
            Sample(
                message.t_ns,
                message.q,
                (RAD_PER_DEG * x, RAD_PER_DEG * y, RAD_PER_DEG * z),
                message.gyro_rad_s,
                message.accel_m_s2,
                message.flags,
                message.yaw,
                message.gap_ns,
            )
        )

    def close(self) -> None:
        self._writer.close()
