"""The magnetometer on the chip's auxiliary bus: which one it is, and its field by the bypass or the chip's master."""
