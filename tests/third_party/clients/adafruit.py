"""adafruit-circuitpython-mpu6050 on Blinka's PureIO."""

import math
import sys

from adafruit_extended_bus import ExtendedI2C
from adafruit_mpu6050 import MPU6050
from report import readings, tell

i2c = ExtendedI2C(1)
sensor = MPU6050(i2c, int(sys.argv[1]))
at_start = sensor.gyro_range


def set_accel(g: int) -> None:
    sensor.accelerometer_range = (2, 4, 8, 16).index(g)


def set_gyro(dps: int) -> None:
    sensor.gyro_range = (250, 500, 1000, 2000).index(dps)


accel = readings(set_accel, (2, 4, 8, 16), lambda: sensor.acceleration)
gyro = readings(set_gyro, (250, 500, 1000, 2000), lambda: map(math.degrees, sensor.gyro))
for bandwidth in range(7):
    sensor.filter_bandwidth = bandwidth
tell(accel=accel, gyro=gyro, temp=sensor.temperature, gyro_range_at_start=at_start, found=i2c.scan())
