"""Which way is up: attitude from an MPU-6050, over I2C, in real time.

import quavelet

with quavelet.open("fake:tilt") as imu:
    for attitude in imu:
        print(attitude.roll_deg, attitude.pitch_deg)
"""

from quavelet.core.errors import ImuError
from quavelet.imu import Imu
from quavelet.imu import open_imu as open
from quavelet.sinks.message import Message

__all__ = ["Imu", "ImuError", "Message", "open"]
