"""The whole tool on boards drawn from within the data sheet, against their truth: the table it is judged by."""

from __future__ import annotations

import pytest
from session_boards import FIRST, SPOILT, table


def test_the_tool_finds_the_truth_of_drawn_boards_and_calls_them_good(tmp_path):
    found = table(range(FIRST, FIRST + 3), tmp_path, spoil=0)
    assert all(board.good and not board.refused for board in found.well)
    assert min(found.covered.values()) > 0.8, found.covered


def test_what_no_step_sees_the_verdict_does(tmp_path):
    found = table([FIRST + 1], tmp_path, spoil=1)
    for kind in SPOILT:
        for board in found.spoilt[kind.name]:
            assert board.good == (not board.refused), kind.name
    assert {kind.name for kind in SPOILT if not found.spoilt[kind.name][0].good}


@pytest.mark.slow
def test_two_hundred_boards_are_within_the_bars_their_sigmas_are_true_and_the_verdict_is_just(tmp_path):
    found = table(range(FIRST, FIRST + 200), tmp_path, spoil=0)
    assert sum(board.good for board in found.well) >= 190
    assert all(0.90 <= share <= 0.99 for share in found.covered.values()), found.covered
    assert sum(bool(board.refused) for board in found.well if board.good) <= 4
