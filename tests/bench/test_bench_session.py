"""The bench session on a fake board: led through by itself, and through everything a person does wrong."""

from __future__ import annotations

import itertools
from dataclasses import replace

import msgspec
import numpy as np
import pytest
from session_rig import Bench

from quavelet.bench.session import STEPS, USUAL, Session
from quavelet.bench.session_evidence import Evidence
from quavelet.bench.session_store import SessionStore
from quavelet.bench.steps.field import coverage
from quavelet.bench.steps.turns import turn_of
from quavelet.calibration.poses import face_up
from quavelet.core.errors import CalibrationError, DeviceLost, SettingsError
from quavelet.core.instruction import FACES, Instruction
from quavelet.core.units import DEG_PER_RAD


def test_a_session_with_nobody_clumsy_comes_to_its_end_step_by_step(tmp_path):
    bench = Bench(USUAL, out=tmp_path / "cal.toml")
    assert bench.conduct()
    evidence = bench.evidence
    assert tuple(evidence.done) == USUAL
    assert [pose.face for pose in evidence.placed] == [face for face in FACES for _ in range(2)]
    assert len(evidence.told) == 6
    assert len(evidence.check) == 4
    assert {turn_of(move.turned_deg) for move in evidence.told} == set(itertools.product(range(3), (1, -1)))
    temps = [pose.temp_degc for pose in evidence.rest]
    assert temps[-1] > temps[0] + 1.0
    assert bench.store.load(bench.chip) == evidence


def test_faces_come_in_any_order(tmp_path):
    order = iter(["-y", "+x", "+x", "-z", "-y", "+z", "+x", "-x", "+y", "-z", "+z", "-x", "+y"])
    bench = Bench(["faces"], out=tmp_path / "c", hears=lambda _told: Instruction(action="face", face=next(order)))
    assert bench.conduct()
    placed = ["-y", "+x", "-z", "-y", "+z", "+x", "-x", "+y", "-z", "+z", "-x", "+y"]
    assert [pose.face for pose in bench.evidence.placed] == placed


def test_a_face_that_was_not_turned_half_round_is_told_and_asked_for_again(tmp_path):
    clumsy = iter([Instruction(action="turn", face="+z", turn_deg=20.0)])

    def hears(told: Instruction) -> Instruction:
        return next(clumsy, told) if told.action == "turn" else told

    bench = Bench(["faces"], out=tmp_path / "c", hears=hears)
    assert bench.conduct()
    assert "+z is measured that way round: turn it half round on the table" in bench.notices


def test_a_face_that_comes_a_third_time_is_told(tmp_path):
    order = iter(["+z", "-z", "+z", "-z", "+z"])
    bench = Bench(
        ["faces"], out=tmp_path / "c", hears=lambda told: Instruction(action="face", face=next(order, told.face))
    )
    assert not bench.conduct(stopped=lambda: len(bench.evidence.placed) == 5)
    assert "+z is measured: the next is +x" in bench.notices


def test_the_person_sees_which_faces_are_missing_and_which_is_up(tmp_path):
    bench = Bench(["faces"], out=tmp_path / "c")
    assert bench.conduct()
    status = [view.status for view in bench.views]
    assert "missing: -z +x -x +y -y" in status
    assert max(abs(view.seen.turned_deg) for view in bench.views if view.seen) == pytest.approx(180.0, abs=10.0)
    up = {view.seen.face for view in bench.views if view.seen and view.seen.still_s > 1.0}
    assert up == set(FACES)


def test_the_table_of_faces_is_that_of_the_fit():
    forces = [[sign * 9.8 * (k == axis) for k in range(3)] for axis in range(3) for sign in (1, -1)]
    assert {face_up(tuple(force)) for force in forces} == set(FACES)


def test_a_bump_at_rest_is_in_no_pose_and_the_person_is_told(tmp_path):
    bumps = iter([8.0, 15.0, 21.0])
    due = [next(bumps)]

    def knock(bench: Bench) -> None:
        if due and bench.s > due[0]:
            bench.bus.bump()
            due[:] = list(itertools.islice(bumps, 1))

    bench = Bench(["rest"], out=tmp_path / "c", each_look=knock)
    assert bench.conduct()
    told = [view for view in bench.views if "moved" in view.notice]
    assert max(view.seen.still_s for view in told if view.seen) > 2.5, "it is gone before anybody has read it"
    assert bench.views[-1].notice == ""
    rates = np.array([pose.gyro_rad_s for pose in bench.evidence.rest]) * DEG_PER_RAD
    drift = np.ptp(rates, axis=0)
    # What remains is the drift of a board that warms up, 0.33 deg/s/degC at most.
    warmer = np.ptp([pose.temp_degc for pose in bench.evidence.rest])
    assert (drift < 0.02 + 0.34 * warmer).all()
    for at_s in (8.0, 15.0, 21.0):
        assert not any(pose.begin_ns < (at_s + 0.1) * 1e9 < pose.end_ns for pose in bench.evidence.rest)


