"""`quavelet doctor` passes a good board, and gives advice for each thing that is not well."""

import json

from program import quavelet

from quavelet.cli import exits


def test_a_good_board_passes_in_all_points() -> None:
    done = quavelet("doctor", "--bus", "fake:still", "--virtual-time")
    assert (done.code, done.err) == (exits.OK, "")
    assert len(done.lines) == 10
    assert all(line.startswith("ok ") for line in done.lines), done.out


def test_a_moving_board_is_told_to_lie_still() -> None:
    done = quavelet("doctor", "--bus", "fake:sway", "--virtual-time")
    assert (done.code, done.err) == (exits.VERDICT_FAILED, "")
    lines = done.lines
    (moving,) = [i for i, line in enumerate(lines) if line.startswith("BAD  board still")]
    assert "-> lay it down" in lines[moving + 1]


def test_a_board_that_is_not_there_ends_the_check_up_with_the_reason() -> None:
    done = quavelet("doctor", "--bus", "fake:still", "--address", "0x69", "--virtual-time")
    assert (done.code, done.err) == (exits.NO_DEVICE, "")
    assert done.lines[0].startswith("ok   bus")
    assert "no answer from address 0x69" in done.lines[-1]


def test_every_bad_finding_has_advice_and_no_good_one_has() -> None:
    done = quavelet("doctor", "--bus", "fake:sway", "--virtual-time", "--json")
    findings = [json.loads(line) for line in done.lines]
    assert {finding["name"] for finding in findings if not finding["ok"]}
    assert [f["name"] for f in findings if f["ok"] == bool(f["advice"])] == []
