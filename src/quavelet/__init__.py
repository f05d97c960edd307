"""Which way is up: attitude from an MPU-6050, over I2C, in real time."""
