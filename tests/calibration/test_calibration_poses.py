"""Which stretches of a stream are still poses, and which are not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from simulated_boards import FACES, G, bench_script, samples_of
from test_still_bias import board, flat

from hw_fakes.world.imperfections import draw
from quavelet.calibration.poses import PoseCollector, apart, face_up, noise_of, still_poses
from quavelet.core.blocks import Flag

UPS = {"+z": [0, 0, 1], "+x": [1, 0, 0], "+y": [0, 1, 0], "-z": [0, 0, -1], "-x": [-1, 0, 0], "-y": [0, -1, 0]}

KNOCKS = 0.3 * (np.arange(1000) % 20 == 0)[:, None]


def six_faces(rest_s: float = 3.0):
    """A board put on its six faces, thrown about between them."""
    rng = np.random.default_rng(3)
    rates, forces = [], []
    for face in FACES:
        n = round(rest_s * 100)
        rates += [flat(n, [4.0, -2.0, 1.0]), rng.normal(0.0, 60.0, (100, 3))]
        forces += [flat(n, UPS[face]), rng.normal(0.0, 0.5, (100, 3)) + [0, 0, 1]]
    return board(np.vstack(rates), np.vstack(forces))


def test_the_six_faces_are_found_in_their_order_with_their_means():
    poses = still_poses(six_faces())
    assert [pose.face for pose in poses] == list(FACES)
    for pose, face in zip(poses, FACES, strict=True):
        assert 2.0 <= pose.duration_s <= 3.0
        assert np.allclose(np.array(pose.accel_m_s2) / G, UPS[face], atol=0.002)
        assert np.allclose(np.degrees(pose.gyro_rad_s), [4.0, -2.0, 1.0], atol=0.05)


def test_the_noise_of_a_window_is_what_the_poses_scatter():
    gyro, accel = noise_of(still_poses(six_faces(rest_s=10.0)))
    assert np.degrees(gyro) == pytest.approx([0.13 / 5] * 3, rel=0.3)
    assert accel / G == pytest.approx([0.001] * 3, rel=0.3)


@pytest.mark.parametrize(
    ("name", "rates", "forces"),
    [
        ("shaken", 5.0 * np.sin(np.arange(1000) / 8.0)[:, None] * [1, 1, 0], flat(1000, [0, 0, 1])),
        ("on a turntable", flat(1000, [0, 0, 200.0]), flat(1000, [0, 0, 1])),
        ("knocked again and again", flat(1000, [0, 0, 0]), flat(1000, [0, 0, 1]) + KNOCKS),
    ],
)  # fmt: skip
def test_a_board_that_moves_has_no_pose(name, rates, forces):
    collector = PoseCollector()
    assert [*collector.process(board(rates, forces)), *collector.finish()] == [], name
    assert collector.counts.disturbed >= 39


def test_a_board_that_leans_slowly_gives_no_pose_over_what_it_leaned():
    lean = np.radians(np.clip(np.arange(2000) - 500, 0, 1000) * 0.004)  # 4 deg in 10 s
    poses = still_poses(board(flat(2000, [0, 0, 0]), np.column_stack([np.sin(lean), 0 * lean, np.cos(lean)])))
    assert len(poses) >= 2
    for pose in poses:
        inside = slice(round(pose.begin_ns / 1e7) - 1, round(pose.end_ns / 1e7))
        assert np.degrees(np.ptp(lean[inside])) < 1.2


def test_a_bump_ends_a_pose_and_is_in_none():
    data = board(flat(1000, [0, 0, 0]), flat(1000, [0, 0, 1]))
    data.accel_m_s2[500:505] += 5.0
    poses = still_poses(data)
    assert len(poses) == 2
    assert all(pose.end_ns < data.t_ns[500] or pose.begin_ns > data.t_ns[504] for pose in poses)


@pytest.mark.parametrize("flag", [Flag.GAP, Flag.STUCK, Flag.GYRO_CLIPPED, Flag.ACCEL_CLIPPED])
def test_doubtful_samples_are_in_no_pose(flag):
    data = board(flat(1000, [0, 0, 0]), flat(1000, [0, 0, 1]))
    data.flags[400] |= flag
    t_ns = data.t_ns[400]
    poses = still_poses(data)
    assert len(poses) == 2
    assert not any(pose.begin_ns <= t_ns <= pose.end_ns for pose in poses)


def test_a_long_stretch_comes_in_pieces_of_its_temperature():
    data = board(flat(6000, [0, 0, 0]), flat(6000, [0, 0, 1]))
    data = replace(data, temp_degc=np.linspace(20.0, 26.0, 6000))
    poses = still_poses(data, longest_s=10.0)
    assert len(poses) in (5, 6)
    assert np.all(np.diff([pose.temp_degc for pose in poses]) > 0.8)


@settings(max_examples=20, deadline=None)
@given(cuts=st.lists(st.integers(0, 2400), max_size=12), gap=st.integers(1, 2399), save=st.booleans())
def test_splitting_the_stream_anywhere_gives_the_same_poses(cuts, gap, save):
    data = six_faces()[:2400]
    data.flags[gap] |= Flag.GAP
    whole, parts = PoseCollector(), PoseCollector()
    expected = [*whole.process(data), *whole.finish()]
    found = []
    ends = sorted({*cuts, 2400})
    for begin, end in zip([0, *ends], ends, strict=False):
        found += parts.process(data[begin:end])
        if save:
            state, parts = parts.state(), PoseCollector()
            parts.restore(state)
    found += parts.finish()
    assert found == expected
    assert parts.counts == whole.counts


def test_the_pose_so_far_and_how_long_it_is_are_seen_while_the_board_lies():
    collector = PoseCollector(shortest_s=1.0)
    data = board(flat(400, [1, 0, 0]), flat(400, [0, 0, -1]))
    collector.process(data[:100])
    assert collector.current is None
    collector.process(data[100:])
    assert collector.current is not None
    assert collector.current.face == "-z"
    assert collector.still_s == pytest.approx(3.75)


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("axis", [0, 1, 2])
def test_a_face_is_named_by_the_axis_that_is_up(axis, sign):
    force = np.zeros(3)
    force[axis] = sign * G
    assert face_up(tuple(force)) == ("+" if sign > 0 else "-") + "xyz"[axis]
    assert face_up((6.0, 6.0, 5.0)) is None


def test_poses_in_one_direction_count_once():
    rng = np.random.default_rng(1)
    block = samples_of(draw(1), bench_script(rng, poses=12, turns=False), rng)
    chosen = apart(still_poses(block))
    directions = np.array([pose.accel_m_s2 for pose in chosen])
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    assert (directions @ directions.T)[~np.eye(len(chosen), dtype=bool)].max() < np.cos(np.radians(5.0))
    assert 12 <= len(chosen) <= 18
