"""The histogram gives percentiles within its stated width, and exact extremes, in fixed memory."""

import json
import sys

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from quavelet.loop.histogram import EDGES_NS, RELATIVE_WIDTH, Histogram

inside_ns = st.integers(1_000, 9_999_999_999)
percents = st.floats(0, 100)


def filled(values: list[int]) -> Histogram:
    histogram = Histogram()
    for ns in values:
        histogram.add(ns)
    return histogram


@given(st.lists(inside_ns, min_size=1, max_size=200), percents)
def test_a_percentile_is_never_too_small_and_less_than_a_bin_too_large(values: list[int], p: float) -> None:
    true_ns = int(np.percentile(values, p, method="inverted_cdf"))
    given_ns = filled(values).percentile(p)
    # The edges are rounded to whole ns, which is up to 0.1 % of the first one.
    assert true_ns <= given_ns <= true_ns * (1 + RELATIVE_WIDTH) * 1.001


@given(st.lists(st.integers(0, 10**12), min_size=1, max_size=50))
def test_the_extremes_are_exact_and_every_value_is_counted_whatever_its_size(values: list[int]) -> None:
    histogram = filled(values)
    assert (histogram.min_ns, histogram.max_ns) == (min(values), max(values))
    assert histogram.count == len(values) == sum(histogram.counts)
    assert histogram.percentile(100) == max(values)
    assert min(values) <= histogram.percentile(0) <= max(values)


@given(st.lists(inside_ns, min_size=1, max_size=50), percents, percents)
def test_a_higher_percentile_is_not_smaller(values: list[int], p: float, q: float) -> None:
    histogram = filled(values)
    assert histogram.percentile(min(p, q)) <= histogram.percentile(max(p, q))


def test_a_duration_on_an_edge_belongs_to_the_bin_above_it() -> None:
    for i, edge_ns in enumerate(EDGES_NS):
        assert filled([edge_ns]).counts.index(1) == i + 1
        assert filled([edge_ns - 1]).counts.index(1) == i


def test_the_bins_reach_from_a_microsecond_to_ten_seconds_with_equal_ratios() -> None:
    assert (EDGES_NS[0], EDGES_NS[-1]) == (1_000, 10_000_000_000)
    ratios = np.diff(np.log(EDGES_NS))
    np.testing.assert_allclose(ratios, np.log(1 + RELATIVE_WIDTH), atol=1e-3)


def test_memory_does_not_grow_with_what_is_added() -> None:
    histogram = filled([5])
    before = sys.getsizeof(histogram._counts), len(histogram.counts)
    for ns in range(0, 10**7, 1_000):
        histogram.add(ns)
    assert (sys.getsizeof(histogram._counts), len(histogram.counts)) == before


def test_an_empty_histogram_says_zero_and_a_percent_out_of_range_is_refused() -> None:
    histogram = Histogram()
    assert (histogram.count, histogram.min_ns, histogram.max_ns, histogram.percentile(99)) == (0, 0, 0, 0)
    for p in (-0.1, 100.1, float("nan")):
        with pytest.raises(ValueError, match="between 0 and 100"):
            histogram.percentile(p)


def test_as_dict_holds_the_bins_that_are_not_empty_and_is_plain_json() -> None:
    histogram = filled([0, 1_000, 1_001, 20_000_000_000])
    data = json.loads(json.dumps(histogram.as_dict()))
    assert data == {
        "count": 4,
        "min_ns": 0,
        "max_ns": 20_000_000_000,
        "bins": [[1_000, 1], [EDGES_NS[1], 2], [None, 1]],
    }
