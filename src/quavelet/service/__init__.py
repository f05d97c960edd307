"""The daemon: the chip, its loop and all that takes its messages, run for years."""
