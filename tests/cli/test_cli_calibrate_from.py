"""`quavelet calibrate --from FILE.npz`: two real chips, turned by hand, whose numbers somebody else's program wrote."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from program import quavelet

from quavelet.calibration.record_file import load_record
from quavelet.cli import exits
from quavelet.core.units import STANDARD_GRAVITY_M_S2

N = 6000


@pytest.mark.parametrize("name", ["mikoff_imu0", "mikoff_imu1"])
def test_the_poses_of_a_real_chip_that_were_held_out_are_within_three_tenths_of_a_per_cent(recordings, name, tmp_path):
    file, out = recordings / f"{name}.npz", tmp_path / "c.toml"
    done = quavelet("calibrate", "--from", file, "--out", out, "--steps", "poses", "--json")
    assert done.code == exits.OK, done.err
    told = json.loads(done.out)
    (finding,) = [finding for finding in told["findings"] if finding["name"] == "accelerometer"]
    assert finding["figures"]["after_mg"] < 3.0 < 17.0 < finding["figures"]["before_mg"]
    record = load_record(out)
    assert record.gyro_bias is None
    assert record.chip.bus == f"recording:{name}.npz"
    # The same by the file's own numbers: where nothing turns, the calibrated force is one g, in means of 0.4 s.
    with np.load(file) as arrays:
        rate, force = arrays["gyro_rad_s"], arrays["acc_m_s2"]
    quiet = np.abs(rate - np.median(rate, axis=0)).max(axis=1) < 0.02
    steady = np.convolve(quiet, np.ones(50), "same") > 49.5
    measured = np.column_stack([np.convolve(axis, np.full(40, 1 / 40), "same") for axis in force.T])[steady]
    true = (measured - record.accelerometer.offset_m_s2) @ np.array(record.accelerometer.matrix).T
    before, after = (
        np.sqrt(((np.linalg.norm(forces, axis=1) / STANDARD_GRAVITY_M_S2 - 1.0) ** 2).mean())
        for forces in (measured, true)
    )
    assert after < 0.003 < 0.018 < before


def posed(path: Path, **others) -> Path:
    """A file with 24 poses of four seconds, of a sensor that is off by 0.3 m/s^2."""
    rng = np.random.default_rng(2)
    ups = rng.normal(size=(24, 3))
    ups /= np.linalg.norm(ups, axis=1)[:, None]
    force = np.repeat(STANDARD_GRAVITY_M_S2 * ups, N // 24, axis=0) + [0.3, -0.2, 0.1] + rng.normal(0.0, 0.02, (N, 3))
    np.savez(path, gyro_rad_s=rng.normal(0.0, 1e-3, (N, 3)), acc_m_s2=force, fs=60.0, **others)
    return path


def test_whose_the_arrays_are_is_said_by_the_bus(tmp_path):
    file, out = posed(tmp_path / "a.npz"), tmp_path / "c.toml"
    done = quavelet("calibrate", "--from", file, "--out", out, "--bus", "linux:1", "--steps", "rest,poses", "--json")
    assert json.loads(done.out)["src"] == "replay:linux:1"
    record = load_record(out)
    assert (record.chip.bus, record.chip.address) == ("linux:1", 0x68)
    assert record.gyro_bias is not None
    assert record.accelerometer.offset_m_s2 == pytest.approx((0.3, -0.2, 0.1), abs=0.02)


@pytest.mark.parametrize(
    ("arguments", "code", "reason"),
    [
        (("--from", "FILE"), exits.USAGE, "give --out"),
        (("--from", "FILE", "--out", "c.toml", "--steps", "allan"), exits.USAGE, "a recording shows rest, poses"),
        (("--from", "FILE", "--out", "c.toml", "--resume"), exits.USAGE, "leave --virtual-time, --resume out"),
        (("--from", "absent.npz", "--out", "c.toml"), exits.FAILED, "absent.npz"),
        (("--from", "NOISE", "--out", "c.toml"), exits.FAILED, "is no"),
    ],
)
def test_what_cannot_be_is_refused_in_a_sentence(tmp_path, monkeypatch, arguments, code, reason):
    monkeypatch.chdir(tmp_path)
    posed(tmp_path / "a.npz")
    (tmp_path / "noise.npz").write_bytes(b"PK\x03\x04" + bytes(500))
    names = {"FILE": "a.npz", "NOISE": "noise.npz"}
    done = quavelet("calibrate", *(names.get(argument, argument) for argument in arguments))
    assert (done.code, done.out) == (code, ""), done.err
    assert reason in " ".join(done.said)
    assert not (tmp_path / "c.toml").exists()
