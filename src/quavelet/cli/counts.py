"""What was counted, in words for the person who reads it."""

from __future__ import annotations

from collections.abc import Iterator

from quavelet.core.health import Health

TOLD_BEFORE = ("samples", "samples_lost", "gaps")
USUAL = ("drains", "fifo_empty")

WORDS: dict[str, str] = {
    "fifo_overflows": "the chip's FIFO overflowed, since the host came too late",
    "fifo_near_full": "the chip's FIFO was almost full and was emptied, since the host came too late",
    "fifo_misaligned": "the FIFO did not hold whole samples",
    "fifo_resets": "the FIFO was emptied, and what was in it is lost",
    "frames_implausible": "a sample was thrown away, since no sensor gives such",
    "spikes": "a sample stood alone and was thrown away, a bit may have flipped on the wires",
    "counts_surprising": "far more or fewer samples had come than the chip's rate makes",
    "bus_errors": "a transfer failed",
    "bus_retries": "a failed transfer was repeated at once",
    "outages": "the chip could not be read for so long that it was reset",
    "chip_restarts": "the chip was reset and set up again",
    "config_mismatches": "a setting did not read back as written",
    "registers_upset": "the chip changed a setting by itself, as when its supply dips",
    "starved": "no sample came for much longer than one takes",
    "stuck": "no axis changed for so long that the chip was taken to be stuck",
    "slow_queries": "the FIFO was asked too slowly to time samples by, the host was busy",
    "rate_out_of_bounds": "a measured sample rate was outside what the chip can do, and not used",
    "data_ready_missed": "the data-ready line gave no pulses, and samples were timed by counts meanwhile",
    "magnetometer_lost": "the magnetometer gave nothing, or not what it was told",
    "magnetometer_restarts": "the magnetometer was set up again",
    "records_damaged": "a part of the recording could not be read",
}


def in_words(health: Health) -> Iterator[str]:
    """A line for each thing that happened and is not as usual: how often, what, and the counter's name."""
    for name, n in health.as_dict().items():
        if n and name not in (*TOLD_BEFORE, *USUAL):
            yield f"{n} x {WORDS.get(name, 'counted')} ({name})"