def test_a_turn_that_is_not_whole_is_refused_and_asked_for_again(tmp_path):
    clumsy = iter([270.0, 360.0])

    def hears(told: Instruction) -> Instruction:
        return replace(told, turn_deg=next(clumsy, told.turn_deg)) if told.action == "turn" else told

    bench = Bench(["turns"], out=tmp_path / "c", hears=hears)
    assert bench.conduct()
    assert any(f"that was {n} degrees" in notice for notice in bench.notices for n in range(255, 286))
    assert len(bench.evidence.told) == 6


def test_a_turn_the_other_way_counts_and_the_one_asked_for_is_still_missing(tmp_path):
    ways = iter([-1, -1, 1])

    def hears(told: Instruction) -> Instruction:
        return replace(told, turn_deg=next(ways, 1) * told.turn_deg) if told.action == "turn" else told

    bench = Bench(["turns"], out=tmp_path / "c", hears=hears)
    assert bench.conduct()
    assert any("is measured: the next is" in notice for notice in bench.notices)
    made = [turn_of(move.turned_deg) for move in bench.evidence.told]
    assert sorted(made) == sorted(itertools.product(range(3), (1, -1)))


@pytest.mark.parametrize("after_s", [19.0, 90.0])
def test_an_interrupted_session_goes_on_where_it_was(tmp_path, after_s):
    out = tmp_path / "cal.toml"
    first = Bench(["faces", "turns"], out=out)
    assert not first.conduct(stopped=lambda: first.s > after_s)
    kept = SessionStore(out).load(first.chip)
    assert kept == first.evidence
    faces = [pose.face for pose in kept.placed]
    assert faces
    second = Bench(["faces", "turns"], out=out, evidence=kept)
    assert second.conduct()
    assert second.evidence.placed[: len(faces)] == first.evidence.placed
    assert sorted(pose.face for pose in second.evidence.placed) == sorted([*FACES, *FACES])
    assert second.evidence.told[: len(kept.told)] == kept.told
    assert len(second.evidence.told) == 6


def test_a_plug_pulled_in_the_middle_loses_nothing_that_was_done(tmp_path):
    def pull(bench: Bench) -> None:
        if len(bench.evidence.placed) == 3:
            bench.bus.chip.unplug()

    bench = Bench(["faces"], out=tmp_path / "c", each_look=pull)
    with pytest.raises(DeviceLost):
        bench.conduct()
    assert bench.notices[-1].startswith("the chip gives nothing: look at its plug")
    kept = bench.store.load(bench.chip)
    assert [pose.face for pose in kept.placed] == ["+z", "+z", "-z"]


def test_a_plug_pulled_for_a_moment_is_no_pose_and_the_session_goes_on(tmp_path):
    def loose(bench: Bench) -> None:
        out = 6.0 < bench.s < 7.0 or 12.0 < bench.s < 13.5
        (bench.bus.chip.unplug if out else bench.bus.chip.plug)()

    bench = Bench(["faces"], out=tmp_path / "c", each_look=loose)
    assert bench.conduct()
    for pose in bench.evidence.placed:
        assert not any(pose.begin_ns < s * 1e9 < pose.end_ns for s in (6.5, 12.7))


def test_a_board_that_is_too_hot_is_not_measured_and_the_person_is_told(tmp_path):
    def heat(bench: Bench) -> None:
        if bench.views[-1].at == 0 and len(bench.views) == 20:
            at_s = bench.bus.chip.world_time_s(bench.clock.now_ns())
            bench.bus.sensor.goes_to(95.0, from_s=at_s, within_s=1.0)
            bench.bus.sensor.goes_to(40.0, from_s=at_s + 30.0, within_s=2.0)
            bench.bus.chip.recompute()

    bench = Bench(["rest"], out=tmp_path / "c", each_look=heat)
    assert bench.conduct()
    assert any("not specified beyond 85" in notice for notice in bench.notices)
    assert all(pose.temp_degc <= 76.0 for pose in bench.evidence.rest)


