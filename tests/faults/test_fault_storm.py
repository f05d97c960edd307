"""Random faults of every kind: none but our own errors, nothing wrong unflagged, no time that goes back, no growth."""

from __future__ import annotations

import logging
import os
import secrets

import pytest
from storm import DATA_KINDS, Outcome, storm

UNNOTICED_TURN_DEG = 0.5
"""What a bit that flips within a frame, and is not noticed, may do to the attitude."""


@pytest.fixture(autouse=True)
def quiet():
    logging.disable(logging.WARNING)
    yield
    logging.disable(logging.NOTSET)


def check(out: Outcome) -> None:
    print(f"\n{out}")
    assert set(out.errors) <= {"DeviceLost", "ChipUnstable", "BusError", "WrongChip", "DeviceMissing"}, out.errors
    assert out.unsaid == 0
    assert out.backwards == 0
    for what, off, turn_deg in out.wrong:
        assert what.startswith(DATA_KINDS), (
            f"seed {out.seed}: a wrong sample without a flag by no fault of the wires, {what}"
        )
        assert turn_deg <= UNNOTICED_TURN_DEG, f"seed {out.seed}: {what}, {off} counts"
    assert out.resident_mb[1] < out.resident_mb[0] + 40.0


@pytest.mark.parametrize(
    ("seed", "wired"),
    [(1, False), (2, True), *(pytest.param(None, wired, marks=pytest.mark.slow) for wired in (False, True))],
)
def test_storm_of_every_fault_lets_something_wrong_through(seed, wired):
    out = storm(seed=secrets.randbits(31) if seed is None else seed, transactions=30_000, wired=wired)
    check(out)
    assert out.faults > 200 and out.spoilt_reads > 3
    assert out.samples > 12_000


def test_faults_once_a_minute_cost_a_sample_outside_of_gaps():
    """Some minutes of the soak of `storm.py --hours 24 --per-minute 1 --rate 1000`."""
    hours = float(os.environ.get("QUAVELET_SOAK_HOURS", "0.05"))
    out = storm(seed=5, virtual_s=hours * 3600, p=None, per_minute=6.0, rate_hz=1000.0, dlpf=1)
    check(out)
    assert out.samples + out.lost == pytest.approx(out.virtual_s * 1010, rel=0.02)


@pytest.mark.slow
@pytest.mark.timeout(3600)
def test_million_transactions_with_random_faults():
    check(storm(seed=1, transactions=1_000_000))


@pytest.mark.slow
@pytest.mark.timeout(7200)
def test_day_at_1_khz_with_a_fault_every_minute():
    hours = float(os.environ.get("QUAVELET_SOAK_HOURS", "1"))
    out = storm(seed=3, virtual_s=hours * 3600, p=None, per_minute=1.0, rate_hz=1000.0, dlpf=1)
    check(out)
