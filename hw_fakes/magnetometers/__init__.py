"""Magnetometers that sit behind the chip on many boards."""
