"""A recording as motion: what was recorded is what the chip feels, and its truth is the measured one."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from hw_fakes import PERFECT, FakeMpu6050, Still, Sway
from hw_fakes.scenarios import open_fake
from hw_fakes.world.motion_recorded import load_motion
from quavelet.core.clock import VirtualClock
from quavelet.core.errors import SettingsError
from quavelet.core.units import STANDARD_GRAVITY_M_S2

FS_HZ, SECONDS = 200.0, 20.0
TRUTH = Path(__file__).resolve().parents[3] / "shared" / "truth"


def recorded(motion, *, noise_rad_s=0.0, bias_rad_s=0.0, **changed):
    """The arrays of a recording of `motion`; one set to None is left out."""
    t_s = np.arange(0, SECONDS, 1 / FS_HZ)
    noise = noise_rad_s * np.random.default_rng(1).standard_normal((len(t_s), 3)) + bias_rad_s
    arrays = {
        "gyr": np.rint((motion.rate_rad_s(t_s) + noise) / 1e-4).astype(np.int16),
        "gyr_scale": 1e-4,
        "acc": np.rint(motion.specific_force_m_s2(t_s) / 1e-3).astype(np.int16),
        "acc_scale": 1e-3,
        "fs": FS_HZ,
        "q_ref": np.rint(motion.attitude(t_s) * 32000).astype(np.int16),
        "q_valid": np.ones(len(t_s), dtype=bool),
    }
    return {name: array for name, array in (arrays | changed).items() if array is not None}


@pytest.fixture
def loaded(tmp_path):
    def load(**arrays):
        path = tmp_path / "trial.npz"
        np.savez(path, **arrays)
        return load_motion(path)

    return load


def off_deg(p, q):
    turn = Rotation.from_quat(np.roll(p, -1, axis=1)).inv() * Rotation.from_quat(np.roll(q, -1, axis=1))
    return np.degrees(turn.magnitude())


def test_a_recording_is_felt_as_another_motion(loaded):
    motion, t_s = loaded(**recorded(Sway())), np.random.default_rng(2).uniform(0, SECONDS - 0.01, 3000)
    assert off_deg(motion.attitude(t_s), Sway().attitude(t_s)).max() < 0.01
    assert np.allclose(motion.rate_rad_s(t_s), Sway().rate_rad_s(t_s), atol=3e-4)
    assert np.allclose(motion.specific_force_m_s2(t_s), Sway().specific_force_m_s2(t_s), atol=2e-3)
    assert not motion.integrated.any()
    up = Rotation.from_quat(np.roll(motion.attitude(t_s), -1, axis=1)).apply(motion.magnetic_field_ut(t_s))
    assert np.allclose(up, motion.earth_field.world_ut)


def test_floats_or_the_other_sign_are_another_attitude(loaded):
    t_s = np.arange(0, SECONDS, 1 / FS_HZ)
    q = Sway().attitude(t_s) * np.where(t_s * 3 % 2 < 1, 1, -1)[:, None]
    motion = loaded(**recorded(Sway(), q_ref=q, q_valid=None))
    between_s = t_s[:-1] + 0.5 / FS_HZ
    assert off_deg(motion.attitude(between_s), Sway().attitude(between_s)).max() < 0.01
    assert (np.abs(np.diff(motion.attitude(t_s), axis=0)) < 0.05).all()


@pytest.mark.parametrize("t_s", [-100.0, -0.001, SECONDS, 1e6])
def test_outside_a_recording_the_board_moves(loaded, t_s):
    motion = loaded(**recorded(Sway()))
    edge_s = 0.0 if t_s < 0 else motion.end_s
    at = np.array([t_s])
    assert np.array_equal(motion.attitude(at), motion.attitude(np.array([edge_s])))
    assert not motion.rate_rad_s(at).any()
    world = Rotation.from_quat(np.roll(motion.attitude(at), -1, axis=1)).apply(motion.specific_force_m_s2(at))
    assert world[0] == pytest.approx([0, 0, STANDARD_GRAVITY_M_S2], abs=1e-9)


def test_without_measured_attitude_there_is_none(loaded):
    motion = loaded(**recorded(Still(roll_deg=30, pitch_deg=-20), q_ref=None, q_valid=None))
    assert motion.integrated.all()
    found = Rotation.from_quat(np.roll(motion.attitude(np.array([0.0, 19.0])), -1, axis=1)).as_euler(
        "ZYX", degrees=True
    )
    assert np.allclose(found, [0, -20, 30], atol=0.01)
    swaying = loaded(**recorded(Sway(), q_valid=np.arange(int(SECONDS * FS_HZ)) == 0))
    t_s = np.arange(0, SECONDS, 0.01)
    assert off_deg(swaying.attitude(t_s), Sway().attitude(t_s)).max() < 0.05
    assert swaying.integrated[1:].all()


def test_a_gap_in_the_measured_attitude_ends_with_a_jump(loaded):
    t_s = np.arange(0, SECONDS, 1 / FS_HZ)
    valid = ((t_s > 2) & (t_s < 6)) | ((t_s > 11) & (t_s < 18))
    motion = loaded(**recorded(Sway(), q_valid=valid, bias_rad_s=0.002, noise_rad_s=0.001))
    assert np.array_equal(motion.integrated, ~valid)
    off = off_deg(motion.attitude(t_s), Sway().attitude(t_s))
    assert off[valid].max() < 0.01
    # 5 s of a bias of 0.2 deg/s; spread, it is a fraction of the whole degree.
    assert 0.02 < off[(t_s > 6) & (t_s < 11)].max() < 0.6
    assert 0.02 < off[t_s < 2].max() < 0.4
    steps = off_deg(motion.attitude(t_s[:-1]), motion.attitude(t_s[1:]))
    assert np.abs(steps - off_deg(Sway().attitude(t_s[:-1]), Sway().attitude(t_s[1:]))).max() < 0.03


def test_a_recording_has_no_name_beside_the_scenarios(tmp_path):
    np.savez(tmp_path / "trial.npz", **recorded(Sway()))
    bus = open_fake(f"motion:{tmp_path / 'trial.npz'}", clock=VirtualClock())
    assert bus.targets[0x68].motion.end_s == pytest.approx(SECONDS - 1 / FS_HZ)
    with pytest.raises(SettingsError, match=r"there is no recording no\.npz: check the name after motion:"):
        open_fake("motion:no.npz", clock=VirtualClock())


def test_the_chip_feels_something_else_than_was_recorded(loaded, make_board):
    board, plain = make_board(motion=loaded(**recorded(Sway()))), make_board(motion=Sway())
    for one in (board, plain):
        one.wake(dlpf=3)
        one.start_fifo()
    found, expected = board.collect(3).astype(int), plain.collect(3).astype(int)
    assert np.abs(found - expected)[50:, [0, 1, 2, 4, 5, 6]].max() < 8


@pytest.mark.parametrize(
    ("changed", "says"),
    [
        ({"gyr": None}, "has no 'gyr': it is not a recording of motion"),
        ({"fs": None}, "has no 'fs'"),
        ({"acc_scale": None}, "has no 'acc_scale'"),
        ({"gyr": np.zeros((4000, 2))}, "'gyr' in .* is not of shape"),
        ({"acc": np.zeros((3999, 3))}, "not of one length"),
        ({"gyr": np.zeros((1, 3)), "acc": np.zeros((1, 3)), "q_ref": None}, "from 2 on"),
        ({"gyr": np.full((4000, 3), np.nan)}, "'gyr' in .* not finite"),
        ({"gyr": np.full((4000, 3), "x")}, "not numbers"),
        ({"gyr_scale": -1.0}, "'gyr_scale' in .* is not one number above 0"),
        ({"fs": np.array([100.0, 200.0])}, "'fs' in .* is not one number"),
        ({"q_ref": np.zeros((4000, 3))}, "'q_ref' in .* is not of shape"),
        ({"q_ref": np.zeros((4000, 4))}, "no unit quaternions"),
        ({"q_ref": np.full((4000, 4), np.nan)}, "no unit quaternions"),
        ({"q_valid": np.ones(7, dtype=bool)}, "'q_valid' in .* is not of shape"),
    ],
)
def test_a_wrong_file_is_played(loaded, changed, says):
    with pytest.raises(SettingsError, match=says):
        loaded(**recorded(Sway(), **changed))


@pytest.mark.parametrize("content", [b"", b"no archive", b"PK\x03\x04 broken"])
def test_a_damaged_file_is_a_traceback(tmp_path, content):
    path = tmp_path / "bad.npz"
    path.write_bytes(content)
    with pytest.raises(SettingsError, match="is not an npz file that can be read"):
        load_motion(path)


@pytest.mark.parametrize("name", ["broad_01_undisturbed_slow_rotation_A", "openaxes"])
def test_a_real_recording_turns_against_its_gyroscope(name):
    files = sorted(TRUTH.glob(f"{name}*.npz")) if TRUTH.is_dir() else []
    if not files:
        pytest.skip("recordings with truth are absent: no folder ../shared/truth beside the project")
    motion = load_motion(files[0])
    t_s = np.arange(0, motion.end_s, 0.02)
    q = Rotation.from_quat(np.roll(motion.attitude(t_s), -1, axis=1))
    turned_rad_s = (q[:-1].inv() * q[1:]).as_rotvec() / 0.02
    felt_rad_s = motion.rate_rad_s(t_s[:-1] + 0.01)
    moving = np.linalg.norm(felt_rad_s, axis=1) > 0.3
    assert moving.sum() > 100
    assert np.corrcoef(turned_rad_s[moving].ravel(), felt_rad_s[moving].ravel())[0, 1] > 0.97
    up = q.apply(motion.specific_force_m_s2(t_s))
    assert up.mean(0) == pytest.approx([0, 0, STANDARD_GRAVITY_M_S2], abs=0.5)
    # And the chip stands it: its words are there from the first to the last second.
    clock = VirtualClock()
    chip = FakeMpu6050(clock, motion=motion, imperfections=PERFECT)
    chip.write(b"\x6b\x01")
    chip.stop()
    clock.advance_ns(round(motion.end_s / 2 * 1e9))
    chip.write(b"\x3b")
    assert any(chip.read(14))
