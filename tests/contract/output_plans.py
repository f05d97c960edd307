"""Plans of outputs, and a service whose state a test says."""

from __future__ import annotations

import msgspec

from quavelet.core.clock import MonotonicClock
from quavelet.core.health import Health
from quavelet.core.wall_clock import offset_from
from quavelet.loop.deadline import LoopStats
from quavelet.settings.outputs import OutputSettings
from quavelet.sinks.message import Message
from quavelet.sinks.plan import OutputPlan
from quavelet.sinks.status import ClockStatus, Status

MESSAGE = Message(
    t_ns=1_000_000_000,
    q=(1.0, 0.0, 0.0, 0.0),
    roll_deg=1.5,
    pitch_deg=-2.25,
    yaw_deg=30.0,
    sigma_deg=(0.1, 0.1, 3.0),
    gyro_rad_s=(0.0, 0.0, 0.0),
    accel_m_s2=(0.0, 0.0, 9.80665),
    temp_degc=31.25,
    gyro_bias_rad_s=(0.0, 0.0, 0.0),
    still=True,
    flags=[],
    gap_ns=0,
    delay_ns=0,
    src="fake:tilt",
)
STATUS = Status(
    name="imu",
    src="fake:tilt",
    fake=True,
    chip="MPU-6050",
    address=0x68,
    version="0.1.0",
    uptime_s=12.5,
    state="running",
    message=MESSAGE,
    rate_hz=200.04,
    health={**Health().as_dict(), "gaps": 3, "fifo_resets": 2, "chip_restarts": 1},
    loop=LoopStats(*[0] * 8),
    clock=ClockStatus(offset_ns=1_700_000_000_000_000_000, synchronised=True),
    boot_id="b",
    pid=1,
)


class Service:
    """Whatever a test says it is."""

    def __init__(self, status: Status = STATUS) -> None:
        self.status = status

    def change(self, **fields: object) -> None:
        self.status = msgspec.structs.replace(self.status, **fields)


def mqtt_plan(
    to: str,
    *,
    service: Service | None = None,
    encoding: str = "json",
    name: str = "home",
    service_name: str = "imu",
    **mqtt: object,
) -> OutputPlan:
    """An output to a broker; `mqtt` are keys of [output.NAME.mqtt]."""
    table = {"to": to, "encoding": encoding, "mqtt": mqtt}
    there = service or Service()
    return OutputPlan(
        name=name,
        settings=msgspec.convert(table, OutputSettings),
        service=service_name,
        status=lambda: there.status,
        offset_ns=offset_from(MonotonicClock()),
    )
