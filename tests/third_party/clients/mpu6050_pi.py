"""mpu6050-PI on the C extension smbus."""

import sys
import time

from MPU6050.MPU6050 import MPU6050
from report import readings, tell

sensor = MPU6050(int(sys.argv[1]))
time.sleep(0.05)
tell(
    accel=readings(
        lambda g: sensor.accel_config(FULL_SCALE_RANGE=f"{g}g"),
        (2, 4, 8, 16),
        lambda: sensor.read_accelerometer().values(),
    ),
    gyro=readings(
        lambda dps: sensor.gyro_config(FULL_SCALE_RANGE=dps),
        (250, 500, 1000, 2000),
        lambda: sensor.read_gyroscope().values(),
    ),
    temp=sensor.get_temperature(),
    self_test=sensor.self_test(),
)
