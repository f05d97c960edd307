"""Boards from the data sheet's limits come out of a calibration as they were drawn, with sigmas that are true."""

from __future__ import annotations

from functools import partial

import boards_table
import numpy as np
import pytest
from boards_table import BARS, table
from simulated_boards import calibrated_board


def test_ten_boards_are_found_within_the_bars():
    points, covered = table(range(10))
    assert all(points[name] < bar for name, bar in BARS.items()), points
    assert min(covered.values()) > 0.8, covered


def test_the_sigmas_are_true_without_poses_by_hand_too(monkeypatch):
    """What the accelerometer is off, is off in all turns alike."""
    monkeypatch.setattr(boards_table, "calibrated_board", partial(calibrated_board, poses=1))
    _, covered = table(range(10))
    assert min(covered.values()) > 0.8, covered


@pytest.mark.slow
def test_two_hundred_boards_are_found_within_the_bars_and_their_sigmas_are_true():
    points, covered = table(range(200))
    assert all(points[name] < bar for name, bar in BARS.items()), points
    assert np.all([0.90 <= share <= 0.99 for share in covered.values()]), covered
