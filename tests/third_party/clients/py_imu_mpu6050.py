"""py-imu-mpu6050 on Blinka's PureIO."""

import contextlib
import sys

from adafruit_extended_bus import ExtendedI2C
from imu_mpu6050 import MPU6050
from report import readings, tell

with contextlib.redirect_stdout(sys.stderr):  # it talks
    sensor = MPU6050(ExtendedI2C(1), int(sys.argv[1]))

refused = []
CODES = (0x00, 0x08, 0x10, 0x18)


def set_accel(g: int) -> None:
    code = CODES[(2, 4, 8, 16).index(g)]
    try:
        sensor.set_accel_range(code)
    except TypeError:  # what its set_accel_range does where it gets that far
        refused.append(g)
        sensor.ACCEL_CONFIG = code
        sensor.accel_scale_modifier = sensor.get_accel_scale_modifier()


def set_gyro(dps: int) -> None:
    code = CODES[(250, 500, 1000, 2000).index(dps)]
    try:
        sensor.set_gyro_range(code)
    except TypeError:
        refused.append(dps)
        sensor.GYRO_CONFIG = code
        sensor.gyro_scale_modifier = sensor.get_gyro_scale_modifier()


accel = readings(set_accel, (2, 4, 8, 16), lambda: sensor.get_accel_data().values())
gyro = readings(set_gyro, (250, 500, 1000, 2000), lambda: sensor.get_gyro_data().values())
tell(accel=accel, gyro=gyro, temp=sensor.get_temp, refused=refused)