def test_a_full_disk_is_told_and_the_file_from_before_stays_whole(tmp_path):
    out = tmp_path / "cal.toml"
    bench = Bench(["faces"], out=out)
    assert not bench.conduct(stopped=lambda: len(bench.evidence.placed) == 2)
    before = bench.store.path.read_bytes()
    # A folder stands where the new file would be written first: as good as a disk that takes no more.
    beside = bench.store.path.with_name(f"{bench.store.path.name}.new")
    beside.mkdir()
    full = SessionStore(out)
    assert not full.keep(bench.evidence)
    assert "make room" in full.failure
    assert bench.store.path.read_bytes() == before
    beside.rmdir()
    assert full.keep(bench.evidence)
    assert full.failure == ""


def test_a_full_disk_is_told_while_the_session_goes_on(tmp_path):
    bench = Bench(["faces"], out=tmp_path / "cal.toml")
    beside = bench.store.path.with_name(f"{bench.store.path.name}.new")
    beside.mkdir()
    assert not bench.conduct(stopped=lambda: len(bench.evidence.placed) == 2)
    assert any("make room" in notice for notice in bench.notices)
    assert len(bench.evidence.placed) == 2


def test_a_session_of_another_chip_or_setting_is_not_gone_on_with(tmp_path):
    bench = Bench(["rest"], out=tmp_path / "c")
    bench.store.keep(bench.evidence)
    other = msgspec.structs.replace(bench.chip, accel_range_g=8)
    with pytest.raises(CalibrationError, match="another chip"):
        bench.store.load(other)
    bench.store.path.write_bytes(b"\x00nonsense")
    with pytest.raises(CalibrationError, match="cannot be read"):
        bench.store.load(bench.chip)
    bench.store.forget()
    with pytest.raises(CalibrationError, match="no session"):
        bench.store.load(bench.chip)


def test_a_person_who_does_nothing_is_not_waited_for_for_ever_when_nobody_is_there(tmp_path):
    bench = Bench(["turns"], out=tmp_path / "c", hears=lambda _told: Instruction(action="rest"))
    with pytest.raises(CalibrationError, match="Whole turns"):
        bench.conduct(patience_s=20.0)


def test_a_temperature_run_spans_its_degrees(tmp_path):
    bench = Bench(["temperature"], out=tmp_path / "c")
    assert bench.conduct()
    temps = [pose.temp_degc for pose in bench.evidence.rest]
    assert max(temps) - min(temps) >= 12.0
    assert bench.notices == [], "at the turn from warming to cooling it stands still as well"


@pytest.mark.parametrize(("step", "least", "most"), [("poses", 3, 6), ("faces", 3, 6)])
def test_who_leaves_the_board_lying_is_not_told_every_three_seconds(tmp_path, step, least, most):
    bench = Bench([step], out=tmp_path / "c", hears=lambda _told: Instruction(action="rest"))
    with pytest.raises(CalibrationError):
        bench.conduct(patience_s=60.0)
    assert least <= len(bench.bus.told) <= most
    assert not bench.evidence.moves, "it lay still"


def test_a_swung_board_shows_its_magnetometers_sphere(tmp_path):
    bench = Bench(["magnetometer"], out=tmp_path / "c", seed=2)
    assert bench.conduct()
    field = np.array(bench.evidence.field_ut)
    assert coverage(field) >= 0.85
    assert np.ptp(field, axis=0) == pytest.approx(2 * 49.0, rel=0.3)


def test_a_step_that_there_is_not_is_refused_with_their_names(tmp_path):
    bench = Bench(["rest"], out=tmp_path / "c")
    with pytest.raises(SettingsError) as refused:
        Session(["rest", "dance"], Evidence(chip=bench.chip))
    assert all(name in str(refused.value) for name in STEPS)
    with pytest.raises(SettingsError):
        Session([], Evidence(chip=bench.chip))


def test_a_whole_turn_is_one_within_ten_per_cent_about_one_axis():
    assert turn_of((5.0, -349.0, 12.0)) == (1, -1)
    assert turn_of((371.0, 3.0, -8.0)) == (0, 1)
    for other in ((300.0, 0.0, 0.0), (360.0, 60.0, 0.0), (720.0, 0.0, 0.0), (0.0, 0.0, 0.0)):
        assert turn_of(other) is None
