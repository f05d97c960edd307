"""What tests of several rooms need: the folder of real recordings, and the helpers of tests/contract by name."""

from __future__ import annotations

import os
import sys
from pathlib import Path

import pytest
from hypothesis import settings

# The time an example takes is the machine's business: hypothesis' 200 ms fail on one that is busy with other things.
settings.register_profile("any machine", deadline=None)
settings.load_profile("any machine")

TESTS = Path(__file__).resolve().parent
RECORDINGS = TESTS.parent.parent / "shared" / "recordings"

# For this file pytest puts tests/ on sys.path, where the folder tests/hw_fakes would hide the package hw_fakes.
# Its place is given to tests/contract, whose helpers other rooms import.
sys.path[:] = [str(TESTS / "contract"), *(entry for entry in sys.path if entry != str(TESTS))]

# Programs under test would meet there each other, or the one that its owner runs on this desktop.
os.environ.pop("XDG_RUNTIME_DIR", None)


@pytest.fixture
def recordings() -> Path:
    """The folder of recordings of real chips."""
    if not RECORDINGS.is_dir():
        pytest.skip("recordings are absent: no folder ../shared/recordings beside the project")
    return RECORDINGS
