"""A row says of itself whether it is in its band."""

from __future__ import annotations

from math import inf, nan

import pytest

from quavelet.study.experiment import Row


def row(got: float, low: float = -inf, high: float = inf) -> Row:
    return Row("0a", "noise", got=got, unit="deg", low=low, high=high)


@pytest.mark.parametrize(
    ("one", "judged", "passed"),
    [
        (row(1.0), False, True),
        (row(nan), False, True),
        (row(1.0, high=1.0), True, True),
        (row(1.0, low=1.0), True, True),
        (row(1.0, low=1.1), True, False),
        (row(1.0, 0.0, 0.9), True, False),
        (row(nan, 0.0, 2.0), True, False),
        (row(inf, low=0.0), True, True),
    ],
)
def test_a_row_without_a_band_is_not_judged_and_one_that_has_no_number_is_in_none(one, judged, passed):
    assert (one.judged, one.passed) == (judged, passed)
