"""Each fault in each state of the driver ends in samples that can be trusted, or in an error that says what to do."""

from __future__ import annotations

import logging

import matrix
import pytest
from in_self_test import MOMENTS_S, SelfTestCell, self_test_cell
from matrix import ROWS, STATES, WIRED_ROWS, Cell, cell

from quavelet.core.errors import BusError, ChipUnstable, DeviceLost

DETECT_MS, RECOVER_MS, WORSE_DEG = 100.0, 500.0, 1.0
LATE = {
    "time-out takes=1": "the adapter itself holds the call for a second",
    "flip for=0.3 register=0x73": "only some of its reads are spoilt, and retried",
}
"""Not noticed within the bar, and why."""
LOST_FOR_GOOD = ("unplugged", "swapped personality=MPU-6500")
NEVER_STARTED = (*LOST_FOR_GOOD, "nack for=5", "zeros for=5", "ones for=5")
"""In the first start-up these end in ChipUnstable, after five tries, where they begin once the chip has been reset."""
SLOW_STARTS = {"changed register=0x6b value=0x41": "PWR_MGMT_1 is waited for as after a reset, then reset again: 1.2 s"}
NO_VERDICT = NEVER_STARTED
ENDS_SELF_TEST = (BusError, ChipUnstable, DeviceLost)
"""What outlasts the self-test's patience ends in one of these."""
LONG = ("nack for=5", "zeros for=5", "ones for=5", "unplugged for=2")
"""Nobody knows what the board did for so long: what the attitude is after it is flagged until gravity has said."""


@pytest.fixture(scope="module", autouse=True)
def quiet():
    logging.disable(logging.WARNING)
    yield
    logging.disable(logging.NOTSET)


def check(c: Cell) -> None:
    streams = c.state in ("streaming", "brought back")
    if c.error is not None:
        assert isinstance(c.error, DeviceLost if streams else ChipUnstable), c
        assert c.fault in (LOST_FOR_GOOD if streams else NEVER_STARTED), c
        assert ("exchanged" in str(c.error)) == (streams and c.fault.startswith("swapped")), c.error
        return
    assert c.unsaid == 0 and c.backwards == 0, c
    if not c.happened:
        return
    assert c.recover_ms is not None, c
    assert c.recover_ms <= RECOVER_MS or (not streams and c.fault in SLOW_STARTS), c
    if c.state == "streaming" and c.detect_ms is not None:
        assert c.detect_ms <= DETECT_MS or c.fault in LATE, c
    assert c.worse_deg is not None
    assert c.worse_deg <= WORSE_DEG or (streams and c.fault in LONG and c.settling), c


@pytest.mark.parametrize("state", STATES)
@pytest.mark.parametrize("fault", (*ROWS, *WIRED_ROWS))
def test_fault_ends_neither_in_good_samples_nor_in_an_error_that_helps(fault, state):
    check(cell(fault, state))


def check_self_test(c: SelfTestCell, *, good: bool) -> None:
    assert c.streams, c
    assert c.verdict in (None, good), c
    if c.verdict is None:
        assert c.fault in NO_VERDICT, (c, c.error)
        assert isinstance(c.error, ENDS_SELF_TEST), c
    else:
        assert c.as_found, c


@pytest.mark.parametrize("fault", ROWS)
def test_fault_in_the_self_test_gives_a_wrong_verdict_or_leaves_the_chip_pushed(fault):
    check_self_test(self_test_cell(fault), good=True)


@pytest.mark.slow
@pytest.mark.parametrize("moment", MOMENTS_S)
@pytest.mark.parametrize("good", [True, False])
@pytest.mark.parametrize("fault", ROWS)
def test_fault_at_any_moment_of_the_self_test_of_a_good_or_broken_chip_gives_a_wrong_verdict(fault, moment, good):
    check_self_test(self_test_cell(fault, at_s=MOMENTS_S[moment], broken=not good), good=good)


def test_matrix_is_printed(capsys):
    with capsys.disabled():
        print("\n" + matrix.short_table(self_test=False))
