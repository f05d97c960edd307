"""With every output on and eight readers, one of which never reads, the loop is hardly later than alone."""

from __future__ import annotations

import sys

import pytest
from bench_outputs import CASES, MODES, compare, ratios, report

BAR = 1.5


@pytest.mark.slow
@pytest.mark.benchmark
@pytest.mark.skipif(sys.platform != "linux", reason="the real-time settings are Linux's")
@pytest.mark.parametrize(("sample_hz", "loop_hz"), CASES)
def test_the_loop_does_not_notice_its_outputs(
    sample_hz: float, loop_hz: float, capsys: pytest.CaptureFixture[str]
) -> None:
    rounds = compare(sample_hz, loop_hz, seconds=8.0, rounds=3)
    with capsys.disabled():
        print()
        for line in report(sample_hz, loop_hz, rounds):
            print(line)
    for done in rounds:
        outputs = {output.name: output for output in done[MODES[2]].status.outputs}
        assert outputs["unix"].lost > 0
        assert outputs["tcp"].lost == 0
        assert (outputs["unix"].readers, outputs["tcp"].readers) == (4, 4)
    # A program that comes and goes on this machine spoils a round; outputs that held the loop up would spoil each.
    assert min(ratios(rounds)) <= BAR
