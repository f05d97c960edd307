"""mpu6050-raspberrypi on the C extension smbus."""

import sys

from mpu6050 import mpu6050
from report import readings, tell

sensor = mpu6050(int(sys.argv[1]))
tell(
    accel=readings(
        lambda g: sensor.set_accel_range({2: 0x00, 4: 0x08, 8: 0x10, 16: 0x18}[g]),
        (2, 4, 8, 16),
        lambda: sensor.get_accel_data().values(),
    ),
    gyro=readings(
        lambda dps: sensor.set_gyro_range({250: 0x00, 500: 0x08, 1000: 0x10, 2000: 0x18}[dps]),
        (250, 500, 1000, 2000),
        lambda: sensor.get_gyro_data().values(),
    ),
    temp=sensor.get_temp(),
)
