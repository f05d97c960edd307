"""The short form of the flood: what the loop notices is printed, that others are served meanwhile holds."""

from __future__ import annotations

import sys

import pytest
from bench_flood_outputs import PLACES, compare, report
from bench_outputs import BOUND_S


@pytest.mark.slow
@pytest.mark.benchmark
@pytest.mark.skipif(sys.platform != "linux", reason="the real-time settings are Linux's")
def test_a_flood_keeps_nobody_out(capsys: pytest.CaptureFixture[str]) -> None:
    runs = compare(seconds=3.0, rounds=1)
    with capsys.disabled():
        print("", *report(runs), sep="\n")
    for place in PLACES[1:]:
        (flooded,) = runs[place]
        assert flooded.waits_s and max(flooded.waits_s) < BOUND_S
