"""The chip: registers, configuration, FIFO, time base, and the source of raw blocks."""
