"""Every output on and eight readers, one of which never reads: ratios are printed, what became of messages holds."""

from __future__ import annotations

import sys

import pytest
from bench_outputs import CASES, MODES, compare, report

pytestmark = [
    pytest.mark.slow,
    pytest.mark.benchmark,
    pytest.mark.skipif(sys.platform != "linux", reason="the real-time settings are Linux's"),
]


@pytest.mark.parametrize(("sample_hz", "loop_hz"), CASES)
def test_with_every_output_on_who_never_reads_loses_and_nobody_else_does(
    sample_hz: float, loop_hz: float, capsys: pytest.CaptureFixture[str]
) -> None:
    rounds = compare(sample_hz, loop_hz, seconds=8.0, rounds=2)
    lines = list(report(sample_hz, loop_hz, rounds))
    with capsys.disabled():
        print("", *lines, sep="\n")
    assert all(any(line.lstrip().startswith(mode) for line in lines) for mode in MODES)
    for done in rounds:
        outputs = {output.name: output for output in done[MODES[2]].status.outputs}
        # The other three got each message, the fourth some: more is lost than that only where one of them lost too.
        assert 0 < 3 * outputs["unix"].lost <= outputs["unix"].sent
        assert outputs["tcp"].lost == 0
        assert (outputs["unix"].readers, outputs["tcp"].readers) == (4, 4)
        assert all(output.sent > 0 for output in outputs.values())
        assert not any(output.state.startswith("failed") for output in outputs.values())
