"""Every step of a session, and everything that disturbs it: nothing wrong is measured, nothing measured is lost."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from session_rig import Bench

from quavelet.bench.session_evidence import Evidence
from quavelet.bench.session_result import every_pose
from quavelet.bench.session_store import SessionStore
from quavelet.bench.steps.turns import turn_of
from quavelet.calibration.poses import StillPose
from quavelet.core.blocks import Flag
from quavelet.core.errors import CalibrationError, DeviceLost
from quavelet.core.units import DEG_PER_RAD, NS_PER_S

LOOKS_HZ = 6.0
STEPS = ("warm-up", "rest", "faces", "turns", "poses", "temperature", "magnetometer", "check")
"""The long still run has a file of its own."""
LYING = ("warm-up", "rest")
OFTEN = ("rest", "faces", "turns")
EACH = [step if step in OFTEN else pytest.param(step, marks=pytest.mark.slow) for step in STEPS]
WITHOUT_HEAT = [
    step if step in OFTEN else pytest.param(step, marks=pytest.mark.slow)
    for step in STEPS
    if step not in ("temperature", "magnetometer")
]
IN_A_POSE_S = 1.5


class Once:
    """Does something to the bench at one moment: in the middle of a pose, or of a swing."""

    def __init__(self, step: str, what: Callable[[Bench], None]) -> None:
        self.what, self.while_still = what, step != "magnetometer"
        self.at_s = {"turns": 30.0, "temperature": 70.0}.get(step, 12.0)
        self.done_s: float | None = None

    def __call__(self, bench: Bench) -> None:
        seen = bench.views[-1].seen
        ready = seen is not None and (seen.still_s > IN_A_POSE_S or not self.while_still)
        if self.done_s is None and ready and bench.s > self.at_s:
            self.done_s = bench.s
            self.what(bench)


def lists_of(evidence: Evidence) -> list[list[object]]:
    return [evidence.rest, evidence.placed, evidence.poses, evidence.check, evidence.moves, evidence.told]


def all_poses(evidence: Evidence) -> list[StillPose]:
    return [*every_pose(evidence), *evidence.check]


def assert_right(bench: Bench, *, wrong_s: tuple[float, float] | None = None) -> None:
    """What was measured is what was so, and none of it was measured while something was wrong."""
    evidence = bench.evidence
    for pose in all_poses(evidence):
        middle_s = np.array([bench.bus.chip.world_time_s((pose.begin_ns + pose.end_ns) // 2)])
        true = bench.bus.chip.source.gyro_bias_rad_s(middle_s)[0]
        # 1 g may add 0.1 deg/s about each axis (PS 6.1).
        assert np.abs(DEG_PER_RAD * (np.array(pose.gyro_rad_s) - true)).max() < 0.25
        assert -30.0 <= pose.temp_degc <= 75.5
        if wrong_s is not None:
            assert not (pose.begin_ns < wrong_s[1] * NS_PER_S and pose.end_ns > wrong_s[0] * NS_PER_S)
    for move in (*evidence.moves, *evidence.told):
        rows = move.rows(bench.chip.scale)
        assert not (rows.flags & (Flag.GAP | Flag.GYRO_CLIPPED)).any()
    assert all(turn_of(move.turned_deg) for move in evidence.told)


def bump(bench: Bench) -> None:
    bench.bus.bump()


def stop_the_clock(bench: Bench) -> None:
    """The machine is suspended for half a minute."""
    bench.clock.advance_ns(30 * NS_PER_S)


def heat(bench: Bench) -> None:
    at_s = bench.bus.chip.world_time_s(bench.clock.now_ns())
    bench.bus.sensor.goes_to(95.0, from_s=at_s, within_s=0.5)
    bench.bus.sensor.goes_to(40.0, from_s=at_s + 15.0, within_s=2.0)
    bench.bus.chip.recompute()


def cool(bench: Bench) -> None:
    at_s = bench.bus.chip.world_time_s(bench.clock.now_ns())
    bench.bus.sensor.goes_to(-39.0, from_s=at_s, within_s=0.5)
    bench.bus.sensor.goes_to(30.0, from_s=at_s + 15.0, within_s=2.0)
    bench.bus.chip.recompute()


@pytest.mark.parametrize("step", STEPS)
@pytest.mark.parametrize("unplugged", [False, True], ids=["ctrl-c", "unplugged"])
def test_a_step_that_is_interrupted_goes_on_where_it_was(tmp_path, step, unplugged):
    out = tmp_path / "cal.toml"
    end = Once(step, lambda bench: bench.bus.chip.unplug() if unplugged else None)
    first = Bench([step], out=out, each_look=end, seed=3)
    if unplugged:
        with pytest.raises(DeviceLost):
            first.conduct(looks_hz=LOOKS_HZ)
        assert first.notices[-1].startswith("the chip gives nothing: look at its plug")
    else:
        assert not first.conduct(stopped=lambda: end.done_s is not None, looks_hz=LOOKS_HZ)
    kept = SessionStore(out).load(first.chip)
    assert kept == first.evidence
    assert_right(first)
    had, had_field = [list(each) for each in lists_of(kept)], len(kept.field_ut)
    assert any(had) or had_field
    second = Bench([step], out=out, evidence=kept, seed=3)
    if step not in ("warm-up", "magnetometer"):
        assert second.session.step.progress > 0.0
    assert second.conduct(looks_hz=LOOKS_HZ)
    assert [each[: len(before)] for each, before in zip(lists_of(second.evidence), had, strict=True)] == had
    assert len(second.evidence.field_ut) >= had_field
    assert SessionStore(out).load(second.chip) == second.evidence


@pytest.mark.parametrize("step", EACH)
def test_a_bump_in_the_middle_of_a_pose_is_in_none(tmp_path, step):
    knock = Once(step, bump)
    bench = Bench([step], out=tmp_path / "c", each_look=knock, seed=3)
    assert bench.conduct(looks_hz=LOOKS_HZ)
    at_s = knock.done_s
    assert_right(bench, wrong_s=None if at_s is None else (at_s + 0.02, at_s + 0.18))
    if step in LYING:
        assert at_s is not None
        assert any("was moved" in notice for notice in bench.notices)


@pytest.mark.parametrize("step", EACH)
def test_a_machine_that_slept_joins_nothing_over_the_gap(tmp_path, step):
    sleep = Once(step, stop_the_clock)
    bench = Bench([step], out=tmp_path / "c", each_look=sleep, seed=3)
    assert bench.conduct(looks_hz=LOOKS_HZ)
    at_s = sleep.done_s
    assert_right(bench)
    for pose in all_poses(bench.evidence):
        assert (pose.end_ns - pose.begin_ns) < 4.0 * NS_PER_S
        assert at_s is None or not pose.begin_ns < (at_s + 15.0) * NS_PER_S < pose.end_ns


@pytest.mark.parametrize("step", WITHOUT_HEAT)
@pytest.mark.parametrize(
    ("what", "said"),
    [(heat, "beyond 85: take the heat away"), (cool, "below -40: let it warm up")],
    ids=["hot", "cold"],
)
def test_beyond_the_data_sheets_temperatures_nothing_is_measured_and_the_person_is_told(tmp_path, step, what, said):
    warm = Once(step, what)
    bench = Bench([step], out=tmp_path / "c", each_look=warm, seed=3)
    assert bench.conduct(looks_hz=LOOKS_HZ)
    assert warm.done_s is not None
    assert any(said in notice for notice in bench.notices)
    assert_right(bench)


@pytest.mark.parametrize("step", EACH)
def test_a_plug_that_is_loose_for_a_moment_costs_a_pose_at_most(tmp_path, step):
    out = Once(step, lambda bench: bench.bus.chip.unplug())

    def loose(bench: Bench) -> None:
        out(bench)
        if out.done_s is not None and bench.s > out.done_s + 1.0:
            bench.bus.chip.plug()

    bench = Bench([step], out=tmp_path / "c", each_look=loose, seed=3)
    assert bench.conduct(looks_hz=LOOKS_HZ)
    assert_right(bench, wrong_s=None if out.done_s is None else (out.done_s + 0.3, out.done_s + 0.9))


def test_samples_lost_in_a_turn_are_told_and_the_turn_is_asked_for_again(tmp_path):
    gone_s: list[float] = []

    def loose(bench: Bench) -> None:
        seen = bench.views[-1].seen
        if not gone_s and seen is not None and abs(seen.turned_deg) > 150.0:
            gone_s.append(bench.s)
            bench.bus.chip.unplug()
        elif gone_s and bench.s > gone_s[0] + 0.7:
            bench.bus.chip.plug()

    bench = Bench(["turns"], out=tmp_path / "c", each_look=loose, seed=3)
    assert bench.conduct(looks_hz=LOOKS_HZ)
    assert any(notice.startswith("samples were lost in that turn") for notice in bench.notices)
    assert_right(bench)


def test_a_chip_that_warms_beyond_the_limit_is_not_warmed_up(tmp_path):
    """Warming up ends when the temperature stands still: not where nothing may be measured."""

    def too_warm(bench: Bench) -> None:
        if len(bench.views) == 1:
            at_s = bench.bus.chip.world_time_s(bench.clock.now_ns())
            bench.bus.sensor.goes_to(80.0, from_s=at_s, within_s=1.0)
            bench.bus.chip.recompute()

    bench = Bench(["warm-up"], out=tmp_path / "c", each_look=too_warm, seed=3)
    with pytest.raises(CalibrationError, match="take the heat away"):
        bench.conduct(patience_s=90.0, looks_hz=LOOKS_HZ)
    assert not bench.evidence.rest or max(pose.temp_degc for pose in bench.evidence.rest) < 75.5
