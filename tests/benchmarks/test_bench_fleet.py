"""A fleet on one real broker: while the broker is up nothing is lost, by the word of the one who counts."""

from __future__ import annotations

import pytest
from bench_fleet import RATE_HZ, run_fleet, table_of
from mosquitto_broker import needs_mosquitto


@needs_mosquitto
@pytest.mark.benchmark
@pytest.mark.parametrize(
    ("instances", "seconds"), [(10, 3.0), pytest.param(50, 20.0, marks=[pytest.mark.slow, pytest.mark.timeout(180)])]
)
def test_a_fleet_loses_nothing_while_the_broker_is_up(instances: int, seconds: float) -> None:
    result = run_fleet(instances, seconds=seconds)
    print(f"\n{table_of(result)}")
    assert result.published.given == instances * seconds * RATE_HZ
    assert (result.published.lost, result.missing) == (0, 0)
    assert result.published.taken == result.published.given
