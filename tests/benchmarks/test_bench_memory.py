"""A service that runs for years must not grow: hours of virtual time with every output on."""

from __future__ import annotations

import pytest
from bench_memory import grow, report

BAR_MB = 2.0


@pytest.mark.slow
@pytest.mark.benchmark
@pytest.mark.timeout(900)
def test_the_memory_is_flat_with_every_output_on(capsys: pytest.CaptureFixture[str]) -> None:
    growth = grow(1_000_000)
    with capsys.disabled():
        print(f"\n{report(growth)}")
    assert growth.status.health["samples"] > 990_000
    assert growth.end_mb - growth.warm_mb < BAR_MB
