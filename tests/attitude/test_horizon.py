"""What the moving filter learns of the gyroscope: what turns show of it, and never what something else is the cause
of."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from imu_blocks import imu_block
from scipy.spatial.transform import Rotation

from quavelet.attitude.doubt import Residual
from quavelet.attitude.params import FilterParams
from quavelet.core.quaternion import inclination_between

G, FS = 9.80665, 100.0
UNSURE = Residual(tilt_rad=0.04, gyro_bias_rad_s=2e-4, gyro_bias_rad_s_degc=0.0, gyro_scale=0.0173)
SURE = replace(UNSURE, tilt_rad=0.001)
RATE_NOISE, FORCE_NOISE = np.radians(0.05), 0.004 * G


def shown(rates, *, matrix=None, offset_g=0.0, force_matrix=None, late_s=0.0, seed=1):
    """Samples of a board that turns so (N, 3) in rad/s from level, and where it truly was (scalar first): by scipy.

    matrix, force_matrix   what the sensors make of rate and force; offset_g   of the force; late_s   the force's delay
    """
    rng, n = np.random.default_rng(seed), len(rates)
    ends = [Rotation.identity()]
    for turn in rates / FS:
        ends.append(ends[-1] * Rotation.from_rotvec(turn))
    before, after = Rotation.concatenate(ends[:-1]), Rotation.concatenate(ends[1:])
    middle = before * Rotation.from_rotvec(rates / FS * (0.5 - late_s * FS))
    force = G * middle.inv().apply([0.0, 0.0, 1.0])
    force = force @ (np.eye(3) if force_matrix is None else force_matrix).T + np.multiply(offset_g, G)
    measured = rates @ (np.eye(3) if matrix is None else matrix).T
    data = imu_block(measured + rng.normal(0.0, RATE_NOISE, (n, 3)), force + rng.normal(0.0, FORCE_NOISE, (n, 3)))
    return data, after.as_quat()[:, [3, 0, 1, 2]]


def filtered(data, residual):
    runner = FilterParams(kind="velocity").build(residual=residual)
    out = runner.process(data)
    horizon = runner.state().horizon
    return out, np.array(horizon.matrix).reshape(3, 3), np.sqrt(horizon.matrix_variance).reshape(3, 3)


def rocking(axis: int, *, seconds: float = 120.0) -> np.ndarray:
    rates = np.zeros((int(seconds * FS), 3))
    rates[:, axis] = np.radians(60.0) * 0.5 * np.sin(0.5 * np.arange(len(rates)) / FS)
    return rates


def tumbling(seed: int, *, seconds: float) -> np.ndarray:
    rng, t = np.random.default_rng(seed), np.arange(int(seconds * FS)) / FS
    waves = [np.sin(rng.uniform(0.2, 1.5, 3) * t[:, None] + rng.uniform(0.0, 6.3, 3)) for _ in range(3)]
    return np.radians(40.0) * np.sum(waves, axis=0)


@pytest.mark.parametrize("off", [-0.03, 0.02])
@pytest.mark.parametrize("axis", [0, 1])
def test_a_wrong_scale_is_learned_and_the_board_leans_no_more(off, axis):
    matrix = np.eye(3)
    matrix[axis, axis] += off
    data, truth = shown(rocking(axis), matrix=matrix)
    out, learned, sigma = filtered(data, SURE)
    error_deg = np.degrees(inclination_between(truth, out.q))[-3000:]
    assert learned[axis, axis] == pytest.approx(1.0 / (1.0 + off) - 1.0, abs=0.003)
    assert sigma[axis, axis] < 0.005
    assert np.sqrt((error_deg**2).mean()) < 0.25
    unseen = np.delete(np.diag(learned), axis)
    assert np.abs(unseen).max() < 0.01


@pytest.mark.parametrize("seed", range(4))
def test_a_board_spun_about_the_vertical_is_not_taught_a_scale_by_its_other_errors(seed):
    """Its accelerometer's offset and its rate across the axes both show as a tilt that stands in the body."""
    rng = np.random.default_rng(seed)
    matrix = np.eye(3) + rng.uniform(-0.02, 0.02, (3, 3))
    axis = np.array([*np.sin(np.radians(rng.uniform(-8.0, 8.0, 2))), 1.0])
    rates = np.zeros((int(110 * FS), 3))
    half_turn = np.sign(np.sin(2.0 * np.pi * np.arange(len(rates) - 1000) / FS / (200.0 if seed % 2 else 20.0)))
    rates[1000:] = np.radians(36.0) * half_turn[:, None] * axis / np.linalg.norm(axis)
    data, _ = shown(rates, matrix=matrix, offset_g=rng.uniform(-0.05, 0.05, 3), seed=seed)
    _, learned, sigma = filtered(data, UNSURE)
    assert abs(learned[2, 2]) < 0.006
    assert sigma[2, 2] > 0.015


def test_a_force_that_comes_late_is_not_taken_for_a_scale():
    data, _ = shown(rocking(0), late_s=0.004)
    _, learned, _ = filtered(data, UNSURE)
    assert abs(learned[0, 0]) < 0.006


def test_the_sigma_of_what_was_learned_is_honest():
    """Twelve uncalibrated boards, tumbled for a minute: every error that the data sheet allows at once."""
    errors, sigmas = [], []
    for seed in range(12):
        rng = np.random.default_rng(100 + seed)
        spread = np.where(np.eye(3, dtype=bool), 0.03, 0.02)
        matrix = np.eye(3) + rng.uniform(-spread, spread)
        force_matrix = np.eye(3) + rng.uniform(-spread, spread)
        offset_g = rng.uniform(-1.0, 1.0, 3) * [0.05, 0.05, 0.08]
        data, _ = shown(
            tumbling(seed, seconds=60.0), matrix=matrix, force_matrix=force_matrix, offset_g=offset_g, seed=seed
        )
        _, learned, sigma = filtered(data, UNSURE)
        errors.append(np.linalg.inv(matrix) - np.eye(3) - learned)
        sigmas.append(sigma)
    errors, sigmas = np.array(errors), np.array(sigmas)
    before = np.where(np.eye(3, dtype=bool), 0.0173, 0.0115)
    in_sigmas = np.sqrt(((errors / sigmas) ** 2).mean())
    print(f"matrix: {in_sigmas:.2f} sigma rms, of which {(sigmas / before).mean():.2f} are left")
    assert 0.5 < in_sigmas < 1.4
    assert (np.abs(errors) < 2.0 * sigmas).mean() > 0.9
    assert (sigmas / before).mean() < 0.9
    assert np.sqrt((errors**2).mean()) < np.sqrt((before**2).mean())
