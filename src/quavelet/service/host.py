"""What this machine is at: which start of it, and the time since."""

from __future__ import annotations

import time
from collections.abc import Mapping
from pathlib import Path

BOOT_ID = Path("/proc/sys/kernel/random/boot_id")
BOOT_ID_VARIABLE = "QUAVELET_BOOT_ID"
"""The unit gives it, for in its sandbox /proc/sys is out of sight."""


def boot_id(environ: Mapping[str, str]) -> str:
    """32 hexadecimal digits, another at each start of the machine; "" where it is not known."""
    text = environ.get(BOOT_ID_VARIABLE, "")
    if not text:
        try:
            text = BOOT_ID.read_text(encoding="ascii")
        except (OSError, UnicodeDecodeError):
            return ""
    return text.strip().replace("-", "").lower()


def asleep_ns() -> int:
    """CLOCK_BOOTTIME minus CLOCK_MONOTONIC, which stands still while the machine is suspended."""
    return time.clock_gettime_ns(time.CLOCK_BOOTTIME) - time.monotonic_ns()
