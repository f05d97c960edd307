"""Counters of all that went wrong, was repaired, or was thrown away."""

from __future__ import annotations

from dataclasses import asdict, dataclass


@dataclass(slots=True)
class Health:
    """One object for a chip's whole way; each stage adds to its own counters.

    Every reason for which data was rejected or the chip was reset has its own counter.
    """

    samples: int = 0
    """Samples decoded."""
    samples_lost: int = 0
    """Samples the chip took and nobody read, by the time base's reckoning."""
    gaps: int = 0
    """Places in the data where samples are missing."""
    drains: int = 0
    """Times the FIFO was looked at."""
    fifo_empty: int = 0
    """Drains that found no whole frame."""
    fifo_overflows: int = 0
    """Resets because the chip reported an overflow."""
    fifo_near_full: int = 0
    """Resets because fewer than three frames of room were left."""
    fifo_misaligned: int = 0
    """Resets because the FIFO did not hold whole frames."""
    fifo_resets: int = 0
    """All resets of the FIFO while streaming."""
    frames_implausible: int = 0
    """Frames thrown away, since no sensor gives such: a temperature that jumps, or all bytes alike."""
    spikes: int = 0
    """Samples thrown away, since they stood alone: the chip's low-pass filter lets no such through."""
    counts_surprising: int = 0
    """Drains thrown away, since so many or so few samples had come that the chip's rate must have changed."""
    bus_errors: int = 0
    """Failed transfers."""
    bus_retries: int = 0
    """Transfers repeated at once after a failed one."""
    outages: int = 0
    """Times transfers failed one drain after the other until the chip was reset for it."""
    chip_restarts: int = 0
    """Full resets of the chip after the first."""
    config_mismatches: int = 0
    """Configuration registers that did not read back as written."""
    registers_upset: int = 0
    """Configuration registers found changed while streaming, and written anew."""
    starved: int = 0
    """Times no sample came for much longer than one takes."""
    stuck: int = 0
    """Times no axis changed for so long that the chip was taken to be stuck."""
    slow_queries: int = 0
    """Count readings too slow to time the samples by."""
    rate_out_of_bounds: int = 0
    """Fits of the sample rate outside what the chip's oscillator can do, not used."""
    data_ready_missed: int = 0
    """Times no pulse came from the data-ready line though samples did, and they were timed by counts."""
    magnetometer_lost: int = 0
    """Times the magnetometer gave nothing for long, or not what it was told."""
    magnetometer_restarts: int = 0
    """Times the magnetometer was set up anew while streaming."""
    records_damaged: int = 0
    """Records of a recording that could not be read."""

    def as_dict(self) -> dict[str, int]:
        """All counters by name."""
        return asdict(self)


EXPECTED = ("samples", "samples_lost", "gaps", "drains", "fifo_empty")
"""Counters that are told of otherwise, or grow where all is well."""

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
"""All others in words: what happened once."""
